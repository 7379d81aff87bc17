"""The `roadfiber` command: one sub-command group of each package, and the main job across them."""

import gc
import json
import logging
import os
import shlex
import sys
from contextlib import nullcontext, redirect_stdout
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import calib.cli
import vision.cli
from roadfiber import (
    batch_commands,
    criticism_commands,
    export_commands,
    installation_commands,
    locate_commands,
    planning_commands,
    record_commands,
    study_commands,
    survey_commands,
    web_commands,
)
from solver.survey.memory import collect_seldom, reuse_freed_memory
from vision.contract.errors import InputError, machine_words
from vision.contract.text import plain

if TYPE_CHECKING:
    from solver.simulator import Scenario

#: Exit status of a command that Ctrl-C ended, as shells expect it.
INTERRUPTED = 130

app = typer.Typer(
    name="roadfiber",
    help="Locate a buried fiber from street video (or GPS) and Distributed Acoustic Sensing.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
app.add_typer(calib.cli.app, name="calibrate")
for group in (
    vision.cli.app,
    locate_commands.app,
    survey_commands.app,
    planning_commands.app,
    record_commands.app,
    criticism_commands.app,
    web_commands.app,
    export_commands.app,
    installation_commands.app,
    batch_commands.app,
    study_commands.app,
):
    app.registered_commands += group.registered_commands


def print_version(wanted: bool) -> None:
    """Print the version and end."""
    if wanted:
        from importlib.metadata import version

        print(f"roadfiber {version('roadfiber')}")
        raise typer.Exit


@app.callback()
def verbosity(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what is being done.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print results and errors only.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Locate a buried fiber from street video (or GPS) and Distributed Acoustic Sensing."""
    level = logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO
    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    for handler in logging.getLogger().handlers:
        handler.addFilter(legible)
    logging.getLogger("roadfiber").setLevel(level)
    # It says at length where it keeps its fonts, for a user who has no home.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder to write; an earlier demo there is replaced.")] = Path(
        "roadfiber-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another street.")] = 5,
    hide: Annotated[
        str | None,
        typer.Option(
            metavar="EFFECT",
            help="Hide an effect in the record and find it: NAME, NAME=AMOUNT, or `any`, told at the end.",
        ),
    ] = None,
    laid: Annotated[
        str,
        typer.Option(help="How the fiber lies: `as-built`, a shape by chance; one, such as `crossing`; or `winding`."),
    ] = "as-built",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the error as JSON; what the commands print goes to standard error.")
    ] = False,
) -> None:
    """Film a street, record its fiber, and find the fiber again: the whole way, on a survey whose answer is known.

    Renders a video of moving vehicles and simulates the DAS record they make (the simulator shares no code with the
    solver), writes both as files, and runs the commands a user would run on them. Takes two or three minutes.

    With `--hide` something is hidden in the DAS record. The run is compared and diagnosed, what is found is added, and
    `index.html` tells the story and ends with the envelope: what was hidden, and the route's true error.

    Examples: `roadfiber demo --out runs/demo`, `roadfiber demo --hide any --seed 7 --out runs/hidden`
    """
    from roadfiber.hidden_demo import hidden
    from solver.run.strict_json import strict
    from solver.simulator import read_scenario, route_error

    if hide is not None:
        demo_hidden(out, read_scenario("street-filmed", seed=seed, laid=laid, effects=hidden(hide, seed)), as_json)
        return
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        run = run_demo(out, read_scenario("street-filmed", seed=seed, laid=laid))
    error, report = route_error(run / "route.csv", out / "truth.json"), run / "report.html"
    if as_json:
        told = strict({"error": {"unit": "m", **asdict(error)}, "run": str(run), "report": str(report)})
        print(json.dumps(told, indent=1))
        return
    print(f"\nerror against the known route: {error.words}")
    print(f"report: {report}")


def demo_hidden(out: Path, scenario: "Scenario", as_json: bool) -> None:
    """The demo with something hidden in its record, and the story of how that is found."""
    from roadfiber.hidden_demo import answer, question, told, write_story

    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        run_demo(out, scenario)
        undone = question(out, run_command)
        write_story(out, undone)
    if as_json:
        print(json.dumps(told(out, undone), indent=1))
        return
    print("\n".join([*([undone] if undone else []), f"\nthe envelope: {answer(out)}", f"story: {out / 'index.html'}"]))


def run_demo(out: Path, scenario: "Scenario") -> Path:
    """Write a demo and run the commands on it; the run folder."""
    print(f"filming a street and recording its fiber: {out}", flush=True)
    write_demo(out, scenario)
    site, points, video = out / "site.toml", out / "control_points.csv", out / "street.mp4"
    calibration, trajectories, run = out / "calibration.json", out / "trajectories.csv", out / "run"
    start = f"{scenario.start}Z"
    run_command("calibrate", "ground", points, "--video", video, "--frame", site, "--out", calibration)
    known = ("--calibration", calibration, "--start", start)
    run_command("track", video, "--detector", "street", *known, "--out", trajectories)
    run_command("locate", site, "--out", run)
    return run


def write_demo(out: Path, scenario: "Scenario") -> None:
    """Write what a user would bring: `street.mp4`, `control_points.csv`, `das/*.h5`, `anchors.csv`, `site.toml`."""
    from roadfiber.simulating import write_filmed
    from solver.simulator import simulate

    write_filmed(simulate(scenario), out)


def run_command(*words: object) -> None:
    """Show a command and run it."""
    quiet = logging.getLogger("roadfiber").level > logging.INFO
    arguments = [str(word) for word in words]
    print(f"\n$ {shlex.join(['roadfiber', *arguments])}", flush=True)
    app([*(["--quiet"] if quiet else []), *arguments], standalone_mode=False)


def main() -> None:
    """Run the command; what the user can mend, and what the machine refuses, is one line and exit status 2."""
    reuse_freed_memory()
    collect_seldom()
    try:
        require_surroundings()
        try:
            app()
        finally:
            flush()
            # Else Python looks through hundreds of thousands of objects once more before they go.
            gc.freeze()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            tell("interrupted; the unfinished output is discarded")
        raise
    except BrokenPipeError:  # whoever reads has enough
        sys.exit(1)
    except Exception as error:
        told = str(error) if isinstance(error, InputError) else machine_words(error)
        if told is None:
            raise
        tell(told)
        sys.exit(2)


def require_surroundings() -> None:
    """Refuse to begin where results have nowhere to go, or names of files no folder to start from."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115, PTH123 as long as the process
    if sys.stdout is None:
        raise InputError("standard output is closed; send it somewhere, as with >/dev/null")
    try:
        Path.cwd()
    except OSError as error:
        raise InputError("the folder that you are in was removed; change to another") from error


def flush() -> None:
    """Write what was printed; where that fails it does so once, and not again as Python ends."""
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise type(error)(error.errno, error.strerror, "standard output") from error


def legible(record: logging.LogRecord) -> bool:
    """Take from a message what controls terminals: names of files may hold it."""
    record.msg, record.args = "\n".join(map(plain, record.getMessage().split("\n"))), ()
    return True


def tell(line: str) -> None:
    """Print a line on standard error."""
    print(f"roadfiber: {plain(line)}", file=sys.stderr)
