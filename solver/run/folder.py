"""The run folder: what `locate` leaves behind, and all that later commands need of it."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from solver.catalogue.plugins import Catalogue, catalogue
from solver.effect import Effect
from solver.run import geojson
from solver.run.arrays import Arrays
from solver.run.code import check_plugins, finder
from solver.run.ladder_file import read_ladder, write_ladder
from solver.run.pass_arrays import pass_arrays
from solver.run.problem_arrays import problem_arrays, problem_from
from solver.run.read_seen import ARRAYS, MAPS, parts_of, read_facts, read_parts
from solver.run.read_stored import read_model
from solver.run.report.joined import join
from solver.run.route_table import route_csv
from solver.run.run import Run
from solver.run.scene import CALIBRATION, PICTURE
from solver.run.soundness import check_agreement
from solver.run.stored import AnyRun
from solver.survey.anchors import Anchor
from vision.contract import InputError, require_writable, write_trajectories, writing


def write_arrays(path: Path, run: Run) -> None:
    """Write data.npz: maps, route with covariance, passes."""
    result = run.result
    arrays: dict[str, Any] = {name: getattr(result, name) for name in ARRAYS}
    maps = {name: getattr(result, name).astype(np.float32) for name in MAPS}
    arrays |= maps | pass_arrays(run.passes) | problem_arrays(run.problem)
    arrays["added"] = np.zeros_like(result.covariance) if run.added is None else run.added
    np.savez_compressed(path, time=run.time, **arrays)


def check_target(folder: Path) -> None:
    """Refuse, before any work, a folder that cannot be written or holds something else than a run.

    Raises
    ------
    InputError
        If `folder` is a file, or a folder with content and no fit.json of a run, or cannot be written.

    >>> import tempfile
    >>> check_target(Path(tempfile.mkdtemp()))
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: a file; give the name of a new folder")
    if Path.cwd().is_relative_to(folder.resolve()):
        raise InputError(f"{folder}: is where you are, and would be replaced; give the name of a new folder")
    if folder.is_dir() and any(folder.iterdir()):
        try:
            read_model(folder / "fit.json", AnyRun, "")
        except InputError as error:
            raise InputError(f"{folder}: holds something else than a run; give the name of a new folder") from error
    require_writable(folder)


def write_judged(folder: Path, run: Run) -> None:
    """Write all files of a run folder that say where the fiber is, and how far that may be relied on."""
    # Loads Matplotlib, 30 MB, which nothing before needs.
    from solver.run.report import report_page

    (folder / "route.csv").write_text(route_csv(run.route), encoding="utf-8")
    features = geojson.route_features(run.place, run.frame, run.anchors, run.name)
    (folder / "route.geojson").write_text(json.dumps(features, allow_nan=False), encoding="utf-8")
    (folder / "fit.json").write_text(json.dumps(run.facts, allow_nan=False, indent=1), encoding="utf-8")
    write_arrays(folder / "data.npz", run)
    (folder / "report.html").write_text(report_page.render(run), encoding="utf-8")


def write_run(folder: Path, run: Run) -> None:
    """Write a run folder, whole or not at all; an earlier run there is replaced.

    `route.csv`, `route.geojson`, `fit.json`, `report.html`, `index.html` and `data.npz` go there. Where there was a
    camera, `street.jpg` and its `calibration.json` too, to draw the route into its picture. Where a video was tracked
    for this run, `trajectories.csv` and what it leaves out too; where effects were added to an earlier run,
    `ladder.json` and `ladder.html`.

    Raises
    ------
    InputError
        If `folder` holds something else than a run (see `check_target`), or cannot be written.
    """
    folder = Path(folder)
    check_target(folder)
    with writing(folder) as temporary:
        temporary.mkdir()
        write_judged(temporary, run)
        if run.scene is not None:
            (temporary / PICTURE).write_bytes(run.scene.jpeg)
            (temporary / CALIBRATION).write_text(run.scene.text, encoding="utf-8")
        if run.tracked is not None:
            write_trajectories(run.tracked, temporary / "trajectories.csv")
        if run.dropped is not None:
            run.dropped.to_csv(temporary / "trajectories.csv.dropped", index=False, float_format="%.10g")
        if run.rungs:
            write_ladder(temporary, run.rungs, run.name, seen_from=folder)
        join(temporary, called=folder.resolve().name)


def read_run(
    folder: Path, *, plugins: Sequence[Path] = (), effects: Iterable[Effect] = (), changed: bool = False
) -> Run:
    """Read a run folder back; no code that lies in it is run.

    Parameters
    ----------
    folder : as `write_run` wrote it
    plugins : files with users' effects that may be in its model, or put into it
    effects : such effects as objects; where one of the model is not given, everything but the model can be looked at,
        and evaluating that raises an InputError which says what to give
    changed : whether a plugin may be another than the file that the run was made with

    Returns
    -------
    run : its result with measured, model and weight in single precision

    Raises
    ------
    InputError
        If it is not a run folder, a part of it is missing or corrupt, a plugin cannot be used, or is not the one that
        the run was made with.
    """
    facts = read_facts(folder)
    known = catalogue(plugins).extended(effects)
    if not changed:
        check_plugins(facts, known.plugin_of)
    with read_parts(folder) as arrays:
        run = assembled(facts, arrays, known)
    return replace(run, rungs=tuple(read_ladder(folder)), folder=Path(folder).resolve())


def assembled(facts: dict[str, Any], arrays: Arrays, known: Catalogue) -> Run:
    """The run that a run folder's facts and arrays are of; ValueError where they contradict each other."""
    anchors = [Anchor(**anchor) for anchor in facts["anchors"]]
    problem = problem_from(arrays, facts["problem"], anchors, finder(facts["plugins"], known.values()))
    check_agreement(problem, arrays, anchors, facts["settings"]["sampling_rate"])
    return Run(**parts_of(facts, arrays), problem=problem, known=known)
