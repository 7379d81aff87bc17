"""`roadfiber diagnose`, `add`, `clock`, `ladder` and `explain`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from solver.catalogue.plugins import Catalogue
    from solver.criticism.diagnosis import Diagnosis
    from solver.criticism.growth import Grown
    from solver.fit.state import State
    from solver.run.run import Run

app = typer.Typer()

RunFolder = Annotated[Path, typer.Argument(help="A run folder that `roadfiber locate` or `add` wrote.")]
Plugins = Annotated[list[Path] | None, typer.Option("--plugin", help="File with effects of your own; may be repeated.")]
Changed = Annotated[
    bool, typer.Option("--plugin-changed", help="Go on with a plugin that is not the file the run was made with.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of words.")]


def state_of(run: "Run") -> "State":
    """Where the fit of a run ended.

    Raises
    ------
    InputError
        If the run is of a long fiber, where effects would have to be the same along all of it; if it holds other
        numbers than its model has; or if code of its model was not given.
    """
    import torch

    from solver.fit.map_fit import MapFit
    from solver.fit.stretches import ONE_STRETCH, is_long
    from vision.contract import InputError

    if is_long(run.problem):
        length = run.problem.distance[-1] - run.problem.distance[0]
        raise InputError(
            f"run of {length:.0f} m of fiber: a model is criticized over {ONE_STRETCH:.0f} m at most; "
            "name a stretch as channels in site.toml and locate that"
        )
    fit = MapFit(run.problem)
    if len(run.result.vector) != len(fit.mean):
        raise InputError(
            f"run: holds {len(run.result.vector)} fitted numbers, and its model has {len(fit.mean)}; "
            "give the plugin it was made with, or run `roadfiber locate` again"
        )
    return fit.state_of(torch.from_numpy(run.result.vector))


def diagnosed(run: "Run", known: "Catalogue") -> "Diagnosis":
    """Diagnose a run, with a progress bar."""
    from solver.criticism.diagnosis import diagnose as diagnose_problem
    from solver.criticism.diagnosis import steps
    from vision.contract import progress

    effects, state = list(known.values()), state_of(run)
    with progress("testing effects", steps(effects)) as advance:
        return diagnose_problem(run.problem, state, effects=effects, advance=advance)


def in_words(diagnosis: "Diagnosis", folder: Path) -> str:
    """What `diagnose` prints."""
    lines = [f"{diagnosis.verdict}: {diagnosis.words}"]
    if diagnosis.separate:
        lines.append(f"what would tell them apart: {diagnosis.separate}")
    for c in diagnosis.candidates[:6]:
        full = "" if c.refitted else " (predicted)"
        size = f"{c.estimate:.3g} +- {c.sigma:.2g} {c.unit}"
        lines.append(f"  {c.effect:22s} {c.verdict:12s} chi2 falls by {c.delta_chi2:8.0f}{full}; size {size}")
    lines.append(f"page: {folder / 'diagnosis.html'}")
    return "\n".join(lines)


@app.command()
def diagnose(run: RunFolder, plugin: Plugins = None, changed: Changed = False, as_json: AsJson = False) -> None:
    """Say which physical effect the model of a run lacks, if any.

    Audits the noise, tests every effect of the catalogue (and your own), fits the best in full, and writes
    diagnosis.json and diagnosis.html into the run folder. The verdict is adequate, missing-effect, unknown-effect or
    inconclusive, with what the survey cannot tell apart and the smallest size it would have shown.

    Example: `roadfiber diagnose runs/main-street --plugin my_effects.py`
    """
    from solver.criticism.diagnosis_files import write_diagnosis
    from solver.run import open_run
    from vision.contract import require_writable

    located, known = open_run(run, plugin or [], changed)
    require_writable(run / "diagnosis.json")
    diagnosis = diagnosed(located, known)
    write_diagnosis(run, diagnosis, located.facts["name"])
    print((run / "diagnosis.json").read_text(encoding="utf-8") if as_json else in_words(diagnosis, run))


def grown(run: "Run", names: list[str], known: "Catalogue", force: bool) -> "tuple[Run, list[Grown]]":
    """Add effects one after another; refuse one that passes held out do not want."""
    import time

    from solver.criticism.growth import check_names, grow, with_growth
    from solver.fit.held_out import FOLDS
    from solver.fit.map_fit import MapFit
    from solver.run.code import with_plugins
    from vision.contract import InputError, progress

    begun = time.perf_counter()
    check_names(names, run.problem, known)
    state, fit = state_of(run), MapFit(run.problem)
    effects, steps = list(run.facts["effects"]), []
    with progress("fitting with more effects", (2 * FOLDS + 2) * len(names)) as advance:
        for name in names:
            step = grow(fit, state, name, known, advance)
            if not step.better and not force:
                raise InputError(
                    f"{name}: chi2 per degree of freedom of held-out passes goes from {step.held_out_words}; "
                    "not kept (--force keeps it all the same)"
                )
            fit, state = step.fit, step.solution.state
            effects.append(name)
            steps.append(step)
    return with_plugins(with_growth(run, steps[-1], effects, time.perf_counter() - begun), known), steps


@app.command()
def add(
    run: RunFolder,
    effects: Annotated[list[str], typer.Argument(help="Names of effects; `roadfiber effects` lists them.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to write.")],
    plugin: Plugins = None,
    changed: Changed = False,
    force: Annotated[bool, typer.Option("--force", help="Keep it even if held-out passes fit no better.")] = False,
    as_json: AsJson = False,
) -> None:
    """Add effects to the model of a run, fit everything again, and extend the error ladder.

    Refuses an effect with which passes held out fit no better. The run you start from stays as it is.

    Example: `roadfiber add runs/main-street gauge_length --out runs/main-street-2`
    """
    from solver.criticism.diagnosis_files import check_out, ladder_from, write_ladder
    from solver.criticism.growth import climbed
    from solver.run import open_run
    from solver.run.folder import write_files
    from vision.contract import writing

    check_out(out, run)
    before, known = open_run(run, plugin or [], changed)
    below = ladder_from(run, before, out)
    after, steps = grown(before, effects, known, force)
    rungs = climbed(below, before, after)
    with writing(out) as folder:
        write_files(folder, after)
        write_ladder(folder, rungs, after.facts["name"])
    if as_json:
        print((out / "ladder.json").read_text(encoding="utf-8"))
        return
    for line in rungs[-1].words:
        print(line)
    print(after.facts["trust"]["sentence"].replace("RUN", str(out)))
    for name, step in zip(effects, steps, strict=True):
        print(f"{name}: held-out chi2 per degree of freedom from {step.held_out_words}")
    print(f"chi2 per degree of freedom {rungs[-2].chi2_per_dof:.3f} -> {rungs[-1].chi2_per_dof:.3f}")
    print(f"the route moved by up to {rungs[-1].route_change:.2f} m")
    print(f"page: {out / 'ladder.html'}")


@app.command()
def clock(run: RunFolder, plugin: Plugins = None, changed: Changed = False, as_json: AsJson = False) -> None:
    """Estimate the offset between the clocks of trajectories and DAS from a located run.

    The offset that fits all passes best, with the route free to move along; two directions, or clearly different
    speeds, tell it from a shift of the fiber. Put `clock_offset` under `[camera]` less this value, or correct the
    trajectories' times by it.

    Example: `roadfiber clock runs/main-street`
    """
    import json

    from solver.criticism.diagnosis import converged
    from solver.criticism.growth import fitted_with
    from solver.fit.track_trust import strict_tracks
    from solver.run import open_run
    from solver.trajectory.trajectory_effects import CLOCK

    located, _ = open_run(run, plugin or [], changed)
    fit, state = converged(strict_tracks(located.problem), state_of(located))
    found = fitted_with(fit, state, CLOCK, lambda n: None)
    at = found.solution.state
    covariance = found.fit.normal(at)[0].inverse()
    offset, sigma = float(at.numbers[-1]), float(covariance[-1, -1].sqrt())
    if as_json:
        print(json.dumps({"clock_offset": offset, "sigma": sigma, "unit": "s"}))
        return
    print(f"the DAS clock is ahead of the trajectories' by {offset:+.3f} +- {sigma:.3f} s")
    if abs(offset) < 3 * sigma:
        print("that is no more than chance")


@app.command()
def ladder(runs: Annotated[list[Path], typer.Argument(help="Run folders.")], as_json: AsJson = False) -> None:
    """Draw the error ladder of runs: misfit against rungs, the noise floor, and how far the route moved.

    `--json` prints one ladder, or a list of them where several runs are given.

    Example: `roadfiber ladder runs/main-street-2`
    """
    import json

    from solver.criticism.diagnosis_files import ladder_facts, read_ladder, write_ladder
    from solver.criticism.growth import first_rung
    from solver.run import read_run

    written = []
    for folder in runs:
        run = read_run(folder)
        rungs = read_ladder(folder) or [first_rung(run)]
        write_ladder(folder, rungs, run.facts["name"])
        written.append(ladder_facts(rungs))
        if as_json:
            continue
        for rung in rungs:
            held = "-" if rung.held_out_chi2_per_dof is None else f"{rung.held_out_chi2_per_dof:.3f}"
            for line in rung.words:
                print(line)
            names = ", ".join(rung.effects) or "as published"
            print(f"chi2/dof {rung.chi2_per_dof:.3f}  held out {held}  moved {rung.route_change:.2f} m  {names}")
        print(f"page: {folder / 'ladder.html'}")
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
    import json
    import time

    from solver.criticism.diagnosis_files import (
        check_out,
        ladder_from,
        story_facts,
        write_diagnosis,
        write_ladder,
        write_story,
    )
    from solver.criticism.growth import climbed, with_growth
    from solver.criticism.growth import grow as grow_by
    from solver.criticism.pages import Chapter
    from solver.criticism.verdict_words import left_open
    from solver.fit.map_fit import MapFit
    from solver.run import open_run
    from solver.run.code import with_plugins
    from solver.run.folder import write_files
    from vision.contract import writing

    def tell(line: str) -> None:
        if not as_json:
            print(line, flush=True)

    check_out(out, run)
    current, known = open_run(run, plugin or [], changed)
    climb = ladder_from(run, current, out)
    chapters: list[Chapter] = []
    for _ in range(rungs + 1):
        diagnosis = diagnosed(current, known)
        tell(f"{diagnosis.verdict}: {diagnosis.words}")
        name = diagnosis.candidates[0].effect if diagnosis.candidates else ""
        if diagnosis.verdict != "missing-effect" or len(chapters) == rungs:
            chapters.append(Chapter(diagnosis, "Nothing more was added."))
            break
        begun = time.perf_counter()
        step = grow_by(MapFit(current.problem), state_of(current), name, known)
        if not step.better:
            chapters.append(Chapter(diagnosis, f"{name} was tried, and passes held out fit no better."))
            break
        effects = [*current.facts["effects"], name]
        after = with_growth(current, step, effects, time.perf_counter() - begun)
        climb = climbed(climb, current, after)
        chapters.append(Chapter(diagnosis, f"{name} was added; the route moved {climb[-1].route_change:.2f} m."))
        for line in climb[-1].words:
            tell(line)
        tell(f"added {name}: chi2 per degree of freedom {climb[-2].chi2_per_dof:.3f} -> {climb[-1].chi2_per_dof:.3f}")
        current = after
    with writing(out) as folder:
        write_files(folder, with_plugins(current, known))
        write_diagnosis(folder, chapters[-1].diagnosis, current.facts["name"])
        write_ladder(folder, climb, current.facts["name"])
        write_story(folder, chapters, climb, current.facts["name"])
    sentence = current.facts["trust"]["sentence"].replace("RUN", str(out))
    words = left_open(one.diagnosis.candidates[0] for one in chapters if one.diagnosis.candidates)
    if as_json:
        print(json.dumps(story_facts(chapters, climb) | {"trust": sentence, "still_open": words}, indent=1))
    for line in (sentence, words, f"story: {out / 'explain.html'}"):
        if line:
            tell(line)
