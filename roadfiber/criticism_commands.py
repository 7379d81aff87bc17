"""`roadfiber compare`, `diagnose`, `stretch`, `add`, `clock`, `ladder` and `explain`."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from solver.run.run import Run

app = typer.Typer()

RunFolder = Annotated[Path, typer.Argument(help="A run folder that `roadfiber locate` or `add` wrote.")]
Plugins = Annotated[list[Path] | None, typer.Option("--plugin", help="File with effects of your own; may be repeated.")]
Changed = Annotated[
    bool, typer.Option("--plugin-changed", help="Go on with a plugin that is not the file the run was made with.")
]
Corridor = Annotated[
    str,
    typer.Option(help="full: with what the model may still lack; fit: as if it lacked nothing, which is faster."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of words.")]


def teller(as_json: bool) -> Callable[[str], None]:
    """Prints what is found as soon as it is known; nothing where JSON is asked for."""
    return (lambda words: None) if as_json else partial(print, flush=True)


@app.command()
def compare(
    run: Annotated[Path, typer.Argument(help="A run folder that `roadfiber locate` wrote.")],
    out: Annotated[Path | None, typer.Option(help="Folder to write into.  [default: the run folder]")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print compare.json instead of words.")] = False,
) -> None:
    """Compare the model of a run with the measurement: where, when and how they differ.

    Writes compare.html (measured, model and residual with one zoom; the residual in the vehicle's frame, by channel,
    pass, speed, class, lane, frequency and wavenumber; the regions that fail), compare.json and pictures. A run of more
    than 200 m is compared stretch by stretch, each in a folder of its own.

    Example: `roadfiber compare runs/main-street`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from vision.contract import require_writable

    opened, folder = open_street(run), out or run
    require_writable(folder / "compare.html")
    found = rf.compare_stretches(opened) if opened.too_long else rf.compare(opened)
    found.save(folder)
    if as_json:
        print(json.dumps(found.facts, allow_nan=False, indent=1))
        return
    print("\n".join([*found.said(), opened.trust.replace("RUN", str(run))]))
    print("\n".join(f"page: {page}" for page in found.pages(folder)))


@app.command()
def combine(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of one fiber, of several days or cameras.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to write.")] = Path("combined"),
    as_json: Annotated[bool, typer.Option("--json", help="Print combined.json instead of words.")] = False,
) -> None:
    """Combine runs of one fiber into one route: the one that a single fit of all their passes finds.

    Writes route.csv, route.geojson, combined.json and combined.html, says whether the runs agree, and keeps them in
    `runs`; `roadfiber export` takes the folder.

    Example: `roadfiber combine runs/monday runs/tuesday --out runs/both`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from solver.run.combined import check_place

    check_place(out)
    combined = rf.combine(*(open_street(run) for run in runs))
    combined.save(out)
    if as_json:
        print(json.dumps(combined.facts, allow_nan=False, indent=1))
        return
    print(combined.headline)
    for one in combined.agreement:
        passed = "one pass" if one.passes == 1 else f"{one.passes} passes"
        print(f"  {one.run}: {passed}, {one.across:+.2f} m across and {one.depth:+.2f} m in depth from it")
    print(f"page: {out / 'combined.html'}")


@app.command()
def diagnose(run: RunFolder, plugin: Plugins = None, changed: Changed = False, as_json: AsJson = False) -> None:
    """Say which physical effect the model of a run lacks, if any.

    Audits the noise, tests every effect of the catalogue (and your own), fits the best in full, tells what explains
    most after each of these, and writes diagnosis.json and diagnosis.html into the run folder. The verdict is adequate,
    missing-effect, unknown-effect or inconclusive, with what the survey cannot tell apart and the smallest size it
    would have shown. A run of more than 200 m is diagnosed stretch by stretch: stretches.json and stretches.html say
    what all of them lack together, and each stretch gets a run folder in the run folder. Of a drive it is told whether
    gauge length, channel spacing and clock are as stated, which `locate` found out.

    Example: `roadfiber diagnose runs/main-street --plugin my_effects.py`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from solver.drive.drive_format import is_drive
    from vision.contract import require_writable

    if is_drive(run):
        told_of_drive(run, as_json)
        return
    opened = open_street(run, plugins=plugin or (), changed=changed)
    page = run / ("stretches.html" if opened.too_long else "diagnosis.html")
    require_writable(page)
    tell = teller(as_json)
    found = rf.diagnose_stretches(opened, tell=tell) if opened.too_long else rf.diagnose(opened, tell=tell)
    found.save(run)
    if as_json:
        print(json.dumps(found.facts, allow_nan=False, indent=1))
        return
    print("\n".join([*found.lines(), found.run.trust.replace("RUN", str(run)), f"page: {page}"]))


def told_of_drive(folder: Path, as_json: bool) -> None:
    """Print what files may state wrongly of a located drive."""
    from solver.drive.drive_folder import read_drive_run

    run = read_drive_run(folder)
    if as_json:
        print(json.dumps(run.facts["misstated"], allow_nan=False, indent=1))
        return
    print("\n".join([*run.told(), f"page: {folder / 'report.html'}"]))


@app.command()
def stretch(
    run: RunFolder,
    first: Annotated[int, typer.Argument(help="First channel, as the DAS file counts.")],
    last: Annotated[int, typer.Argument(help="Last channel.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write.")],
    plugin: Plugins = None,
    changed: Changed = False,
) -> None:
    """Make a run of a stretch of a longer one, fitted by itself: it can be compared, diagnosed and given effects.

    Example: `roadfiber stretch runs/main-street 120 260 --out runs/bridge`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from solver.criticism.diagnosis_files import check_out

    opened = open_street(run, plugins=plugin or (), changed=changed)
    check_out(out, opened)
    part = rf.stretch(opened, first, last)
    part.save(out)
    print("\n".join([part.headline, part.trust.replace("RUN", str(out)), f"page: {out / 'report.html'}"]))


@app.command()
def add(
    run: RunFolder,
    effects: Annotated[list[str], typer.Argument(help="Names of effects; `roadfiber effects` lists them.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write.")],
    plugin: Plugins = None,
    changed: Changed = False,
    force: Annotated[bool, typer.Option("--force", help="Keep it even if held-out passes fit no better.")] = False,
    corridor: Corridor = "full",
    as_json: AsJson = False,
) -> None:
    """Add effects to the model of a run, fit everything again, and extend the error ladder.

    Refuses an effect with which passes held out fit no better. The run you start from stays as it is.

    Example: `roadfiber add runs/main-street gauge_length --out runs/main-street-2`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from solver.criticism.diagnosis_files import check_out

    opened = open_street(run, plugins=plugin or (), changed=changed)
    check_out(out, opened)
    said = list[str]()
    after = rf.add(opened, *effects, force=force, tell=said.append, corridor=corridor)
    after.save(out)
    if as_json:
        print(json.dumps(rf.ladder(open_street(out)).facts, allow_nan=False, indent=1))
        return
    print("\n".join(grown_lines(after, out, said)))


def grown_lines(after: "Run", out: Path, said: Sequence[str] = ()) -> list[str]:
    """What is printed of a run one rung up its ladder, in the folder `out`; `said` after the verdict."""
    from solver.run.rung import route_moved

    before, last = after.rungs[-2:]
    return [
        *last.words,
        after.trust.replace("RUN", str(out)),
        *said,
        f"chi2 per degree of freedom {before.chi2_per_dof:.3f} -> {last.chi2_per_dof:.3f}",
        route_moved(last.route_change),
        *([after.corridor.replace("RUN", str(out))] if after.corridor else []),
        f"page: {out / 'ladder.html'}",
    ]


@app.command()
def turn(
    run: RunFolder,
    channels: Annotated[list[int], typer.Argument(help="Channels at which it turns, as the DAS file counts.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write.")],
    plugin: Plugins = None,
    changed: Changed = False,
    corridor: Corridor = "full",
    as_json: AsJson = False,
) -> None:
    """Let the fiber turn at channels where you know that it does, and fit everything again.

    `locate` finds most corners by itself. The run you start from stays as it is.

    Example: `roadfiber turn runs/main-street 82 88 --out runs/main-street-2`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from solver.criticism.diagnosis_files import check_out

    opened = open_street(run, plugins=plugin or (), changed=changed)
    check_out(out, opened)
    after = rf.turn(opened, *channels, corridor=corridor)
    after.save(out)
    if as_json:
        print(json.dumps(rf.ladder(open_street(out)).facts, allow_nan=False, indent=1))
        return
    corners = [f"the fiber {one.words}" for one in after.corners]
    print("\n".join(grown_lines(after, out, corners)))


@app.command()
def clock(run: RunFolder, plugin: Plugins = None, changed: Changed = False, as_json: AsJson = False) -> None:
    """Estimate the offset between the clocks of trajectories and DAS from a located run.

    The offset that fits all passes best, with the route free to move along; two directions, or clearly different
    speeds, tell it from a shift of the fiber. Put `clock_offset` under `[camera]` less this value, or correct the
    trajectories' times by it.

    Example: `roadfiber clock runs/main-street`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from vision.contract.rounding import with_sigma

    offset, sigma = rf.clock_offset(open_street(run, plugins=plugin or (), changed=changed))
    if as_json:
        print(json.dumps({"clock_offset": offset, "sigma": sigma, "unit": "s"}))
        return
    print(f"the DAS clock is ahead of the trajectories' by {with_sigma(offset, sigma)} s")
    if abs(offset) < 3 * sigma:
        print("that is no more than chance")


@app.command()
def ladder(runs: Annotated[list[Path], typer.Argument(help="Run folders.")], as_json: AsJson = False) -> None:
    """Draw the error ladder of runs: misfit against rungs, the noise floor, and how far the route moved.

    `--json` prints one ladder, or a list of them where several runs are given.

    Example: `roadfiber ladder runs/main-street-2`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street

    written = []
    for folder in runs:
        climbed = rf.ladder(open_street(folder))
        climbed.save(folder)
        written.append(climbed.facts)
        if not as_json:
            print("\n".join([*climbed.lines(), f"page: {folder / 'ladder.html'}"]))
    if as_json:
        print(json.dumps(written if len(written) > 1 else written[0], indent=1))


@app.command()
def explain(
    run: RunFolder,
    out: Annotated[Path, typer.Option("--out", help="Run folder to write: the last rung, with the story.")],
    plugin: Plugins = None,
    changed: Changed = False,
    rungs: Annotated[int, typer.Option(min=1, max=8, help="Effects to add at most.")] = 4,
    as_json: AsJson = False,
) -> None:
    """Diagnose, add, and again until the model is adequate; tell the story.

    Writes the last rung's run folder with explain.html and ladder.html; nothing is added that held-out passes do not
    want.

    Example: `roadfiber explain runs/main-street --out runs/main-street-explained`
    """
    import roadfiber as rf
    from roadfiber.locating import open_street
    from solver.criticism.diagnosis_files import check_out

    opened, tell = open_street(run, plugins=plugin or (), changed=changed), teller(as_json)
    check_out(out, opened)
    story = rf.explain(opened, most=rungs, tell=tell)
    story.save(out)
    sentence = story.run.trust.replace("RUN", str(out))
    if as_json:
        print(json.dumps(story.facts(out) | {"trust": sentence}, indent=1))
    for line in (sentence, story.still_open, f"story: {out / 'explain.html'}"):
        if line:
            tell(line)
