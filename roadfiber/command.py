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
    planning_commands,
    record_commands,
    study_commands,
    survey_commands,
    web_commands,
)
from solver.survey.memory import collect_seldom, reuse_freed_memory
from vision.contract.errors import InputError, machine_words

if TYPE_CHECKING:
    from solver.drive.drive_run import DriveRun
    from solver.run.run import Run
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
    logging.getLogger("roadfiber").setLevel(level)
    # It says at length where it keeps its fonts, for a user who has no home.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


@app.command()
def locate(
    site: Annotated[Path, typer.Argument(help="The survey's site.toml, or its folder.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write.")] = Path("run"),
    method: Annotated[str, typer.Option(help="spline (default), or network: the paper's.")] = "spline",
    likelihood: Annotated[
        str | None,
        typer.Option(
            help="Of the network: published, or whitened: noise and priors as the spline's.", show_default="published"
        ),
    ] = None,
    effects: Annotated[
        str | None,
        typer.Option(help="Effects in the model, by comma; none: as published.", show_default="the base model's"),
    ] = None,
    filters: Annotated[
        list[str] | None,
        typer.Option("--filter", help="fk or median, for the matched filter in much noise; may be given twice."),
    ] = None,
    all_passes: Annotated[
        bool,
        typer.Option("--all-passes", help="Fit all vehicles; of more than 30, the 10 to 20 that tell most otherwise."),
    ] = False,
    unlisted: Annotated[
        bool,
        typer.Option("--unlisted", help="Fit vehicles, too, that the fiber hears and the trajectories lack."),
    ] = False,
    corridor: Annotated[
        str,
        typer.Option(help="full: with what the model may lack; fit: as if it lacked nothing, which is faster."),
    ] = "full",
    as_json: Annotated[bool, typer.Option("--json", help="Print fit.json instead of words.")] = False,
) -> None:
    """Locate the fiber of a survey: DAS files and trajectories, or a video, to a route on a map.

    Writes route.csv, route.geojson, fit.json and report.html. Where there are no trajectories the video is tracked
    first, and the run folder gets trajectories.csv too.

    The 95 % corridor holds what the model may lack: at the end every effect of the catalogue is tested on what the fit
    leaves, and the corridor widened by how far the route would follow it. `--corridor fit` leaves that out.

    Where site.toml has `[route]`, the operator's map of a fiber that one car with GPS drove along, the clock, loops of
    slack and the place of every channel along that map are found, and whether gauge length, channel spacing and clock
    are as stated; `--effects gauge_length,channel_stretch,clock_drift` fits them. `--method` and the like do not apply.

    Examples: `roadfiber locate surveys/main-street/site.toml --out runs/main-street`, `roadfiber locate drive`
    """
    import roadfiber as rf
    from solver.run.folder import check_target
    from solver.run.locate import EFFECTS

    check_target(out)
    asked = EFFECTS if effects is None else [name.strip() for name in effects.split(",")]
    chosen = [name for name in asked if name not in ("", "none")]
    try:
        run = rf.locate(
            site,
            method=method,
            likelihood=likelihood,
            effects=chosen,
            filters=filters or (),
            all_passes=all_passes,
            unlisted=unlisted,
            corridor=corridor,
        )
    except InputError as error:
        raise InputError(f"{error}{pictured(error, out)}") from error
    run.save(out)
    print((out / "fit.json").read_text(encoding="utf-8") if as_json else summary(run, out))


def pictured(error: InputError, out: Path) -> str:
    """Draw what was seen of a record that is refused, beside the run folder; where, as the end of a sentence."""
    from solver.start.alignment import NotFollowingError
    from vision.contract import writing

    seen = next((one.seen for one in (error, error.__cause__) if isinstance(one, NotFollowingError)), None)
    if seen is None:
        return ""
    path = out.with_name(f"{out.name}-refused.png")
    with writing(path) as temporary:
        seen.figure().savefig(temporary, format="png", dpi=150)
    return f"; what was seen: {path}"


def summary(run: "Run | DriveRun", out: Path) -> str:
    """Say in a few lines what was found and how far it may be relied on: what the report and fit.json say, too."""
    from solver.run.run import Run

    if not isinstance(run, Run):
        return "\n".join([run.headline, run.trust, *run.warnings, f"report: {out / 'report.html'}"])
    known = run.route[run.route["constrained"]]
    found = ["the data decide no place of the fiber"]
    if len(known):
        first, last = known["channel"].iloc[[0, -1]]
        across, deep = known["sigma_y"].max(), known["sigma_z"].max()
        found = [f"fiber located over {len(known)} channels, {first} to {last}"]
        found += [f"1 sigma: {across:.2f} m across at most, {deep:.2f} m in depth"]
    return "\n".join(
        [
            run.headline,
            run.trust.replace("RUN", str(out)),
            *found,
            *([run.corridor.replace("RUN", str(out))] if run.corridor else []),
            *run.warnings,
            f"report: {out / 'report.html'}",
        ]
    )


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder to write; an earlier demo there is replaced.")] = Path(
        "roadfiber-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another street.")] = 4,
    hide: Annotated[
        str | None,
        typer.Option(
            metavar="EFFECT",
            help="Hide an effect in the record and find it: NAME, NAME=AMOUNT, or `any`, told at the end.",
        ),
    ] = None,
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
    from solver.simulator import read_scenario, route_error

    if hide is not None:
        demo_hidden(out, seed, hide, as_json)
        return
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        run = run_demo(out, read_scenario("street-filmed", seed=seed))
    error, report = route_error(run / "route.csv", out / "truth.json"), run / "report.html"
    if as_json:
        print(json.dumps({"error": {"unit": "m", **asdict(error)}, "run": str(run), "report": str(report)}, indent=1))
        return
    print(
        f"\nerror against the known route, {error.channels} channels in view: {error.mean:.2f} m on average, "
        f"{error.largest:.2f} m at most ({error.largest_lateral:.2f} on the map, {error.largest_depth:.2f} in depth)"
    )
    print(f"report: {report}")


def demo_hidden(out: Path, seed: int, hide: str, as_json: bool) -> None:
    """The demo with something hidden in its record, and the story of how that is found."""
    from roadfiber.hidden_demo import answer, hidden, question, told, write_story
    from solver.simulator import read_scenario

    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        run_demo(out, read_scenario("street-filmed", seed=seed, effects=hidden(hide, seed)))
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


def flush() -> None:
    """Write what was printed; where that fails it does so once, and not again as Python ends."""
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise type(error)(error.errno, error.strerror, "standard output") from error


def tell(line: str) -> None:
    """Print a line on standard error."""
    print(f"roadfiber: {line}", file=sys.stderr)
