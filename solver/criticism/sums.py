"""Sums over the rows of a score test, and the factor of its normal matrix."""

from typing import NamedTuple

import torch
from torch import Tensor

#: Share of its diagonal that is added to a normal matrix that is singular to rounding.
RIDGE = 1e-10


class Sums(NamedTuple):
    """Products of directions, sums over the rows.

    Attributes
    ----------
    score : [number], with the residual
    gram : [number, number], with one another
    crossed : [fitted, number], with all that was fitted; none where all is held
    """

    score: Tensor
    gram: Tensor
    crossed: Tensor

    def plus(self, other: "Sums") -> "Sums":
        """Those over more rows."""
        return Sums(*(one + two for one, two in zip(self, other, strict=True)))

    @property
    def norm(self) -> float:
        """Root of the sum of the directions' squares."""
        return float(self.gram.trace()) ** 0.5


def factor_of(matrix: Tensor) -> Tensor:
    """Cholesky factor of a normal matrix, with a ridge where rounding has left it indefinite.

    Along a coil that the model lacks the route nearly stands still, and its direction is hardly determined.

    >>> factor_of(torch.ones(2, 2, dtype=torch.float64)).diagonal()
    tensor([1.0000e+00, 1.4142e-05], dtype=torch.float64)
    """
    factor, failed = torch.linalg.cholesky_ex(matrix)
    return torch.linalg.cholesky(matrix + RIDGE * torch.diag(matrix.diagonal())) if int(failed) else factor


def sharpness(factor: Tensor) -> float:
    """Half the ln of the determinant of a normal matrix, from its factor [free, free].

    >>> round(sharpness(torch.diag(torch.tensor([2.0, 3.0]))), 3) == round(torch.tensor(6.0).log().item(), 3)
    True
    """
    return float(factor.diagonal().log().sum())


def load_cost(amplitude: Tensor) -> float:
    """-ln of the prior density of loads [pass], but for a constant: all are of one size, which is not known.

    Integrated over that size, every one as probable in its ln, n loads of which only the size is unknown have a density
    that goes as their norm to the power of -n. A law that makes less of a unit load is none the more probable for the
    larger loads that it takes; a density that is the same for all loads would favor it by that in each pass.

    >>> three = torch.tensor([1.0, 2.0, 2.0])
    >>> round(load_cost(10 * three) - load_cost(three), 3) == round(3 * torch.tensor(10.0).log().item(), 3)
    True
    """
    return len(amplitude) * float(amplitude.norm().clamp_min(1e-300).log())
