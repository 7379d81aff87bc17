"""Where along the path each leg of the drive puts each channel: the peak of its likelihood, and how sharp it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.drive.likelihood import COUNTED, heard
from solver.drive.quiet import Quiet
from solver.drive.response import Legs, Responses

Array = NDArray[np.float64]

#: Cells to either side of where a channel is expected in which its peak is sought.
SIDE = 14
#: Log likelihood ratio of a leg above which a channel is heard.
AUDIBLE = 4.0
#: Channels to either side of which so many, itself included, hear it too.
NEAR, CONFIRMED = 3, 2
#: Channels that hear the car go either way, from which on a drive checks its clock.
ENOUGH = 5
#: m, standard deviation of the best peak: model errors that no noise tells of.
SHARPEST = 0.25
#: s, of the difference between the speed at which a car is heard and that at which it passes: where it brakes, its
#: smoothed fixes tell its speed less well.
UNEVEN = 0.5


@dataclass(frozen=True)
class Picks:
    """Peaks of the likelihood.

    Parameters
    ----------
    cell, sigma : of the peak, cells; NaN where nothing is heard [leg, channel]
    speed : of the car along the path as it is heard, cells per second [leg, channel]: so a pick moves with the clock
    row : sample at which it passes [leg, channel]
    amplitude : of the response of unit energy, noise sigmas [leg, channel]
    ratio : log likelihood ratio there [leg, channel]
    """

    cell: Array
    sigma: Array
    speed: Array
    row: NDArray[np.int64]
    amplitude: Array
    ratio: Array

    @property
    def audible(self) -> NDArray[np.bool_]:
        """Whether a channel is heard on a leg [leg, channel]."""
        return np.isfinite(self.cell)

    @property
    def both_ways(self) -> bool:
        """Whether enough channels hear the car go either way."""
        ways = (self.audible & (self.speed > 0)).sum(), (self.audible & (self.speed < 0)).sum()
        return bool(min(ways) >= ENOUGH)


def pick(
    quiet: Quiet, of: Responses, legs: Legs, expected: Array, polarity: int, floor: Array, quietly: NDArray[np.bool_]
) -> Picks:
    """Pick the peaks.

    Parameters
    ----------
    expected : cell of each channel [channel]
    floor : least amplitude [channel, leg]
    quietly : channels that are not looked at: dead, or in a loop [channel]
    """
    channels = len(expected)
    shape = (legs.count, channels)
    cell, sigma, speed = (np.full(shape, np.nan) for _ in range(3))
    amplitude, ratio = np.zeros(shape), np.zeros(shape)
    row = np.zeros(shape, np.int64)
    low = np.round(expected).astype(np.int64) - SIDE
    for leg in range(legs.count):
        found = heard(quiet, of, low, 2 * SIDE + 1, polarity, floor, leg)
        top, where = peaks(found.ratio.astype(np.float64))
        ok = (top.ratio > AUDIBLE) & (where > 1) & (where < 2 * SIDE - 1) & ~quietly
        # One that no neighbor confirms is chance.
        ok &= np.convolve(ok, np.ones(2 * NEAR + 1), "same") >= CONFIRMED
        cell[leg, ok] = low[ok] + where[ok]
        # Half of the samples count where vehicles are told apart; of where a peak lies all of them tell.
        sigma[leg, ok] = np.hypot(np.sqrt(COUNTED) * top.width[ok], SHARPEST)
        row[leg], speed[leg] = passing(legs, leg, low + where)
        passes = speed[leg, ok].copy()
        speed[leg, ok] = heard_speed(of, legs, leg, (low + where)[ok], passes)
        sigma[leg, ok] = np.hypot(sigma[leg, ok], UNEVEN * (speed[leg, ok] - passes))
        amplitude[leg] = found.amplitude.max(1)
        ratio[leg] = top.ratio
    return Picks(cell, sigma, speed, row, amplitude, ratio)


@dataclass(frozen=True)
class Top:
    """Peaks [channel]: their largest value, the height of the parabola through it, and their width."""

    ratio: Array
    height: Array
    width: Array


def peaks(ratio: Array) -> tuple[Top, Array]:
    """Peaks of ratios [channel, place]: a parabola through the largest and two to either side."""
    best = ratio.argmax(1)
    middle = np.clip(best, 2, ratio.shape[1] - 3)
    channel = np.arange(len(ratio))
    around = np.stack([ratio[channel, middle + step] for step in range(-2, 3)], -1)
    # Least squares over five neighbors (Savitzky and Golay 1964).
    slope = around @ np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) / 10
    bend = around @ np.array([2.0, -1.0, -2.0, -1.0, 2.0]) / 7
    down = np.maximum(-bend, 1e-3)
    level = around @ np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35
    shift = np.clip(slope / down, -1.5, 1.5)
    height = level + slope * shift - down * shift**2 / 2
    return Top(ratio[channel, best], height, 1 / np.sqrt(down)), middle + shift


def heard_speed(of: Responses, legs: Legs, leg: int, cell: Array, passes: Array) -> Array:
    """Speed of the car on a leg as it is heard at cells [pick], cells per second; as it `passes` where no response is.

    One that brakes, or starts, beside a channel is heard most while it is faster than where it passes: this is the mean
    over the response, weighed by its energy, and by so much a pick moves with the clock.
    """
    found = passes.copy()
    number = np.clip(np.round(cell).astype(np.int64), 0, len(of.begin) - 2)
    for pick, at in enumerate(number):
        energy, way = 0.0, 0.0
        for one in range(of.begin[at], of.begin[at + 1]):
            if of.leg[one] == leg:
                loud = (of.values[:, of.at[one] : of.at[one] + of.size[one]] ** 2).sum(0)
                energy += float(loud.sum())
                way += float(loud @ legs.speed[of.row[one] : of.row[one] + of.size[one]])
        if energy > 0:
            found[pick] = way / energy
    return found


def passing(legs: Legs, leg: int, cell: Array) -> tuple[NDArray[np.int64], Array]:
    """Sample, and speed in cells per second, at which the car passes cells [channel] on a leg."""
    rows = np.flatnonzero(legs.near & (legs.leg == leg))
    if not len(rows):
        return np.zeros(len(cell), np.int64), np.ones(len(cell))
    there = legs.cell[rows].astype(float)
    forth = there[-1] >= there[0]
    sorted_there = np.maximum.accumulate(there if forth else there[::-1])
    index = np.clip(np.searchsorted(sorted_there, cell), 0, len(rows) - 1)
    at = rows[index if forth else len(rows) - 1 - index]
    return at, legs.speed[at]
