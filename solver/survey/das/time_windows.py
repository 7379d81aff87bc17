"""Windows of a record that is read around its vehicles only: one after the other, with a few empty rows between."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

#: Empty rows between two windows, s: noise hangs together over 8 s, and one whose view ends is followed for 40 s.
APART = 40.0

#: First row, and one after the last.
Span = tuple[int, int]


@dataclass(frozen=True)
class Windows:
    """Which rows of a regular grid a record holds, and where.

    Parameters
    ----------
    spans : of the grid, one for each window, ascending
    apart : empty rows between two windows; the grid has more there
    """

    spans: tuple[Span, ...]
    apart: int

    @classmethod
    def of(cls, spans: Sequence[Span], sampling_rate: float) -> "Windows":
        """Of spans in order; those that are less apart than the empty rows of two windows are one.

        >>> Windows.of([(0, 90), (95, 100), (400, 500)], 1.0)
        Windows(spans=((0, 100), (400, 500)), apart=40)
        """
        apart, joined = int(np.ceil(APART * sampling_rate)), [spans[0]]
        for begin, end in spans[1:]:
            if begin - joined[-1][1] > apart:
                joined.append((begin, end))
            else:
                joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        return cls(tuple(joined), apart)

    @property
    def begin(self) -> int:
        """First row of the grid that is held."""
        return self.spans[0][0]

    @property
    def end(self) -> int:
        """One after the last row of the grid that is held."""
        return self.spans[-1][1]

    @property
    def firsts(self) -> list[int]:
        """Row of the record at which each window begins."""
        lengths = [end - begin for begin, end in self.spans[:-1]]
        return [0, *(np.cumsum(lengths) + self.apart * np.arange(1, len(self.spans))).tolist()]

    @property
    def rows(self) -> int:
        """Rows of the record, the empty ones between windows included."""
        return sum(end - begin for begin, end in self.spans) + self.apart * (len(self.spans) - 1)

    def place(self, row: int) -> int:
        """Row of the record that holds a row of the grid.

        >>> Windows(((5, 8), (90, 92)), 10).place(91)
        14
        """
        window = max(0, int(np.searchsorted([begin for begin, _ in self.spans], row, side="right")) - 1)
        return self.firsts[window] + row - self.spans[window][0]

    @property
    def grid_rows(self) -> NDArray[np.int64]:
        """Row of the grid that each row of the record is [row]; between two windows, half belongs to either.

        >>> Windows(((5, 8), (90, 92)), 4).grid_rows.tolist()
        [5, 6, 7, 8, 9, 88, 89, 90, 91]
        """
        before = self.apart // 2
        begins = [self.begin, *(begin - (self.apart - before) for begin, _ in self.spans[1:])]
        ends = [*(end + before for _, end in self.spans[:-1]), self.end]
        return np.concatenate([np.arange(*both) for both in zip(begins, ends, strict=True)])


def jumps(time: NDArray[np.float64], sampling_rate: float) -> tuple[tuple[int, float], ...]:
    """Row and time, s, at which each window of a record after the first begins.

    Parameters
    ----------
    time : of the record [row], s; even but for jumps
    sampling_rate : Hz

    >>> jumps(np.array([0.0, 0.2, 0.4, 9.0, 9.2]), 5.0)
    ((3, 9.0),)
    """
    return tuple((int(row), float(time[row])) for row in np.flatnonzero(np.diff(time) > 1.5 / sampling_rate) + 1)


def stretches(time: NDArray[np.float64], sampling_rate: float) -> list[slice]:
    """Rows of each window of a record; arguments as of `jumps`."""
    return [slice(*both) for both in pairwise([0, *(row for row, _ in jumps(time, sampling_rate)), len(time)])]
