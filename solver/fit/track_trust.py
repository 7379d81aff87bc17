"""How far tracks are trusted when models are compared: an error common to all tracks is an effect, not chance."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.fit.problem import Problem
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]

#: What a whole track may be off without being an effect, m; along travel at least, however alike all tracks are.
ALONG, ACROSS, SUREST = 0.3, 0.08, 0.1
#: What tracks may be off along travel over how much they differ from one another.
APART = 1.5
#: Tracks beyond what they may have in common that tell how much they differ.
ENOUGH = 3


def strict_tracks(problem: Problem, along: float = ALONG) -> Problem:
    """The problem with tracks that may be off by `along` in the direction of travel, m.

    Fitted freely, the size of the tracks' errors would absorb any shift of all passes.
    """
    return replace(problem, prior=replace(problem.prior, along=along, across=ACROSS, track_freedom=1e3))


def track_spread(passes: Sequence[Pass], along: Array) -> float:
    """What tracks of `passes` may be off along travel, m, by how much their shifts `along` [pass], m, differ.

    What they have in common by an effect (a bias, a clock, an offset of the camera) is not chance error: a constant, a
    part that grows with the speed and one by direction are taken out first.

    >>> from types import SimpleNamespace
    >>> ways = [SimpleNamespace(velocity=np.array([[v, 0.0]])) for v in (9.0, -12.0, 15.0, -17.0, 11.0, 14.0, -10.0)]
    >>> off = np.array([0.01, -0.02, 0.0, 0.01, -0.01, 0.02, -0.01])
    >>> track_spread(ways, 0.5 + off), track_spread(ways, 30 * off) > 0.2
    (0.1, True)
    """
    velocity = np.array([one.velocity.mean(0) for one in passes])
    speed, way = np.linalg.norm(velocity, axis=1), np.sign(velocity[:, 0])
    common = np.column_stack([np.ones(len(along)), speed, way])
    fitted, _, rank, _ = np.linalg.lstsq(common, along)
    spare = len(along) - int(rank)
    if spare < ENOUGH:
        return ALONG
    return float(np.clip(APART * np.sqrt(((along - common @ fitted) ** 2).sum() / spare), SUREST, ALONG))
