"""What a law of the ground is, so that its response can be summed over gauges and wheels in one pass."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

if TYPE_CHECKING:
    from solver.ground.boussinesq import Ratio
    from solver.ground.wheel_motion import Derivatives

Array = NDArray[np.float64]


class Placed(NamedTuple):
    """Gauges and the wheels that move the ground under them, as compiled loops read them.

    Attributes
    ----------
    point, weight : [3, 1, point, channel], m and 1/m
    place, velocity : [2, wheel, row], m, and [2, row], m/s
    share : [wheel, row]
    softness : [1, point, channel], 1 - 2 nu
    """

    point: Array
    weight: Array
    place: Array
    share: Array
    velocity: Array
    softness: Array

    @property
    def nothing(self) -> Array:
        """Zero for each row and channel."""
        return np.zeros((self.share.shape[1], self.point.shape[3]))


class Law(ABC):
    """A law of the ground's response to loads that move."""

    @abstractmethod
    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: "Ratio") -> Tensor:
        """Displacement rate [..., 3] of a unit load, as of `solver.ground.boussinesq.displacement_rate`."""

    @abstractmethod
    def has_pass(self, derivatives: bool, uniform: bool) -> bool:
        """Whether `added`, or `derived`, is one pass; `uniform`: with the same Poisson's ratio everywhere."""

    @abstractmethod
    def added(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """What it adds to Boussinesq's law, summed over points and wheels: weight . displacement rate, [row, channel].

        None where there is no such pass, as of numbers of the law that carry a derivative.
        """

    @abstractmethod
    def derived(self, at: Placed, poisson_ratio: Tensor) -> "Derivatives | None":
        """Derivatives of that sum by all that it depends on but the law's own numbers; None as of `added`."""

    def __call__(self, offset: Tensor, velocity: Tensor, poisson_ratio: "Ratio") -> Tensor:
        """`rate`."""
        return self.rate(offset, velocity, poisson_ratio)


class Waves(ABC):
    """A law of the waves that loads send out."""

    @abstractmethod
    def __call__(self, offset: Tensor, velocity: Tensor, time: Tensor) -> Tensor:
        """Velocity [..., 3] of the ground, as of `solver.ground.ground.Ground`."""

    @abstractmethod
    def summed(self, at: Placed, time: Array) -> Array | None:
        """Sum [row, channel] over points and wheels of weight . velocity of the ground at a time [row], in one pass.

        None where there is no such pass, as of numbers of the law that carry a derivative.
        """


def summed_in_one_pass(law: object, waves: object, derivatives: bool, uniform: bool) -> bool:
    """Whether a law and waves, either may be None, are summed in one pass, see `Law.has_pass`."""
    if waves is not None and (derivatives or not isinstance(waves, Waves)):
        return False
    return law is None or (isinstance(law, Law) and law.has_pass(derivatives, uniform))
