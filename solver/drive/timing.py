"""What the shape of what channels hear says of the clock, whatever their places.

A clock that is off puts the car's stops, its braking and its speed at the wrong times: responses then fit less well at
any place. Picks tell the clock by their places; the heights of their peaks tell it beside that.
"""

import numpy as np
from numpy.typing import NDArray

from solver.drive.along import SLOW
from solver.drive.aside import COUNTED
from solver.drive.car import Car
from solver.drive.likelihood import heard
from solver.drive.path import STEP, Path
from solver.drive.picks import Picks, peaks
from solver.drive.quiet import Quiet
from solver.drive.response import Clock, Legs, legs_of, responses

Array = NDArray[np.float64]

#: s to either side of a clock that are weighed, and between two of them.
WINDOW, BETWEEN = 1.2, 0.2
#: Cells to either side of a pick, moved with the clock, in which its peak is sought.
SIDE = 10
#: Channels that are asked at most.
ASKED = 400


def clock_of_shapes(
    quiet: Quiet, path: Path, car: Car, legs: Legs, clock: Clock, picks: Picks, polarity: int, floor: Array
) -> tuple[float, float]:
    """By how much a clock is off, and the standard deviation of that, s.

    Parameters
    ----------
    legs, picks : of that clock
    polarity, floor : as of `solver.drive.likelihood.heard`

    Each offset d weighs exp(`COUNTED` times the sum of all peaks with it), as errors of ground and depth are common to
    neighbors. A slow error of the GPS moves the car's stops, too: the standard deviation has it, over the car's speed.
    """
    audible = picks.audible[: legs.count]
    channel = np.flatnonzero(audible.any(0))
    if not len(channel):
        return 0.0, np.inf
    asked = np.zeros(audible.shape[1], bool)
    asked[channel[np.linspace(0, len(channel) - 1, min(ASKED, len(channel))).astype(np.int64)]] = True
    audible = audible & asked
    offset = np.arange(-round(WINDOW / BETWEEN), round(WINDOW / BETWEEN) + 1) * BETWEEN
    found = [
        heights(quiet, path, car, Clock(clock.offset + d, clock.drift), d, picks, audible, polarity, floor)
        for d in offset
    ]
    log = np.array([one.sum() if len(one) else -np.inf for one in found]) * COUNTED
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = float(weight @ offset)
    slow = SLOW * car.sigma / STEP / float(np.median(np.abs(picks.speed[: legs.count][audible])))
    return mean, float(np.sqrt(weight @ (offset - mean) ** 2 + BETWEEN**2 / 12 + slow**2))


def heights(
    quiet: Quiet,
    path: Path,
    car: Car,
    clock: Clock,
    moved: float,
    picks: Picks,
    audible: NDArray[np.bool_],
    polarity: int,
    floor: Array,
) -> Array:
    """Log likelihood ratios of `audible` picks [leg, channel] at a clock `moved` by s; none with other legs."""
    legs = legs_of(quiet, path, car, clock)
    if legs.count != len(audible):
        return np.zeros(0)
    width, count = 2 * SIDE + 1, len(path.points)
    # A clock that is ahead by more has the car behind by more.
    cell = np.where(audible, picks.cell[: legs.count] - moved * picks.speed[: legs.count], -2 * width)
    low = np.round(cell).astype(np.int64) - SIDE
    cells = (low[audible][:, None] + np.arange(width)).ravel()
    wanted = np.zeros(count, bool)
    wanted[cells[(cells >= 0) & (cells < count)]] = True
    of = responses(quiet, path, car, legs, wanted=wanted)
    found = []
    for leg in range(legs.count):
        one = heard(quiet, of, low[leg], width, polarity, floor, leg)
        found.append(peaks(one.ratio[audible[leg]].astype(np.float64))[0].height)
    return np.concatenate(found)
