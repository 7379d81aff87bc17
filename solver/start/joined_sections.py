"""Routes of sections, joined to those of a whole road: on which side each lies, and one route through all."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.start.sections import Found

Array = NDArray[np.float64]

#: Meters that the routes of neighboring sections may be apart per standard deviation.
JUMP = 0.5


def sides_of(found: Sequence[Found]) -> tuple[list[Array], list[Array], float]:
    """Laterals of each section by the side that fits all best, those of the other side, and the evidence between them.

    Sections that overlap must agree: the path of least cost through their two sides (dynamic program).
    """
    both = [(one.rough.lateral, one.rough.mirror) for one in found]
    cost = np.array([[0.0, one.rough.side_evidence] for one in found])
    total, back = cost[:1].copy(), []
    for number in range(1, len(found)):
        jump = np.array(
            [[apart(found[number - 1], a, found[number], b) for b in both[number]] for a in both[number - 1]]
        )
        sums = total[-1][:, None] + jump / JUMP
        back.append(sums.argmin(0))
        total = np.vstack([total, sums.min(0) + cost[number]])
    path = [int(total[-1].argmin())]
    for step in back[::-1]:
        path.append(int(step[path[-1]]))
    path = path[::-1]
    chosen = sum(float(row[side]) for row, side in zip(cost, path, strict=True))
    other = sum(float(row[1 - side]) for row, side in zip(cost, path, strict=True))
    laterals = [pair[side] for pair, side in zip(both, path, strict=True)]
    return laterals, [pair[1 - side] for pair, side in zip(both, path, strict=True)], other - chosen


def apart(one: Found, lateral: Array, other: Found, other_lateral: Array) -> float:
    """Mean distance of two sections' routes on the channels that both have, m; 0 where there is none."""
    _, here, there = np.intersect1d(one.rough.channel, other.rough.channel, return_indices=True)
    if not len(here):
        return 0.0
    gap = one.route(lateral)[here, :2] - other.route(other_lateral)[there, :2]
    return float(np.linalg.norm(gap, axis=1).mean())


def joined(found: Sequence[Found], laterals: Sequence[Array]) -> tuple[NDArray[np.int64], Array]:
    """Channels of all sections [channel], and the route [channel, 3] through them, blended where they overlap."""
    channel = np.unique(np.concatenate([one.rough.channel for one in found]))
    total, weight = np.zeros((len(channel), 3)), np.zeros(len(channel))
    for one, lateral in zip(found, laterals, strict=True):
        at = np.searchsorted(channel, one.rough.channel)
        count = len(at)
        share = np.minimum(np.arange(count) + 1, np.arange(count)[::-1] + 1).astype(float)
        total[at] += share[:, None] * one.route(lateral)
        weight[at] += share
    return channel, total / weight[:, None]
