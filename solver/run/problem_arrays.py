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
from solver.noise.law import NoiseLaw
from solver.run.arrays import Arrays
from solver.run.pass_arrays import pass_arrays, passes_from
from solver.run.read_seen import law_from
from solver.signal_path.traffic import Traffic
from solver.survey.anchors import Anchor

SCALARS = (
    *("recorded", "zero_distance", "channel_spacing", "gauge_length", "sampling_rate"),
    *("curved", "signal_noise", "knots"),
)


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
        | {"coil": problem.coil and asdict(problem.coil), "windows": [list(one) for one in problem.windows]}
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
        record=arrays["record"],
        noise=torch.from_numpy(arrays["noise"]),
        channel=arrays["fitted_channel"],
        passes=passes,
        traffic=Traffic.of(passes, arrays["samples"]),
        anchors=anchors,
        start=arrays["start"],
        prior=Prior(**known),
        law=law_from(arrays),
        effects=tuple(look_up(name) for name in facts["added"]),
        coil=facts["coil"] and Coil(**facts["coil"]),
        windows=tuple((row, time) for row, time in facts["windows"]),
        **{name: facts[name] for name in SCALARS} | {"knots": tuple(facts["knots"])},
    )
