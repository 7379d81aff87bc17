"""`roadfiber track`."""

import typer

app = typer.Typer()
