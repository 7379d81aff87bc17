"""Derivatives of which most act for a short while: each vehicle's numbers on its own pass."""

from dataclasses import dataclass

import torch
from torch import Tensor

#: Columns that are kept together where they act for a short while, and the share of all rows that is no short while.
TOGETHER, SHORT = 16, 0.5


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

    >>> matrix = torch.block_diag(*[torch.ones(50, 1, dtype=torch.float64)] * 40)
    >>> windowed = Windowed.of(matrix, 5)
    >>> bool((windowed.transposed_times(matrix) == matrix.T @ matrix).all())
    True
    >>> round(sum(part.values.numel() for part in windowed.parts) / matrix.numel(), 2)
    0.36
    """

    parts: tuple[Part, ...]
    width: int

    @classmethod
    def of(cls, matrix: Tensor, grain: int) -> "Windowed":
        """A matrix [row, column] whose rows belong together by `grain`: the channels of a sample."""
        acts = matrix.reshape(-1, grain, matrix.shape[1]).abs().amax(1) > 0
        first, last = acts.int().argmax(0), len(acts) - acts.flip(0).int().argmax(0)
        short = last - first < SHORT * len(acts)
        order = torch.argsort(first + last, stable=True)
        chunks = [order[~short[order]], *order[short[order]].split(TOGETHER)]
        parts = []
        for columns in (chunk for chunk in chunks if len(chunk)):
            begin, end = int(first[columns].min()) * grain, int(last[columns].max()) * grain
            parts.append(Part(columns, begin, end, matrix[begin:end, columns].T.contiguous()))
        return cls(tuple(parts), matrix.shape[1])

    def transposed_times(self, other: Tensor) -> Tensor:
        """The product [column, other's] of the transpose with another matrix [row, other's]."""
        rows = other.T.contiguous()
        product = other.new_empty(self.width, other.shape[1])
        for part in self.parts:
            product[part.columns] = part.values @ rows[:, part.first : part.last].T
        return product
