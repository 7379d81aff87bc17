"""`roadfiber calibrate ...`: the camera calibration tool; `ground`."""

import typer

app = typer.Typer()
