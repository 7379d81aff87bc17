"""Normal equations of a route and the vehicles along it: banded, with a border, and private blocks that drop out.

Neighboring coefficients of a spline meet in one stretch of fiber only, so the route's part of the normal matrix is a
band; what all stretches share (Poisson's ratio) is a border of few columns; what belongs to one vehicle in one stretch
meets the rest there alone, and is eliminated where it is (Schur complement). Time and memory are linear in the length
(Golub and Van Loan 2013, Matrix Computations, section 4.3).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from solver.fit.normal_parts import Block, Part

Array = NDArray[Any]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Banded:
    """A banded, bordered symmetric matrix.

    Parameters
    ----------
    band : [diagonal, parameter], lower form of `scipy.linalg.cholesky_banded`
    side : [parameter, border]
    corner : [border, border]
    """

    band: Array
    side: Array
    corner: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], size: int, border: int) -> "Banded":
        """Sum of blocks."""
        width = max((one.count for one in blocks), default=0)
        out = cls(np.zeros((width, size)), np.zeros((size, border)), np.zeros((border, border)))
        for one in blocks:
            out.add(one)
        return out

    def add(self, block: Block, sign: float = 1.0) -> None:
        """Add a block, in place."""
        first, count, border = block.first, block.count, block.border
        for below in range(count):
            self.band[below, first : first + count - below] += sign * np.diagonal(block.matrix[:count, :count], -below)
        self.side[first : first + count, border] += sign * block.matrix[:count, count:]
        self.corner[np.ix_(border, border)] += sign * block.matrix[count:, count:]

    @property
    def dense(self) -> Array:
        """The same matrix [parameter + border, parameter + border] in full."""
        size, border = self.side.shape
        out = np.zeros((size + border, size + border))
        for below, diagonal in enumerate(self.band[:size]):
            at = np.arange(size - below)
            out[at + below, at] = out[at, at + below] = diagonal[: size - below]
        out[:size, size:], out[size:, :size], out[size:, size:] = self.side, self.side.T, self.corner
        return out

    def part(self, some: slice) -> "Banded":
        """The same of consecutive parameters and the border alone."""
        return Banded(self.band[:, some], self.side[some], self.corner)

    def copy(self) -> "Banded":
        """One that may be changed."""
        return Banded(self.band.copy(), self.side.copy(), self.corner.copy())

    @property
    def diagonal(self) -> Array:
        """[parameter + border]."""
        return np.concatenate([self.band[0] if len(self.band) else np.zeros(0), np.diagonal(self.corner)])


class Factor:
    """Cholesky factor of a banded, bordered matrix; LinAlgError where it is not positive definite."""

    def __init__(self, matrix: Banded):
        self.size, self.side = len(matrix.side), matrix.side
        self.band = cholesky_banded(matrix.band, lower=True) if self.size else matrix.band
        self.across = self._band_solved(matrix.side)
        self.corner = np.linalg.cholesky(matrix.corner - matrix.side.T @ self.across)

    def _band_solved(self, right: Array) -> Array:
        return np.asarray(cho_solve_banded((self.band, True), right)) if self.size and right.size else right.copy()

    def solved(self, right: Array) -> Array:
        """Solution of a right-hand side [parameter + border, ...]."""
        route = self._band_solved(right[: self.size])
        rest = right[self.size :] - self.side.T @ route
        border = np.linalg.solve(self.corner.T, np.linalg.solve(self.corner, rest)) if len(self.corner) else rest
        return np.concatenate([route - self.across @ border, border])


@dataclass(frozen=True)
class Reduced:
    """The normal equations without the vehicles.

    Parameters
    ----------
    factor : of what is left
    right : [shared]
    lifts : of each part, its own matrix's inverse times `cross` and times `right`
    """

    factor: Factor
    right: Array
    lifts: list[tuple[Array, Array]]


@dataclass(frozen=True)
class Normal:
    """Normal equations H step = g.

    Parameters
    ----------
    size, border : number of the route's parameters, and of the others that are shared
    blocks : of the data, one per stretch, before vehicles are eliminated
    known : of the priors on the route and on the border, and of the anchors
    parts : of the vehicles
    right : [size + border]
    """

    size: int
    border: int
    blocks: list[Block]
    known: list[Block]
    parts: list[Part]
    right: Array

    def holding(self, border: Array, own: Sequence[Array]) -> "Normal":
        """The same with some of the border [border], and some of each part's own [own], held where they are."""
        if not border.any() and not any(one.any() for one in own):
            return self
        alone = Block(0, 0, np.flatnonzero(border), np.eye(border.sum()))
        return replace(
            self,
            blocks=[one.without(border) for one in self.blocks],
            known=[*(one.without(border) for one in self.known), alone],
            parts=[
                part.holding(mine, self.blocks[part.stretch].among(border))
                for part, mine in zip(self.parts, own, strict=True)
            ],
            right=np.where(np.concatenate([np.zeros(self.size, bool), border]), 0.0, self.right),
        )

    @cached_property
    def shared(self) -> Banded:
        """All that the shared parameters have among themselves."""
        return Banded.of([*self.blocks, *self.known], self.size, self.border)

    def without_vehicles(self) -> tuple[Banded, Array]:
        """Matrix and right-hand side of the shared parameters, the vehicles eliminated."""
        matrix, right, _ = self._eliminate(0.0)
        return matrix, right

    def reduced(self, damping: float = 0.0) -> Reduced:
        """Eliminate the vehicles; `damping` times the diagonal is added first (Marquardt 1963)."""
        matrix, right, lifts = self._eliminate(damping)
        return Reduced(Factor(matrix), right, lifts)

    def _eliminate(self, damping: float) -> tuple[Banded, Array, list[tuple[Array, Array]]]:
        matrix, right = self.shared.copy(), self.right.copy()
        lifts: list[tuple[Array, Array]] = []
        if len(matrix.band):
            matrix.band[0] *= 1 + damping
        matrix.corner[np.diag_indices(self.border)] *= 1 + damping
        taken = [np.zeros_like(one.matrix) for one in self.blocks]
        for part in self.parts:
            block = self.blocks[part.stretch]
            own = part.own + damping * np.diag(np.diagonal(part.own))
            both = np.column_stack([part.cross, part.right])
            lift = np.linalg.solve(own, both) if len(own) else both
            across, alone = lift[:, : part.cross.shape[1]], lift[:, part.cross.shape[1] :].reshape(-1)
            taken[part.stretch] += part.cross.T @ across
            right[block.where(self.size)] -= part.cross.T @ alone
            lifts.append((across, alone))
        for block, less in zip(self.blocks, taken, strict=True):
            matrix.add(block.of(less), -1.0)
        return matrix, right, lifts

    def step(self, damping: float) -> tuple[Array, list[Array]]:
        """Step of the shared parameters [size + border], and of each part's own."""
        reduced = self.reduced(damping)
        shared = reduced.factor.solved(reduced.right)
        own = [
            alone - across @ shared[self.blocks[part.stretch].where(self.size)]
            for part, (across, alone) in zip(self.parts, reduced.lifts, strict=True)
        ]
        return shared, own

    def dense(self) -> tuple[Array, Array]:
        """The whole matrix and right-hand side, nothing eliminated: shared parameters first, then each part's own."""
        shared = self.size + self.border
        ends = shared + np.cumsum([0, *(len(part.own) for part in self.parts)])
        out = np.zeros((ends[-1], ends[-1]))
        for block in (*self.blocks, *self.known):
            where = block.where(self.size)
            out[np.ix_(where, where)] += block.matrix
        for part, first, stop in zip(self.parts, ends, ends[1:], strict=False):
            where = self.blocks[part.stretch].where(self.size)
            out[first:stop, first:stop] = part.own
            out[first:stop, where] = part.cross
            out[where, first:stop] = part.cross.T
        return out, np.concatenate([self.right, *(part.right for part in self.parts)])

    @cached_property
    def decrement(self) -> float:
        """Newton decrement sqrt(g' H^-1 g): the length of the whole step in posterior sigmas.

        Infinite where H is singular to rounding.

        >>> flat = Block(0, 2, np.zeros(0, int), np.diag([4.0, 1.0]))
        >>> round(Normal(2, 0, [flat], [], [], np.array([6.0, 4.0])).decrement, 3)
        5.0
        """
        try:
            shared, own = self.step(0.0)
        except np.linalg.LinAlgError:
            return float("inf")
        gain = float(self.right @ shared) + sum(float(p.right @ s) for p, s in zip(self.parts, own, strict=True))
        return float(np.sqrt(max(gain, 0.0)))


class Assembly:
    """Normal equations as they are summed up, link by link: only sums are kept.

    Parameters
    ----------
    size, border : as of `Normal`
    """

    def __init__(self, size: int, border: int):
        self.size, self.border = size, border
        self.right = np.zeros(size + border)
        self.blocks: dict[int, Block] = {}
        self.parts: list[Part] = []

    def add(self, block: Block, right: Array, part: Part) -> None:
        """Add what one link has of shared parameters (`block` and `right`, of the data) and of its own (`part`)."""
        self.right[block.where(self.size)] += right
        if part.stretch in self.blocks:
            self.blocks[part.stretch].matrix[...] += block.matrix
        else:
            self.blocks[part.stretch] = block
        self.parts.append(part)

    def normal(self, known: Sequence[Block], right: Array) -> Normal:
        """The equations, with the priors' matrices and right-hand side [size + border]."""
        blocks = [self.blocks[key] for key in sorted(self.blocks)]
        return Normal(self.size, self.border, blocks, list(known), self.parts, self.right + right)
