"""Derivatives that mostly act for a short while: a vehicle's numbers act on its own pass alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

#: Columns are kept together where the rows between which they act are at most this many times as many as each's own.
TOGETHER = 1.3
#: Values of maps that are whitened at once.
AT_ONCE = 1 << 21


@dataclass(frozen=True)
class Part:
    """Some columns between two rows, beyond which they are zero.

    Parameters
    ----------
    columns : [column], their numbers
    first, last : rows [first, last)
    values : [column, row], what a product with a few columns reads fastest
    """

    columns: Tensor
    first: int
    last: int
    values: Tensor


@dataclass(frozen=True)
class Windowed:
    """A matrix [row, column], each part of its columns kept between the rows where they are not zero.

    A column may be in several parts, which do not overlap.

    >>> matrix = torch.block_diag(*[torch.ones(50, 1, dtype=torch.float64)] * 40)
    >>> windowed = Windowed.of(matrix, 5)
    >>> bool((windowed.transposed_times(windowed) == matrix.T @ matrix).all())
    True
    >>> sum(part.values.numel() for part in windowed.parts) / matrix.numel()
    0.025
    """

    parts: tuple[Part, ...]
    rows: int
    width: int

    @classmethod
    def of(cls, matrix: Tensor, grain: int) -> "Windowed":
        """A matrix [row, column] whose rows belong together by `grain`: the channels of a sample."""
        columns = matrix.T
        windows = acting(columns.reshape(len(columns), -1, grain).ne(0).any(-1))
        return cls(parts_of(columns, windows, grain), *matrix.shape)

    @classmethod
    def through(cls, maps: Tensor, linear: Callable[[Tensor], Tensor], memory: int) -> "Windowed":
        """What a linear map of maps makes of maps [column, sample, channel], as columns.

        Parameters
        ----------
        memory : samples for which `linear` remembers
        """
        # Whitening makes several copies: of all maps at once they would take as much memory as everything else.
        few = max(1, AT_ONCE // (maps.shape[1] * maps.shape[2]))
        parts = [cls._through(some, linear, memory) for some in maps.split(few)]
        return parts[0] if len(parts) == 1 else cls.beside(parts)

    @classmethod
    def _through(cls, maps: Tensor, linear: Callable[[Tensor], Tensor], memory: int) -> "Windowed":
        count, samples, channels = maps.shape
        windows = acting(maps.ne(0).any(-1))
        acts = windows[:, 1] > windows[:, 0]
        windows[:, 1] = torch.where(acts, (windows[:, 1] + memory).clamp(max=samples), windows[:, 1])
        return cls(parts_of(linear(maps).flatten(1), windows, channels), samples * channels, count)

    @classmethod
    def beside(cls, matrices: "Sequence[Windowed]") -> "Windowed":
        """Matrices of as many rows beside one another."""
        parts, width = [], 0
        for one in matrices:
            parts += [Part(part.columns + width, part.first, part.last, part.values) for part in one.parts]
            width += one.width
        return cls(joined(parts), matrices[0].rows, width)

    @property
    def norm(self) -> float:
        """Root of the sum of squares."""
        return float(sum(part.values.square().sum() for part in self.parts)) ** 0.5

    @property
    def extent(self) -> float:
        """How many full columns would hold as many values as are kept."""
        return sum(part.values.numel() for part in self.parts) / self.rows

    def above(self, below: Tensor) -> "Windowed":
        """With more rows [row, column] below its own."""
        more = below.any(0).nonzero()[:, 0]
        parts = self.parts
        if len(more):
            parts = (*parts, Part(more, self.rows, self.rows + len(below), below[:, more].T.contiguous()))
        return Windowed(parts, self.rows + len(below), self.width)

    def times(self, factors: Tensor) -> Tensor:
        """The product [row] with as many factors as it has columns."""
        product = factors.new_zeros(self.rows)
        for part in self.parts:
            product[part.first : part.last] += factors[part.columns] @ part.values
        return product

    def along(self, vector: Tensor) -> Tensor:
        """The product [column] of the transpose with a vector [row]."""
        product = vector.new_zeros(self.width)
        for part in self.parts:
            product[part.columns] += part.values @ vector[part.first : part.last]
        return product

    def transposed_times(self, other: "Windowed") -> Tensor:
        """The product [column, other's] of the transpose with another matrix of as many rows."""
        product = torch.zeros(self.width, other.width, dtype=torch.float64)
        for one in self.parts:
            for two in other.parts:
                first, last = max(one.first, two.first), min(one.last, two.last)
                if first < last:
                    mine, theirs = (part.values[:, first - part.first : last - part.first] for part in (one, two))
                    product[one.columns[:, None], two.columns] += mine @ theirs.T
        return product


def parts_of(columns: Tensor, windows: Tensor, grain: int) -> tuple[Part, ...]:
    """Columns [column, row] between their windows [column, 2] of `grain` rows each."""
    parts = []
    for some in alike(windows):
        first, last = (spanned(windows[some]) * grain).tolist()
        parts.append(Part(some, first, last, columns[some, first:last]))
    return tuple(parts)


def acting(acts: Tensor) -> Tensor:
    """First row at which each column acts and that after the last [column, 2], of acts [column, row].

    >>> acting(torch.tensor([[False, True, False, True, False], [False] * 5])).tolist()
    [[1, 4], [0, 0]]
    """
    first = acts.int().argmax(1)
    last = (acts.shape[1] - acts.flip(1).int().argmax(1)) * acts.any(1)
    return torch.stack([first, last], 1)


def spanned(windows: Tensor) -> Tensor:
    """The window that spans all of some windows [window, 2]."""
    return torch.stack([windows[:, 0].min(), windows[:, 1].max()])


def alike(windows: Tensor) -> list[Tensor]:
    """Groups of windows [window, 2] that nearly coincide, by their numbers; empty windows are left out.

    >>> [group.tolist() for group in alike(torch.tensor([[0, 10], [20, 30], [1, 11], [0, 30], [5, 5]]))]
    [[0, 2], [3], [1]]
    """
    length = windows[:, 1] - windows[:, 0]
    middles = windows.sum(1).tolist()
    some = sorted(length.nonzero()[:, 0].tolist(), key=lambda one: middles[one])
    groups: list[list[int]] = []
    spans: list[tuple[int, int, int]] = []
    for one in some:
        first, last = windows[one].tolist()
        for number, (lowest, highest, shortest) in enumerate(spans):
            together = min(first, lowest), max(last, highest), min(last - first, shortest)
            if together[1] - together[0] <= TOGETHER * together[2]:
                groups[number].append(one)
                spans[number] = together
                break
        else:
            groups.append([one])
            spans.append((first, last, last - first))
    return [torch.tensor(group) for group in groups]


def joined(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Parts, with those of nearly the same rows merged into one."""
    windows = torch.tensor([[part.first, part.last] for part in parts]).reshape(-1, 2)
    whole = []
    for group in alike(windows):
        if len(group) == 1:
            whole.append(parts[int(group)])
            continue
        first, last = spanned(windows[group]).tolist()
        some = [parts[number] for number in group.tolist()]
        values = some[0].values.new_zeros(sum(len(part.values) for part in some), last - first)
        at = 0
        for part in some:
            values[at : at + len(part.values), part.first - first : part.last - first] = part.values
            at += len(part.values)
        whole.append(Part(torch.cat([part.columns for part in some]), first, last, values))
    return tuple(whole)
