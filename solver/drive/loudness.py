"""How loud the car is on each channel and leg, from what is heard near where it is expected.

The car weighs the same all along: its loudness changes from channel to channel with the ground, slowly along a leg with
how far beside the fiber it drives, and from leg to leg with the lane. A stretch that is louder than that is likelier
another vehicle than the car, however many channels agree, since one vehicle's weight is one number.
"""

import numpy as np
from numpy.typing import NDArray

from solver.drive.likelihood import LEAST, Usual, heard
from solver.drive.picks import AUDIBLE
from solver.drive.quiet import Quiet
from solver.drive.response import Legs, Responses

Array = NDArray[np.float64]

#: Cells to either side in which the car's loudness is looked for.
LOOKED = 25
#: Channels to either side over which an amplitude is typical, and of how many it is known where that is a limit.
NEIGHBORS, KNOWN = 40, 27
#: Standard deviations of the car's log amplitude, at least: from channel to channel, along a leg, and of legs.
SCATTER, ALONG, LEGS = 0.4, 0.35, 0.6
#: The same of any vehicle, and the probability that a stretch hears another one.
ANY, OTHERS = 1.0, 0.05
#: Channels of which a leg's, or a stretch's, loudness is known.
ENOUGH = 8
#: Of a normal distribution, over the median of sizes.
MAD = 1.4826


def loudness(quiet: Quiet, of: Responses, legs: Legs, expected: Array, polarity: int) -> tuple[Array, Usual]:
    """Least amplitude [channel, leg] of the car on a channel, 0 where nothing is known, and what is usual of it."""
    nothing = np.zeros((len(quiet.channel), legs.count))
    low = np.round(expected).astype(np.int64) - LOOKED
    loud = np.full(nothing.shape, np.nan)
    for leg in range(legs.count):
        one = heard(quiet, of, low, 2 * LOOKED + 1, polarity, nothing, leg)
        best = one.ratio.argmax(1)
        known = (one.ratio.max(1) >= AUDIBLE) & ~quiet.dead
        loud[known, leg] = one.amplitude[np.arange(len(best)), best][known]
    floor = np.stack([LEAST * typical(one, KNOWN) for one in loud.T], -1)
    return floor, usual_of(np.log(loud))


def usual_of(loud: Array) -> Usual:
    """What is usual of the car, from log amplitudes of what is heard [channel, leg], NaN where nothing is.

    From the median of all each leg departs, and each stretch from its leg, unless by so much that another vehicle is
    likelier there. Channels and stretches that differ more than is usual, as of a cable that is laid unevenly, make the
    drive's own standard deviations larger.

    >>> heard = np.log(np.where(np.arange(200) // 20 == 3, 30.0, 6.0))[:, None]
    >>> usual_of(heard).amplitude[[0, 70, 199], 0].round(1).tolist()
    [6.0, 6.0, 6.0]
    """
    level = np.full(loud.shape, np.nan)
    if np.isfinite(loud).sum() < ENOUGH:
        return Usual(np.zeros(loud.shape), SCATTER)
    level[:] = np.nanmedian(loud)
    for leg, one in enumerate(loud.T):
        known = np.isfinite(one)
        if known.sum() >= ENOUGH:
            level[:, leg] += departure(np.median(one[known] - level[known, leg]), LEGS)
            near = typical(one - level[:, leg], ENOUGH)
            sigma = max(ALONG, MAD * float(np.median(np.abs(near))))
            level[:, leg] += departure(near, sigma)
    return Usual(np.exp(level), max(SCATTER, MAD * float(np.nanmedian(np.abs(loud - level)))))


def typical(values: Array, enough: int) -> Array:
    """Median of neighbors [channel], NaN left out; 0 where not enough of them are numbers."""
    known, found = np.flatnonzero(np.isfinite(values)), np.zeros(len(values))
    number = np.arange(len(values))
    first, last = (np.searchsorted(known, number + side * (NEIGHBORS + 0.5)) for side in (-1, 1))
    for channel in np.flatnonzero(last - first >= enough):
        found[channel] = np.median(values[known[first[channel] : last[channel]]])
    return found


def departure(off: Array | float, sigma: float) -> Array:
    """What of departures is the car's: all of one that is small, nothing of one that others have more probably.

    >>> departure(np.array([0.2, 0.5, 0.8, 1.2]), 0.25).round(2).tolist()
    [0.2, 0.46, 0.31, 0.0]
    """
    car = (1 - OTHERS) / sigma * np.exp(-0.5 * (np.asarray(off) / sigma) ** 2)
    other = OTHERS / ANY * np.exp(-0.5 * (np.asarray(off) / ANY) ** 2)
    return np.asarray(off * car / (car + other))
