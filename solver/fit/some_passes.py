"""A survey with some of its passes only, and passes where no other is near."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.fit.problem import Problem
from solver.fit.stretches import TAIL, around
from solver.signal_path.traffic import Traffic
from solver.trajectory.vehicle_pass import Pass

#: Samples without another vehicle that a pass needs.
ALONE = 10


def alone_samples(passes: Sequence[Pass]) -> list[NDArray[np.bool_]]:
    """At which of its rows each pass [pass][row] is the only vehicle near.

    >>> from types import SimpleNamespace as Some
    >>> [one.tolist() for one in alone_samples([Some(rows=np.array([3, 4])), Some(rows=np.array([4, 5]))])]
    [[True, False], [False, True]]
    """
    count = np.bincount(np.concatenate([one.rows for one in passes]))
    return [count[one.rows] == 1 for one in passes]


def only(problem: Problem, chosen: Sequence[int]) -> Problem:
    """The survey with some of its passes only; where any other vehicle is near, nothing counts as measured."""
    taken = set(chosen)
    passes = [problem.passes[i] for i in sorted(taken)]
    others = [one.rows for i, one in enumerate(problem.passes) if i not in taken]
    record = problem.record.copy()
    if others:
        record[np.unique(np.concatenate(others))] = np.nan
    near = around(passes, len(record), round(TAIL * problem.sampling_rate))
    return replace(problem, record=record, passes=passes, traffic=Traffic.of(passes, near))


def by_itself(problem: Problem, one: Pass, rows: NDArray[np.bool_]) -> Problem:
    """A survey of some rows of a pass and nothing else."""
    parts = {name: getattr(one, name)[rows] for name in ("position", "velocity", "sigma", "in_view")}
    mine = [replace(one, rows=np.arange(rows.sum()), **parts)]
    here = problem.record[one.rows[rows]]
    return replace(problem, record=here, passes=mine, traffic=Traffic.of(mine), windows=())
