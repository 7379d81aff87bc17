"""The regular time grid of the samples of many DAS files, known before any sample is read."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.block import Block
from solver.survey.das.values import measured_runs
from vision.contract import InputError

Array = NDArray[np.float64]

# ns; a vehicle at 30 m/s moves 6 cm in this time. Files that are off the common grid by less are not shifted.
ALIGNED = 2_000_000
SPARSEST = 20  # a record that spans more than this many times its samples is not of one survey
#: Samples on either side that influence a cubic spline; those beyond do so by less than 1e-11.
FELT = 20


@dataclass(frozen=True)
class Part:
    """A file's block, with its times as runs of even spacing between jumps.

    Parameters
    ----------
    block : without times
    interval : of sampling, ns
    runs : (first row, rows, time of the first in ns since 1970) of each stretch without a jump
    """

    block: Block
    interval: float
    runs: tuple[tuple[int, int, int], ...]


def part_of(block: Block) -> Part:
    """Summarize the times of a block as runs.

    Raises
    ------
    InputError
        If they repeat or run backwards, or there is only one.
    """
    interval = file_interval(block)
    cuts = [0, *(np.flatnonzero(np.diff(block.time) > 1.5 * interval) + 1).tolist(), len(block.time)]
    runs = tuple((first, stop - first, int(block.time[first])) for first, stop in pairwise(cuts))
    # A view of no samples would hold all of them.
    return Part(replace(block, time=np.empty(0, np.int64)), interval, runs)


@dataclass(frozen=True)
class Placed:
    """Consecutive samples of one file on the grid.

    Parameters
    ----------
    block : of the file
    first, count : their first row in the block, and how many there are
    row, rows : first row of the grid that they fill, and how many rows
    ahead : rows by which the grid's first row is later than their first; 0 if they lie on the grid
    """

    block: Block
    first: int
    count: int
    row: int
    rows: int
    ahead: float

    @property
    def stop(self) -> int:
        """Row of the grid after the last."""
        return self.row + self.rows

    def values(self, begin: int, end: int, columns: slice) -> NDArray[Any]:
        """Stored numbers [row, column] at rows `begin` to `end` of the grid.

        Numbers that are off the grid by more than `ALIGNED` are interpolated onto it by a cubic spline; beside one that
        is not finite they are NaN.
        """
        if not self.ahead:
            offset = self.first - self.row
            return self.block.data[begin + offset : end + offset, columns]
        from scipy.interpolate import CubicSpline

        wanted = np.arange(begin, end) - self.row + self.ahead
        low, high = max(0, int(wanted[0]) - FELT), min(self.count, int(wanted[-1]) + FELT + 2)
        stored = self.block.data[self.first + low : self.first + high, columns].astype(np.float64)
        moved = np.full((len(wanted), stored.shape[1]), np.nan)
        for run in measured_runs(stored):
            inside = (wanted >= low + run.start) & (wanted <= low + run.stop - 1)
            if run.stop - run.start < 2 or not inside.any():
                continue
            for some in range(0, stored.shape[1], 64):
                part = slice(some, some + 64)
                at, told = np.arange(run.start, run.stop) + low, np.isfinite(stored[run, part])
                for column in np.flatnonzero(~told.all(0)):
                    there, numbers = told[:, column], stored[run, some + column]
                    numbers[~there] = np.interp(at[~there], at[there], numbers[there]) if there.any() else 0.0
                before = np.minimum(wanted[inside].astype(int), at[-1] - 1) - at[0]
                spline = CubicSpline(at, stored[run, part], axis=0)(wanted[inside])
                moved[inside, part] = np.where(told[before] & told[before + 1], spline, np.nan)
        return moved


def on_grid(parts: Sequence[Part], interval: float) -> list[Placed]:
    """Place the runs of parts, sorted by time, on a grid of `interval`, ns, that starts with the first; by row."""
    origin, found = parts[0].runs[0][2], []
    for block, first, count, start in ((part.block, *run) for part in parts for run in part.runs):
        position = (start - origin) / interval
        row, rows, ahead = round(position), count, 0.0
        if abs(position - row) * interval > ALIGNED and count > 1:
            row = int(np.ceil(position))
            rows, ahead = int(np.floor(position + count - 1)) + 1 - row, row - position
        found.append(Placed(block, first, count, row, rows, ahead))
    return sorted(found, key=lambda one: one.row)


def file_interval(block: Block) -> float:
    """Return the sampling interval of a file, ns."""
    steps = np.diff(block.time)
    if not len(steps):
        raise InputError(f"{block.path}: holds a single sample, whose rate nothing tells; leave this file out")
    if steps.min() <= 0:
        sample = int((steps <= 0).argmax()) + 1
        what = "repeat" if steps[sample - 1] == 0 else "run backwards"
        at = np.datetime64(int(block.time[sample]), "ns").astype("datetime64[ms]")
        raise InputError(f"{block.path}: its times {what} at sample {sample} ({at}Z); export the recording again")
    usual = float(np.median(steps))
    return float(steps.mean()) if steps.max() < 1.5 * usual else usual


def sampling_interval(parts: Sequence[Part]) -> float:
    """Return the sampling interval of a record, ns, from parts sorted by time.

    The start times of adjoining files give it more exactly than the nominal rate in one file: with a clock that is off
    by 1e-5, times at 500 Hz are off by a sample after 200 s.
    """
    interval = float(np.median([part.interval for part in parts]))
    lengths = np.array([ends_of(part)[1] for part in parts[:-1]])
    steps = np.diff([ends_of(part)[0] for part in parts])
    adjoining = np.abs(steps - lengths * interval) < interval / 2
    return float(steps[adjoining].sum() / lengths[adjoining].sum()) if adjoining.any() else interval


def ends_of(part: Part) -> tuple[int, float]:
    """Time of a part's first sample, ns, and the number of samples from there to the first one after the part."""
    start, (_, count, last) = part.runs[0][2], part.runs[-1]
    return start, (last - start) / part.interval + count


def merged(rows: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Stretches of rows (first, last), in order, those that touch as one.

    >>> merged([(7, 9), (0, 2), (3, 5), (8, 11)])
    [(0, 5), (7, 11)]
    """
    found: list[tuple[int, int]] = []
    for first, last in sorted(rows):
        if found and first <= found[-1][1] + 1:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        else:
            found.append((first, last))
    return found


@dataclass(frozen=True)
class Grid:
    """The time grid of a record: evenly spaced rows, and which rows of which file fill them.

    Parameters
    ----------
    origin : time of row 0, ns since 1970, UTC
    interval : of sampling, ns
    placed : sorted by row, without overlaps
    """

    origin: int
    interval: float
    placed: tuple[Placed, ...]

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return 1e9 / self.interval

    @property
    def rows(self) -> int:
        """Rows from the first to the last sample, gaps included."""
        return self.placed[-1].stop

    @cached_property
    def holes(self) -> list[tuple[int, int]]:
        """First and last row of each gap."""
        return [(one.stop, other.row - 1) for one, other in pairwise(self.placed) if other.row > one.stop]

    def without(self, lost: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
        """First and last row of each gap, with those of other stretches in which nothing was measured."""
        return merged([*self.holes, *lost])

    def measured(self, begin: int, end: int) -> int:
        """Count of the rows `begin` to `end` that have samples."""
        return sum(max(0, min(one.stop, end) - max(one.row, begin)) for one in self.placed)

    def time_of(self, row: int) -> np.datetime64:
        """UTC of a row."""
        return np.datetime64(self.origin + round(row * self.interval), "ns")

    def check_dense(self, spans: Sequence[tuple[int, int]]) -> None:
        """Raise InputError if nearly all of the rows of spans (first, one after the last) are gaps."""
        measured = sum(self.measured(*span) for span in spans)
        if sum(end - begin for begin, end in spans) > SPARSEST * measured:
            raise InputError(
                f"{self.placed[-1].block.path}: {measured * self.interval * 1e-9:.0f} s of samples spread over "
                f"{(spans[-1][1] - spans[0][0]) * self.interval * 1e-9 / 3600:.1f} h; locate each part on its own"
            )
