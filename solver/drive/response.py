"""What a channel at each cell of the path records of the car: the signal path's response, whitened like the record."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.drive.car import Car, Driven
from solver.drive.gauge_rate import gauge_rates
from solver.drive.path import BESIDE, STEP, Path
from solver.drive.quiet import Quiet
from solver.load.wheel_layout import layout_of
from solver.trajectory.tracks import turns

Array = NDArray[np.float64]

#: m between car and fiber that are tried, and the depth and Poisson's ratio that are assumed.
ASIDE = (2.0, 4.5, 8.0, 14.0)
DEPTH, POISSON_RATIO = 0.9, 0.25
#: m along the path, beside half a gauge, within which the car is looked at: farther, others drive.
REACH = 10.0
#: m/s below which the car strains nothing that is heard.
SLOW = 0.5
#: m back along the path after which the car is on another leg.
TURN = 40.0
#: Cells at once.
SOME = 4096


@dataclass(frozen=True)
class Clock:
    """The record's clock.

    Parameters
    ----------
    offset : by how much it is ahead of the GPS's in the middle of the record, s
    drift : share of the time that it gains

    >>> Clock(10.0, 0.001).of_car(np.array([0.0, 100.0, 200.0])).tolist()
    [-9.9, 90.0, 189.9]
    """

    offset: float
    drift: float = 0.0

    def of_car(self, time: Array) -> Array:
        """Times of the GPS [time] at times of the record [time], s; both begin with it."""
        return np.asarray(time - self.offset - self.drift * (time - time[-1] / 2))


@dataclass(frozen=True)
class Legs:
    """How the car went, by the record's clock.

    Parameters
    ----------
    driven : where the car was [time]
    cell : of the path that it was next to [time]
    near : whether it moved, beside the path [time]
    leg : number of the leg [time]; the car goes one way on each
    count : of legs
    speed : cells per second, signed, along the path [time]
    rate : samples per second
    """

    driven: Driven
    cell: NDArray[np.int64]
    near: NDArray[np.bool_]
    leg: NDArray[np.int64]
    count: int
    speed: Array
    rate: float


@dataclass(frozen=True)
class Responses:
    """Responses of unit energy, ragged: one segment of rows for each run of samples in reach of a cell.

    Parameters
    ----------
    begin : segments of a cell, CSR [cell + 1]
    row, size, at, leg : first sample, samples, first value and leg of each segment [segment]
    values : [aside, value], single precision
    norm : of the responses of a segment's leg, at its cell, before they were scaled [aside, segment]
    """

    begin: NDArray[np.int64]
    row: NDArray[np.int64]
    size: NDArray[np.int64]
    at: NDArray[np.int64]
    leg: NDArray[np.int64]
    values: NDArray[np.float32]
    norm: Array

    @property
    def strength(self) -> Array:
        """How strong the response of each segment's leg is at its cell, over what is usual [segment]."""
        middle = self.norm[len(self.norm) // 3]
        return np.asarray(np.maximum(middle / np.median(middle), 0.02)) if len(middle) else middle


def legs_of(quiet: Quiet, path: Path, car: Car, clock: Clock) -> Legs:
    """Where the car was at each sample of the record."""
    driven = car.at(clock.of_car(quiet.time))
    cell, far = path.nearest(driven.position)
    near = driven.known & (far < BESIDE) & (driven.speed > SLOW)
    leg = np.zeros(len(cell), np.int64)
    rows = np.flatnonzero(near)
    if len(rows):
        there = cell[rows].astype(float)
        cuts = turns(there, TURN / STEP)
        leg[rows] = np.searchsorted(np.array(cuts, float), np.arange(len(rows)), side="right")
    along = (driven.velocity * path.along[cell]).sum(1) / STEP
    return Legs(driven, cell, near, leg, int(leg.max(initial=0)) + 1, along, quiet.rate)


def segments_of(
    legs: Legs, cells: int, reach: float, wanted: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Segments of the wanted cells: CSR [cell + 1], and (first row, one after last, leg) [segment, 3]."""
    rows = np.flatnonzero(legs.near)
    order = rows[np.argsort(legs.cell[rows], kind="stable")]
    sorted_cells = legs.cell[order]
    low = np.searchsorted(sorted_cells, np.arange(cells) - reach / STEP)
    high = np.searchsorted(sorted_cells, np.arange(cells) + reach / STEP, side="right")
    count = np.where(wanted, np.maximum(high - low, 0), 0)
    cell = np.repeat(np.arange(cells), count)
    row = order[np.arange(len(cell)) + np.repeat(low - np.cumsum(count) + count, count)]
    row = row[np.lexsort((row, cell))]
    ends = (np.diff(row) != 1) | (np.diff(cell) != 0) | (np.diff(legs.leg[row]) != 0)
    begins = np.concatenate([np.ones(min(len(row), 1), bool), ends])
    first, last = row[begins], row[np.roll(begins, -1)] + 1
    begin = np.concatenate([[0], np.cumsum(np.bincount(cell[begins], minlength=cells))])
    return begin, np.stack([first, last, legs.leg[first]], -1)


def responses(
    quiet: Quiet,
    path: Path,
    car: Car,
    legs: Legs,
    aside: tuple[float, ...] = ASIDE,
    wanted: NDArray[np.bool_] | None = None,
    depth: float = DEPTH,
    reach: float | None = None,
) -> Responses:
    """Responses of the wanted cells of a path [cell], or of all.

    The fiber is taken to run along the path, moved sideways so that the car goes by at each distance of `aside`. It is
    looked at within `reach` m along the path; within `REACH` and half a gauge if None.
    """
    cells = len(path.points)
    asked = np.ones(cells, bool) if wanted is None else wanted
    begin, segment = segments_of(legs, cells, REACH + quiet.gauge_length / 2 if reach is None else reach, asked)
    lag = len(quiet.whitener) - 1
    segment[:, 0] = np.maximum(segment[:, 0], lag)
    size = np.maximum(segment[:, 1] - segment[:, 0], 0)
    at = np.concatenate([[0], np.cumsum(size)])
    values = np.zeros((len(aside), int(at[-1])), np.float32)
    norm = np.ones((len(aside), len(segment)))
    cell_of = np.repeat(np.arange(cells), np.diff(begin))
    for first in range(0, cells, SOME):
        part = slice(int(begin[first]), int(begin[min(first + SOME, cells)]))
        if part.stop > part.start:
            some = slice(int(at[part.start]), int(at[part.stop]))
            values[:, some], norm[:, part] = some_responses(
                quiet, path, car, legs, cell_of[part], segment[part, 0], size[part], segment[part, 2], aside, depth
            )
    return Responses(begin, segment[:, 0], size, at[:-1], segment[:, 2], values, norm)


def some_responses(
    quiet: Quiet,
    path: Path,
    car: Car,
    legs: Legs,
    cell: NDArray[np.int64],
    row: NDArray[np.int64],
    size: NDArray[np.int64],
    leg: NDArray[np.int64],
    aside: tuple[float, ...],
    depth: float,
) -> tuple[NDArray[np.float32], Array]:
    """Responses [aside, value] of some segments, scaled to unit energy for each cell and leg, and their norms."""
    taps = quiet.whitener
    lag = len(taps) - 1
    long = size + lag
    which = np.repeat(np.arange(len(size)), long)
    start = np.concatenate([[0], np.cumsum(long)[:-1]])
    inside = np.arange(len(which)) - start[which]
    sample = row[which] - lag + inside
    lateral = passing_side(path, legs, cell, row, size)
    group = np.unique(np.stack([cell, leg]), axis=1, return_inverse=True)[1].reshape(-1)
    kept = inside >= lag
    found, norms = [], []
    for far in aside:
        shift = lateral - np.where(lateral >= 0, 1.0, -1.0) * far
        raw = strain_rate(quiet, path, car, legs, cell[which], shift[which], sample, depth)
        white = sum(tap * np.roll(raw, number) for number, tap in enumerate(taps))[kept]
        energy = np.bincount(group[which[kept]], white**2, minlength=group.max() + 1)
        scale = np.sqrt(np.maximum(energy, 1e-30))[group]
        found.append((white / scale[which[kept]]).astype(np.float32))
        norms.append(scale)
    return np.stack(found), np.stack(norms)


def passing_side(
    path: Path, legs: Legs, cell: NDArray[np.int64], row: NDArray[np.int64], size: NDArray[np.int64]
) -> Array:
    """How far to the right of each segment's cell the car goes by, m [segment]."""
    middle = row + size // 2
    # The sample of the segment at which the car is next to the cell: it moves about evenly through the segment.
    for _ in range(3):
        ahead = cell - legs.cell[middle]
        speed = legs.speed[middle]
        step = np.where(np.abs(speed) > 0.3, ahead / np.where(np.abs(speed) > 0.3, speed, 1.0), 0.0)
        middle = np.clip(middle + np.round(step * legs.rate).astype(np.int64), row, row + np.maximum(size - 1, 0))
    off = legs.driven.position[middle] - path.points[cell]
    return np.asarray((off * path.across[cell]).sum(1))


def strain_rate(
    quiet: Quiet,
    path: Path,
    car: Car,
    legs: Legs,
    cell: NDArray[np.int64],
    shift: Array,
    sample: NDArray[np.int64],
    depth: float,
) -> Array:
    """Strain rate [value], per F / (4 pi G) in m^2, of a gauge at a cell, moved to the right, at a sample."""
    half = quiet.gauge_length / 2 / STEP
    layout = layout_of(car.vehicle_class)
    axles = ((layout.wheelbase / 2, layout.front_share), (-layout.wheelbase / 2, 1 - layout.front_share))
    driven, total = legs.driven, np.empty(len(sample))
    gauge_rates()(
        cell,
        sample,
        shift,
        path.points,
        path.along,
        path.across,
        driven.position,
        driven.velocity,
        np.array([round(half), -round(half)]),
        np.array([1, -1]) * (half - round(half)) * STEP,
        np.array(axles if layout.wheelbase else ((0.0, 1.0),)),
        depth,
        1 - 2 * POISSON_RATIO,
        total,
    )
    return total / quiet.gauge_length
