"""Laws of the ground's response that can be summed over gauges and wheels in one pass of machine code."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.boussinesq import Ratio, displacement_rate, plain_values
from solver.ground.wheel_motion import (
    Derivatives,
    add_derivatives,
    add_response,
    arranged,
    differentiable,
    spread,
)

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

    #: Whether `derived` has a pass of its own.
    differentiable = False

    @abstractmethod
    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """Displacement rate [..., 3] of a unit load, as of `solver.ground.boussinesq.displacement_rate`."""

    @abstractmethod
    def summed(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """Sum [row, channel] over points and wheels of weight . displacement rate, in one pass.

        None where there is no such pass, as of numbers of the law that carry a derivative.
        """

    def derived(self, at: Placed, poisson_ratio: Tensor) -> Derivatives | None:
        """Derivatives of that sum by all that it depends on but the law's own numbers; None as of `summed`."""
        return None

    def __call__(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
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


class Added(Law):
    """What two laws add to Boussinesq's.

    Parameters
    ----------
    one, other : the laws
    """

    def __init__(self, one: Law, other: Law):
        self.one, self.other = one, other

    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """As of `Law`."""
        at = offset, velocity, poisson_ratio
        return self.one(*at) + self.other(*at) - displacement_rate(*at)

    def summed(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """As of `Law`."""
        one = self.one.summed(at, poisson_ratio)
        other = None if one is None else self.other.summed(at, poisson_ratio)
        return None if one is None or other is None else one + other - boussinesq_summed(at)


def boussinesq_derived(at: Placed) -> Derivatives:
    """The derivatives of `Law.derived` of a homogeneous half-space."""
    out = Derivatives.nothing(at)
    add_derivatives(*at, *out)
    return out


def boussinesq_summed(at: Placed) -> Array:
    """The sums of `Law.summed` of a homogeneous half-space."""
    out = at.nothing
    add_response(*at, out)
    return out


def law_response(
    law: Law, point: Tensor, weight: Tensor, place: Tensor, share: Tensor, velocity: Tensor, ratio: Tensor
) -> Tensor | None:
    """What `solver.ground.wheel_motion.gauge_response` gives, by a law.

    None, too, where points differ by row, and where the law has no pass of its own.
    """
    given = spread(point, weight, place, share, velocity, ratio)
    at = None if given is None else placed(given)
    if given is None or at is None:
        return None
    if torch.is_grad_enabled() and any(one.requires_grad for one in given):
        derivatives = law.derived(at, given[-1][0].detach())
        return None if derivatives is None else differentiable(given, derivatives)
    found = law.summed(at, ratio)
    return None if found is None else torch.from_numpy(found)


def has_pass(law: object, derivatives: bool) -> bool:
    """Whether a law, none among them, may be summed in one pass, with its derivatives where these are wanted."""
    if derivatives:
        return law is None or (isinstance(law, Law) and law.differentiable)
    return isinstance(law, Law | Waves | None)


def waves_response(
    waves: Waves, point: Tensor, weight: Tensor, place: Tensor, share: Tensor, velocity: Tensor, time: Tensor
) -> Tensor | None:
    """Sum [row, channel] over points and wheels of weight . velocity of the ground in waves, at times [row, 1].

    None where a derivative is asked for, and as of `law_response`.
    """
    given = spread(point, weight, place, share, velocity, torch.zeros((), dtype=torch.float64))
    at = None if given is None or plain_values(*given, time) is None else placed(given)
    if at is None or time.shape[1] > 1:
        return None
    found = waves.summed(at, np.ascontiguousarray(time[:, 0].numpy()))
    return None if found is None else torch.from_numpy(found)


def placed(given: tuple[Tensor, ...]) -> Placed | None:
    """What `spread` gives, for one pass over points that are the same in all rows; None of others."""
    point, weight, *_, ratio = given
    if any(len(one) > 1 and one.stride(0) > 0 for one in (point, weight, ratio)):
        return None
    return Placed(*arranged((point[:1], weight[:1], *given[2:5], ratio[:1])))
