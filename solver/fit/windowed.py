"""Derivatives that mostly act for a short while: a vehicle's numbers act on its own pass alone."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor

from solver.fit.acting_rows import acting, acting_rows, alike, remembered, runs, spanned
from solver.signal_path.few import few_of

T = TypeVar("T")

#: Values of parts that are merged, beyond which more would make products no faster.
MERGED = 1 << 20
#: Columns at a time of a product with itself.
BLOCK = 32


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

    @property
    def by_row(self) -> Tensor:
        """Values [row, column] in that order of memory: what is multiplied by them takes half the time or less."""
        return self.values.T.contiguous()


@dataclass(frozen=True)
class Windowed:
    """A matrix [row, column], each part of its columns kept between the rows where they are not zero.

    A column may be in several parts, which do not overlap.

    >>> matrix = torch.block_diag(*[torch.ones(50, 1, dtype=torch.float64)] * 40)
    >>> windowed = Windowed.of(matrix, 5)
    >>> bool((windowed.gram == matrix.T @ matrix).all())
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
        acts = columns.reshape(len(columns), -1, grain).ne(0).any(-1)
        return cls(parts_of(columns, acts, grain), *matrix.shape)

    @classmethod
    def whole(cls, columns: Tensor) -> "Windowed":
        """A matrix given by its columns [column, row], which act all the while."""
        count, rows = columns.shape
        return cls((Part(torch.arange(count), 0, rows, columns),), rows, count)

    @classmethod
    def through(cls, maps: Tensor, linear: Callable[[Tensor], Tensor], memory: int) -> "Windowed":
        """What a linear map of maps makes of maps [column, sample, channel], as columns.

        Parameters
        ----------
        memory : samples for which `linear` remembers; it may leave out the first ones
        """
        # Whitening makes several copies: of all maps at once they would take as much memory as everything else.
        return cls.through_each(maps.split(few_of(maps.shape[1] * maps.shape[2])), linear, memory)

    @classmethod
    def through_each(cls, some: Iterable[Tensor], linear: Callable[[Tensor], Tensor], memory: int) -> "Windowed":
        """The same of maps that come some at a time, of which no more are ever held."""
        return cls.beside(cls._through(maps, linear, memory) for maps in some)

    @classmethod
    def _through(cls, maps: Tensor, linear: Callable[[Tensor], Tensor], memory: int) -> "Windowed":
        count, samples, channels = maps.shape
        white = linear(maps)
        acts = remembered(acting_rows(maps), memory)[:, samples - white.shape[1] :]
        return cls(parts_of(white.flatten(1), acts, channels), white.shape[1] * channels, count)

    @classmethod
    def stacked(cls, pieces: "Iterable[tuple[int, Windowed]]", rows: int, width: int) -> "Windowed":
        """Pieces of a matrix, each from some row on."""
        parts = [
            Part(part.columns, first + part.first, first + part.last, part.values)
            for first, piece in pieces
            for part in piece.parts
        ]
        return cls(tuple(parts), rows, width)

    @classmethod
    def beside(cls, matrices: "Iterable[Windowed]") -> "Windowed":
        """Matrices of as many rows beside one another."""
        parts, width, rows = [], 0, 0
        for one in matrices:
            parts += [Part(part.columns + width, part.first, part.last, part.values) for part in one.parts]
            width, rows = width + one.width, one.rows
        return cls(joined(parts), rows, width)

    def taking(self, chosen: Tensor) -> "Windowed":
        """Only the columns `chosen` [column] bool."""
        if bool(chosen.all()):
            return self
        number = chosen.cumsum(0) - 1
        parts = []
        for part in self.parts:
            mine = chosen[part.columns]
            if bool(mine.any()):
                values = part.values if bool(mine.all()) else part.values[mine]
                parts.append(Part(number[part.columns[mine]], part.first, part.last, values))
        return Windowed(tuple(parts), self.rows, int(chosen.sum()))

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

    def between(self, first: int, last: int) -> "Windowed":
        """Its rows [first, last) alone."""
        parts = []
        for part in self.parts:
            a, b = max(part.first, first), min(part.last, last)
            if a < b:
                values = part.values[:, a - part.first : b - part.first]
                parts.append(Part(part.columns, a - first, b - first, values))
        return Windowed(tuple(parts), last - first, self.width)

    def times(self, factors: Tensor) -> Tensor:
        """The product [..., row] with as many factors [..., column] as it has columns."""
        product = factors.new_zeros(*factors.shape[:-1], self.rows)
        for part in self.parts:
            product[..., part.first : part.last] += factors[..., part.columns] @ part.values
        return product

    def along(self, vector: Tensor) -> Tensor:
        """The product [column] of the transpose with a vector [row]."""
        product = vector.new_zeros(self.width)
        for part in self.parts:
            product[part.columns] += part.values @ vector[part.first : part.last]
        return product

    @property
    def gram(self) -> Tensor:
        """The product [column, column] of the transpose with the matrix itself, of which half is computed."""
        product = torch.zeros(self.width, self.width, dtype=torch.float64)
        for number, two in enumerate(self.parts):
            rows = two.by_row
            product[two.columns[:, None], two.columns] += gram_of(two.values, rows)
            for one in self.parts[:number]:
                first, last = max(one.first, two.first), min(one.last, two.last)
                if first < last:
                    crossed = (
                        one.values[:, first - one.first : last - one.first] @ rows[first - two.first : last - two.first]
                    )
                    product[one.columns[:, None], two.columns] += crossed
                    product[two.columns[:, None], one.columns] += crossed.T
        return product

    def transposed_times(self, other: "Windowed") -> Tensor:
        """The product [column, other's] of the transpose with another matrix of as many rows."""
        product = torch.zeros(self.width, other.width, dtype=torch.float64)
        for two in other.parts:
            rows = two.by_row
            for one in self.parts:
                first, last = max(one.first, two.first), min(one.last, two.last)
                if first < last:
                    mine = one.values[:, first - one.first : last - one.first]
                    product[one.columns[:, None], two.columns] += mine @ rows[first - two.first : last - two.first]
        return product


def gram_of(columns: Tensor, rows: Tensor) -> Tensor:
    """Products [column, column] of columns [column, row], the same as `rows`, with one another: half are computed.

    >>> columns = torch.arange(800.0).reshape(100, 8)
    >>> bool((gram_of(columns, columns.T) == columns @ columns.T).all())
    True
    """
    out = columns.new_empty(len(columns), len(columns))
    for first in range(0, len(columns), BLOCK):
        some = columns[first : first + BLOCK] @ rows[:, first:]
        out[first : first + BLOCK, first:] = some
        out[first:, first : first + BLOCK] = some.T
    return out


def parts_of(columns: Tensor, acts: Tensor, grain: int) -> tuple[Part, ...]:
    """Columns [column, row] where they act [column, sample] bool, `grain` rows to a sample."""
    parts = []
    for some in alike(acting(acts)):
        # All of them need no copy.
        every = len(some) == len(columns)
        some = torch.arange(len(columns)) if every else some
        for first, last in runs(acts[some].any(0)):
            rows = columns[:, first * grain : last * grain]
            parts.append(Part(some, first * grain, last * grain, rows if every else rows[some]))
    return tuple(parts)


def taken(some: list[T]) -> Iterator[T]:
    """Things that are taken out of a list one after the other, so that none is held for its sake.

    >>> some = [1, 2]
    >>> list(taken(some)), some
    ([1, 2], [])
    """
    while some:
        yield some.pop(0)


def joined(parts: list[Part]) -> tuple[Part, ...]:
    """Parts, with those of nearly the same rows merged into one; the list is emptied.

    What is merged is let go of at once, and large ones stay as they are: all of them twice would be most of what a fit
    takes.
    """
    windows = torch.tensor([[part.first, part.last] for part in parts]).reshape(-1, 2)
    left, whole = dict(enumerate(parts)), []
    parts.clear()
    for some in (some for group in alike(windows) for some in portions(group.tolist(), left)):
        if len(some) == 1:
            whole.append(left.pop(some[0]))
            continue
        first, last = spanned(windows[some]).tolist()
        columns = torch.cat([left[number].columns for number in some])
        values, at = left[some[0]].values.new_zeros(len(columns), last - first), 0
        for number in some:
            part = left.pop(number)
            values[at : at + len(part.values), part.first - first : part.last - first] = part.values
            at += len(part.values)
        whole.append(Part(columns, first, last, values))
    return tuple(whole)


def portions(group: Sequence[int], parts: Mapping[int, Part]) -> Iterator[list[int]]:
    """Numbers of parts, as many at a time as are worth merging."""
    some, size = list[int](), 0
    for number in group:
        if some and size > MERGED:
            yield some
            some, size = [], 0
        some, size = [*some, number], size + parts[number].values.numel()
    yield some
