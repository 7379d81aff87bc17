"""Statistics of all numbers of a record, collected slab by slab while it is read."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.values import CLIPPED, CLIPPED_CHANNELS, clipped_line

Integers = NDArray[np.int64]


@dataclass
class End:
    """The largest number (`sign` 1) or the smallest (-1), how often each channel holds it, and how often the next one.

    Numbers are multiplied by `sign`, so that the code seeks the largest.
    """

    sign: int
    extreme: float = -np.inf
    count: Integers | None = None
    next: float = -np.inf
    next_count: int = 0

    def look(self, values: NDArray[Any], largest: NDArray[Any]) -> None:
        """Take in values [time, channel], of which `largest` is each channel's largest (smallest)."""
        top = float(np.max(self.sign * largest))
        if self.count is None:
            self.count = np.zeros(values.shape[1], np.int64)
        if top > self.extreme:
            self.next, self.next_count = self.extreme, int(self.count.sum())
            self.extreme, self.count = top, np.zeros(values.shape[1], np.int64)
        # Only channels that reach the second largest number are examined.
        others = self.sign * largest[self.sign * largest < self.extreme]
        least = max(self.next, float(others.max(initial=-np.inf)), -np.finfo(float).max)
        near = np.flatnonzero(self.sign * largest >= least)
        if not len(near):
            return
        some = self.sign * values[:, near].astype(np.float64)
        at_end = some == self.extreme
        self.count[near] += at_end.sum(0)
        below = some[~at_end]
        found = float(below.max(initial=-np.inf))
        if found > self.next:
            self.next, self.next_count = found, 0
        if found == self.next:
            self.next_count += int(np.count_nonzero(below == found))


@dataclass
class Watch:
    """Smallest and largest number of each channel, NaN and infinite numbers, and rows from which rounding is estimated.

    Parameters
    ----------
    every : of so many rows of the grid, one is kept to estimate rounding
    """

    every: int
    smallest: NDArray[Any] | None = None
    largest: NDArray[Any] | None = None
    bad: Integers | None = None
    kept: list[NDArray[Any]] = field(default_factory=list)
    ends: tuple[End, End] = field(default_factory=lambda: (End(1), End(-1)))

    def look(self, row: int, values: NDArray[Any]) -> None:
        """Take in values [time, channel] that begin at a row of the grid."""
        low, high = values.min(0), values.max(0)
        finite = np.isfinite(low) & np.isfinite(high)
        if self.smallest is None or self.largest is None or self.bad is None:
            self.smallest, self.largest = np.full(len(low), np.inf), np.full(len(low), -np.inf)
            self.bad = np.zeros(len(low), np.int64)
        if not finite.all():
            spoilt = np.flatnonzero(~finite)
            none = ~np.isfinite(values[:, spoilt])
            self.bad[spoilt] += none.sum(0)
            low, high = low.copy(), high.copy()
            low[spoilt] = np.where(none, np.inf, values[:, spoilt]).min(0)
            high[spoilt] = np.where(none, -np.inf, values[:, spoilt]).max(0)
        np.minimum(self.smallest, low, out=self.smallest)
        np.maximum(self.largest, high, out=self.largest)
        if finite.any():
            part = values if finite.all() else np.where(np.isfinite(values), values, np.nan_to_num(low))
            for end, peak in zip(self.ends, (high, low), strict=True):
                end.look(part, np.where(np.isfinite(peak), peak, -end.sign * np.inf))
        first = -row % self.every
        self.kept.append(np.array(values[first :: self.every]))

    @property
    def looked_at(self) -> NDArray[Any]:
        """The rows kept [row, channel], evenly spaced, as they are stored."""
        return np.concatenate(self.kept)

    @property
    def still(self) -> NDArray[np.bool_]:
        """Channels [channel] that never changed, or held no number."""
        if self.smallest is None or self.largest is None:
            return np.asarray(True)
        return np.asarray(self.smallest >= self.largest)

    def clipped(self) -> str | None:
        """Say how many numbers are clipped at the ends of a range; None if none are.

        >>> watch, noise = Watch(1), np.random.default_rng(0).normal(0, 1, (500, 6))
        >>> watch.look(0, np.clip(noise, -9, 1.5))
        >>> watch.clipped()
        '190 samples of 6 channels stand at the same largest number, 1.5: either the record is clipped, and vehicles \
seem farther away than they are (record with a larger range), or the number fills what was not \
measured (write NaN there)'
        """
        for end, which in zip(self.ends, ("largest", "smallest"), strict=True):
            if end.count is None:
                continue
            count = np.where(self.still, 0, end.count)
            total, channels = int(count.sum()), int((count > 0).sum())
            if total < CLIPPED or channels < CLIPPED_CHANNELS:
                continue
            if line := clipped_line(total, channels, which, end.sign * end.extreme, end.next_count):
                return line
        return None
