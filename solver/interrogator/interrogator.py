"""Interrogator stage: how strain becomes numbers."""

from dataclasses import dataclass, replace

from torch import Tensor

from solver.effect.transfers import FiberTransfer, MapFunction, TimeTransfer


@dataclass(frozen=True)
class Interrogator:
    """How strain becomes numbers.

    Parameters
    ----------
    gauge_length : m
    gain : scalar or [sample, 1], output of all channels over strain rate
    fiber_transfers : of filters along the fiber
    mixing : [channel, channel] matrices applied along the fiber
    transfers : of time filters
    pointwise : functions of each sample
    """

    gauge_length: Tensor | float
    gain: Tensor | float = 1.0
    fiber_transfers: tuple[FiberTransfer, ...] = ()
    mixing: tuple[Tensor, ...] = ()
    transfers: tuple[TimeTransfer, ...] = ()
    pointwise: tuple[MapFunction, ...] = ()

    def filtered(self, transfer: TimeTransfer) -> "Interrogator":
        """Whose output is filtered in time."""
        return replace(self, transfers=(*self.transfers, transfer))

    def blurred(self, transfer: FiberTransfer) -> "Interrogator":
        """Whose output is filtered along the fiber."""
        return replace(self, fiber_transfers=(*self.fiber_transfers, transfer))

    def mixed(self, matrix: Tensor) -> "Interrogator":
        """Whose channels are sums [channel, channel] of the base model's."""
        return replace(self, mixing=(*self.mixing, matrix))

    def through(self, function: MapFunction) -> "Interrogator":
        """Whose every sample goes through a function of a map [..., sample, channel]."""
        return replace(self, pointwise=(*self.pointwise, function))
