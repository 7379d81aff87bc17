"""The `roadfiber` command: one sub-command group of each package, and the main job across them."""

import logging
import sys
from typing import Annotated

import typer

import calib.cli
import solver.cli
import vision.cli
from vision.contract.errors import InputError

app = typer.Typer(
    name="roadfiber",
    help="Locate a buried fiber from street video (or GPS) and Distributed Acoustic Sensing.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
app.add_typer(calib.cli.app, name="calibrate")
for group in (vision.cli.app, solver.cli.app):
    app.registered_commands += group.registered_commands


@app.callback()
def verbosity(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what is being done.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print results and errors only.")] = False,
) -> None:
    """Locate a buried fiber from street video (or GPS) and Distributed Acoustic Sensing."""
    level = logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO
    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger("roadfiber").setLevel(level)


def main() -> None:
    """Run the command; an input the user can mend is one line and exit status 2."""
    try:
        app()
    except InputError as error:
        print(f"roadfiber: {error}", file=sys.stderr)
        sys.exit(2)
