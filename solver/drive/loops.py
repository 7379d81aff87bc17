"""Loops of slack: runs of channels between which the path does not go on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.drive.along import Along
from solver.drive.channel_map import ChannelMap
from solver.drive.path import STEP

Array = NDArray[np.float64]

#: Channels between two runs that are one loop: at the manhole some of a loop's channels hear the car.
APART = 2
#: Probability that a loop has at least: where the map cuts a street corner, picks lie closer together than the channels
#: do, which looks like slack of a gauge.
SURE = 0.9
#: m of cable before and after a loop of which this share hears the car: elsewhere nothing tells a loop from quiet.
BESIDE, HEARD = 60.0, 0.2
#: Standard deviations by which its length is above zero at least.
CLEAR = 3.0


@dataclass(frozen=True)
class Loop:
    """A loop.

    Parameters
    ----------
    first, last : channels in it, as indices
    place : of the manhole, cells along the path
    length : of cable in it, m, and its standard deviation `sigma`
    probability : that there is one
    """

    first: int
    last: int
    place: float
    length: float
    sigma: float
    probability: float


def runs_of(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of true flags, runs at most `APART` apart joined.

    >>> runs_of(np.array([False, True, True, False, True, False, False, False, True]))
    [(1, 4), (8, 8)]
    """
    there = np.flatnonzero(flags)
    if not len(there):
        return []
    cuts = np.flatnonzero(np.diff(there) > APART + 1)
    return [(int(one[0]), int(one[-1])) for one in np.split(there, cuts + 1)]


def sure(channels: ChannelMap) -> NDArray[np.bool_]:
    """Which channels lie in loops that are likely to be just there [channel]."""
    found = np.zeros(len(channels.loop), bool)
    for first, last in runs_of(channels.loop):
        found[first : last + 1] = channels.in_loop[first : last + 1].max() > SURE
    return found


def loops_of(
    channels: ChannelMap,
    along: Along,
    spacing: float,
    factor: float,
    gauge_length: float,
) -> list[Loop]:
    """Loops longer than a gauge, those among quiet channels too.

    Parameters
    ----------
    channels : the posterior of the channel map
    along : positions of the channels
    spacing, gauge_length : m
    factor : meters of cable per meter of path
    """
    found, cell, sigma = [], along.cell, along.sigma
    for first, last in runs_of(channels.loop):
        if first == 0 or last == len(cell) - 1:
            continue
        gone = (cell[last + 1] - cell[first - 1]) * STEP * factor
        length = (last - first + 2) * spacing - gone
        # Neighbors share most of their error; what is left is from where the loop begins and ends.
        spread = float(np.hypot(0.2 * spacing, 0.5 * np.hypot(sigma[first - 1], sigma[last + 1]) * STEP))
        probability = float(channels.in_loop[first : last + 1].max())
        if length > max(gauge_length, CLEAR * spread) and probability > SURE:
            place = float(np.median(cell[first : last + 1]))
            found.append(Loop(first, last, place, float(length), spread, probability))
    return found


def flags_of(loops: list[Loop], channels: int) -> NDArray[np.bool_]:
    """Which channels lie in loops [channel]."""
    found = np.zeros(channels, bool)
    for one in loops:
        found[one.first : one.last + 1] = True
    return found


def confirmed(loops: list[Loop], audible: NDArray[np.bool_], spacing: float) -> list[Loop]:
    """Loops with cable that hears the car just before and after them: among quiet channels nothing tells a loop."""
    reach = int(np.ceil(BESIDE / spacing)) + 1

    def held(one: Loop) -> bool:
        before = audible[max(0, one.first - reach) : one.first]
        after = audible[one.last + 1 : one.last + 1 + reach]
        return bool(min(before.sum(), after.sum()) >= HEARD * reach)

    return [one for one in loops if held(one)]
