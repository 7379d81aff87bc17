"""`roadfiber simulate`, and what locating needs."""

import typer

app = typer.Typer()
