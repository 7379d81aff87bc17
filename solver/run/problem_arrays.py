"""The fitting problem of a run as arrays and facts, so that later commands can fit it again."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from solver.cable.fiber import Coil
from solver.effect import Effect
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.noise.whitening import NoiseLaw
from solver.run.arrays import Arrays
from solver.signal_path.traffic import Traffic
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass

ROWS = ("rows", "position", "velocity", "sigma", "in_view")
SCALARS = (
    *("recorded", "zero_distance", "channel_spacing", "gauge_length", "sampling_rate"),
    *("curved", "signal_noise", "knot_spacing"),
)


def pass_arrays(passes: Sequence[Pass], prefix: str = "pass") -> dict[str, NDArray[Any]]:
    """Return passes as arrays, rows of all passes one after the other."""
    stacked = {f"{prefix}_{name}": np.concatenate([getattr(p, name) for p in passes]) for name in ROWS}
    return stacked | {
        f"{prefix}_count": np.array([len(p.rows) for p in passes]),
        f"{prefix}_track_id": np.array([p.track_id for p in passes]),
        f"{prefix}_class": np.array([p.vehicle_class for p in passes]),
        f"{prefix}_length": np.array([np.nan if p.length is None else p.length for p in passes]),
        f"{prefix}_offset": np.array([one.offset for one in passes]),
        f"{prefix}_wheelbase": np.array([p.wheelbase or (np.nan, np.nan) for p in passes]).reshape(-1, 2),
    }


def passes_from(arrays: Arrays, prefix: str = "pass") -> list[Pass]:
    """Undo `pass_arrays`."""
    cuts = np.cumsum(arrays[f"{prefix}_count"])[:-1]
    columns = [np.split(arrays[f"{prefix}_{name}"], cuts) for name in ROWS]
    lengths = [None if np.isnan(value) else float(value) for value in arrays[f"{prefix}_length"]]
    names, classes = arrays[f"{prefix}_track_id"].tolist(), arrays[f"{prefix}_class"].tolist()
    wheelbases = [None if np.isnan(mean) else (mean, sd) for mean, sd in arrays[f"{prefix}_wheelbase"].tolist()]
    offsets = arrays[f"{prefix}_offset"].tolist()
    return [Pass(*parts) for parts in zip(names, classes, *columns, lengths, wheelbases, offsets, strict=True)]


def problem_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """Return what of a problem are arrays; the record in single precision, 1e-7 of its value."""
    law = {f"law_{f.name}": getattr(problem.law, f.name) for f in fields(NoiseLaw)}
    fitted = pass_arrays(problem.passes, "fitted_pass")
    return law | fitted | {"record": problem.record.astype(np.float32), "start": problem.start}


def problem_facts(problem: Problem) -> dict[str, Any]:
    """Return what of a problem are numbers and names."""
    scalars = {name: getattr(problem, name) for name in SCALARS}
    return (
        scalars
        | {"prior": asdict(problem.prior), "added": [one.name for one in problem.effects]}
        | {"coil": problem.coil and asdict(problem.coil)}
    )


def problem_from(
    arrays: Arrays, facts: Mapping[str, Any], anchors: Sequence[Anchor], look_up: Callable[[str], Effect]
) -> Problem:
    """Undo `problem_arrays` and `problem_facts`.

    Parameters
    ----------
    arrays : with the run's `noise`, `fitted_channel` and `samples` too
    facts : as `problem_facts` gave them
    look_up : effect by its name
    """
    passes = passes_from(arrays, "fitted_pass")
    known: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in facts["prior"].items()
    }
    return Problem(
        record=arrays["record"].astype(np.float64),
        noise=torch.from_numpy(arrays["noise"]),
        channel=arrays["fitted_channel"],
        passes=passes,
        traffic=Traffic.of(passes, arrays["samples"]),
        anchors=anchors,
        start=arrays["start"],
        prior=Prior(**known),
        law=NoiseLaw(**{f.name: arrays[f"law_{f.name}"] for f in fields(NoiseLaw)}),
        effects=tuple(look_up(name) for name in facts["added"]),
        coil=facts["coil"] and Coil(**facts["coil"]),
        **{name: facts[name] for name in SCALARS},
    )
