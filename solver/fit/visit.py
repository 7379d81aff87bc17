"""What a chain of small problems finds near a state."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from torch import Tensor

from solver.fit.normal import Normal
from solver.fit.normal_parts import Block, Part
from solver.fit.state import State, Weights


@dataclass(frozen=True)
class Looked:
    """Some convoys near a state, weighed together.

    Parameters
    ----------
    amplitudes : [pass] of each link, that fit best
    cost : misfit by the weights given
    weights, models, residuals : of each link
    equations : of each convoy, as `Assembly.add` takes them
    """

    amplitudes: list[Tensor]
    cost: float
    weights: list[Weights]
    models: list[Tensor]
    residuals: list[Tensor]
    equations: list[tuple[Block, np.ndarray, Part]]

    @property
    def misfit(self) -> float:
        """Chi2 by the new weights."""
        return sum(float((one**2).sum()) for one in self.residuals)


@dataclass(frozen=True)
class Visit:
    """A chain near a state, its amplitudes settled.

    Parameters
    ----------
    state : visited
    cost : misfit by the weights of the visit before, and priors
    misfit : chi2 of the whitened residual by its own weights
    normal : equations there
    border, own : which of the shared parameters beside the route, and of each convoy's own, are at a bound and would
        leave it
    weights, models : of each link
    residuals : of each link, whitened and weighted, [sample, channel]
    """

    state: State
    cost: float
    misfit: float
    normal: Normal
    border: np.ndarray
    own: list[np.ndarray]
    weights: list[Weights]
    models: list[Tensor]
    residuals: list[Tensor]

    @cached_property
    def open(self) -> Normal:
        """The equations of the next step, without what stays at its bound."""
        return self.normal.holding(self.border, self.own)
