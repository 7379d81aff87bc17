"""Parts of normal equations: blocks of the route and its border, and what one stretch alone has."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Block:
    """A symmetric matrix over some of the shared parameters.

    Parameters
    ----------
    first, count : which of the route's parameters
    border : [border], which of the others
    matrix : [count + border, count + border]
    """

    first: int
    count: int
    border: Index
    matrix: Array

    def where(self, band: int) -> Index:
        """Its rows among all shared parameters, of which the first `band` are the route's."""
        return np.concatenate([np.arange(self.first, self.first + self.count), band + self.border])

    def of(self, matrix: Array) -> "Block":
        """Another matrix over the same parameters."""
        return Block(self.first, self.count, self.border, matrix)

    def among(self, border: Array) -> Array:
        """Which of its parameters [count + border] are some of the border [all border]."""
        return np.concatenate([np.zeros(self.count, bool), border[self.border]])

    def without(self, border: Array) -> "Block":
        """The same with nothing about some of the border."""
        return self.of(cleared(self.matrix, self.among(border)))


def cleared(matrix: Array, out: Array) -> Array:
    """A matrix with some rows and columns 0.

    >>> cleared(np.ones((2, 2)), np.array([True, False])).tolist()
    [[0.0, 0.0], [0.0, 1.0]]
    """
    return np.where(out[:, None] | out, 0.0, matrix)


@dataclass(frozen=True)
class Part:
    """What one stretch and its vehicles add.

    Parameters
    ----------
    own : [own, own], normal matrix of the vehicles' parameters, priors included
    cross : [own, shared], with those that the stretch shares, in the order of its block
    right : [own]
    precision : [own], of the priors
    stretch : number of the block
    """

    own: Array
    cross: Array
    right: Array
    precision: Array
    stretch: int

    def holding(self, own: Array, shared: Array) -> "Part":
        """The same with some of its own, and some of those it shares, held where they are."""
        return replace(
            self,
            own=cleared(self.own, own) + np.diag(own.astype(float)),
            cross=np.where(own[:, None] | shared, 0.0, self.cross),
            right=np.where(own, 0.0, self.right),
        )
