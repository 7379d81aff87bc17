"""The run folder: what `locate` leaves behind, and all that later commands need of it."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from solver.catalogue.plugins import Catalogue, catalogue
from solver.effect import Effect
from solver.fit.held_out import HeldOut
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.run import geojson, report
from solver.run.arrays import Arrays, read_arrays
from solver.run.code import check_plugins, finder
from solver.run.facts import facts_of
from solver.run.problem_arrays import pass_arrays, passes_from, problem_arrays, problem_from
from solver.run.run import Run
from solver.run.soundness import check_agreement, check_arrays
from solver.run.stored import AnyRun, FitFile, read_model
from solver.survey.anchors import Anchor
from solver.survey.das import DASRecord
from solver.survey.site import Site
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, LocalFrame, require_writable, writing

# What of a FitResult are arrays, and so goes into data.npz; maps are stored in single precision, 1e-7 of their value.
# What was measured is in the problem's record.
ROUTE = ("channel", "distance", "route", "covariance", "constrained", "data_share")
ARRAYS = (*ROUTE, "vector", "samples", "fitted_channel", "noise")
MAPS = ("model", "weight")


def route_table(run: Run) -> str:
    """Return route.csv: one row per channel, meters and degrees; sigma empty where the method gives none.

    Altitudes are in no column: z is the depth below the road.
    """
    result = run.result
    latitude, longitude = run.frame.to_geographic(result.route[:, 0], result.route[:, 1])
    lines = ["channel,distance,x,y,z,sigma_x,sigma_y,sigma_z,latitude,longitude,constrained"]
    for i, channel in enumerate(result.channel):
        meters = (result.distance[i], *result.route[i], *result.sigma[i])
        cells = [f"{value:.4f}" if np.isfinite(value) else "" for value in meters]
        degrees = [f"{latitude[i]:.9f}", f"{longitude[i]:.9f}"]
        lines.append(",".join([str(channel), *cells, *degrees, str(bool(result.constrained[i])).lower()]))
    return "\n".join(lines) + "\n"


def write_arrays(path: Path, run: Run) -> None:
    """Write data.npz: maps, route with covariance, passes."""
    result = run.result
    arrays: dict[str, Any] = {name: getattr(result, name) for name in ARRAYS}
    maps = {name: getattr(result, name).astype(np.float32) for name in MAPS}
    arrays |= maps | pass_arrays(run.passes) | problem_arrays(run.problem)
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
    if folder.is_dir() and any(folder.iterdir()):
        try:
            read_model(folder / "fit.json", AnyRun, "")
        except InputError as error:
            raise InputError(f"{folder}: holds something else than a run; give the name of a new folder") from error
    require_writable(folder)


def write_run(
    folder: Path,
    result: FitResult,
    *,
    site: Site,
    record: DASRecord,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    problem: Problem,
    timings: Mapping[str, float],
    held_out: HeldOut | None = None,
    effects: Sequence[str] = (),
    warnings: Sequence[str] = (),
    disputed: Sequence[str] = (),
) -> Run:
    """Write a run folder, whole or not at all; an earlier run there is replaced. Return the run.

    Parameters
    ----------
    folder : to write; `route.csv`, `route.geojson`, `fit.json`, `report.html` and `data.npz` go there
    result : of the fit
    site, record, passes, anchors : what was read
    problem : as it was fitted
    timings : s of each step, by name
    held_out : misfit of passes that the fit did not see
    effects : names of the effects in the model
    warnings : lines for the user, beside those that `solver.run.report.report_words.cautions` finds
    disputed : sentences on anchors that contradict the others

    Raises
    ------
    InputError
        If `folder` holds something else than a run (see `check_target`).
    """
    check_target(folder)
    facts = facts_of(result, site, record, anchors, problem, timings, held_out, effects, warnings, disputed)
    time = record.time[result.samples]
    run = report.told(Run(result, problem, site.frame, record.start, time, list(passes), list(anchors), facts))
    write_files(folder, run)
    return run


def write_files(folder: Path, run: Run) -> None:
    """Write the files of a run, whole or not at all."""
    result, facts = run.result, run.facts
    with writing(folder) as temporary:
        temporary.mkdir()
        (temporary / "route.csv").write_text(route_table(run), encoding="utf-8")
        features = geojson.route_features(result, run.frame, run.anchors, facts["name"])
        (temporary / "route.geojson").write_text(json.dumps(features, allow_nan=False), encoding="utf-8")
        (temporary / "fit.json").write_text(json.dumps(facts, allow_nan=False, indent=1), encoding="utf-8")
        write_arrays(temporary / "data.npz", run)
        (temporary / "report.html").write_text(report.render(run), encoding="utf-8")


def read_facts(folder: Path) -> dict[str, Any]:
    """Read fit.json of a run folder.

    Raises
    ------
    InputError
        If there is none, or it is not of a run.
    """
    path = Path(folder) / "fit.json"
    mend = "give a folder that `roadfiber locate` wrote"
    if not path.is_file():
        raise InputError(f"{folder}: no run folder (it has no fit.json); {mend}")
    return read_model(path, FitFile, mend).model_dump(mode="json")


def number(value: float | None) -> float:
    """Return a number of fit.json, where null is what is not known."""
    return float("nan") if value is None else float(value)


def read_run(folder: Path, effects: Iterable[Effect] = ()) -> Run:
    """Read a run folder back; no code that lies in it is run.

    Parameters
    ----------
    folder : as `write_run` wrote it
    effects : beyond the built-in ones, that its model may hold; where one is not given, everything but the model can be
        looked at, and evaluating that raises an InputError which says what to give

    Returns
    -------
    run : its result with measured, model and weight in single precision

    Raises
    ------
    InputError
        If it is no run folder, or a part of it is missing or corrupt.
    """
    facts = read_facts(folder)
    path = Path(folder) / "data.npz"
    arrays = read_arrays(path)
    try:
        check_arrays(arrays)
        return assembled(facts, arrays, effects)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: not the arrays of this run ({error}); run `roadfiber locate` again") from error


def assembled(facts: dict[str, Any], arrays: Arrays, effects: Iterable[Effect]) -> Run:
    """The run that a run folder's facts and arrays are of; ValueError where they contradict each other."""
    maps: dict[str, Any] = {name: arrays[name].astype(np.float64) for name in MAPS}
    maps["measured"] = arrays["record"][arrays["samples"]].astype(np.float64)
    maps |= {name: arrays[name] for name in ARRAYS}
    parameters = {
        name: Parameter(number(p["value"]), number(p["sigma"]), p["unit"], p["free"])
        for name, p in facts["parameters"].items()
    }
    scalars = {f.name: facts[f.name] for f in fields(FitResult) if f.name in facts and f.name != "parameters"}
    scalars |= {name: number(facts[name]) for name in ("chi2", "chi2_per_dof", "cost")}
    anchors = [Anchor(**anchor) for anchor in facts["anchors"]]
    problem = problem_from(arrays, facts["problem"], anchors, finder(facts["plugins"], effects))
    check_agreement(problem, arrays, anchors, facts["settings"]["sampling_rate"])
    scalars["law"] = problem.law
    return Run(
        result=FitResult(**maps, **scalars, parameters=parameters),
        problem=problem,
        frame=LocalFrame(tuple(facts["frame"]["origin"]), facts["frame"]["x_azimuth"]),
        start=np.datetime64(facts["start"].removesuffix("Z"), "ns"),
        time=arrays["time"],
        passes=passes_from(arrays),
        anchors=anchors,
        facts=facts,
    )


def open_run(folder: Path, plugins: Sequence[Path], changed: bool = False) -> tuple[Run, Catalogue]:
    """Read a run and the effects that may be put into its model.

    Parameters
    ----------
    folder : of the run
    plugins : files with users' effects
    changed : whether one may be another than the file that the run was made with

    Raises
    ------
    InputError
        If the run or a plugin cannot be read, or a plugin is not the one that the run was made with.
    """
    facts = read_facts(folder)
    known = catalogue(plugins)
    if not changed:
        check_plugins(facts, known.plugin_of)
    return read_run(folder, known.values()), known
