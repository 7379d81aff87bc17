"""Ground stage: the response of the ground to a load."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from torch import Tensor

from solver.effect.transfers import Field, MapFunction, TimeTransfer
from solver.ground.boussinesq import Ratio, Response, displacement, displacement_rate
from solver.ground.ground_law import Array, Law, Placed

if TYPE_CHECKING:
    from solver.ground.wheel_motion import Derivatives

#: (offset [..., 3], Poisson's ratio) -> displacement [..., 3] of a unit load.
Settlement = Callable[[Tensor, Ratio], Tensor]
#: (offset [..., 3], velocity [..., 2], time [row, 1, ...], s) -> velocity [..., 3] of the ground.
Radiation = Callable[[Tensor, Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Ground:
    """Response of the ground to a load: that of a homogeneous elastic half-space unless a law is given.

    Parameters
    ----------
    response : (offset [..., 3], velocity [..., 2], Poisson's ratio) -> displacement rate [..., 3] of a unit load; None:
        Boussinesq's
    settlement : (offset, Poisson's ratio) -> displacement [..., 3] of a unit load, by which loads act that change, as
        under vehicles that bounce; None: Boussinesq's
    compliance : strain at a place over that of the base model
    poisson_change : added to Poisson's ratio at a place
    radiation : (offset [..., 3], velocity [..., 2], time [row, 1, ...], s) -> velocity [..., 3] of the ground in the
        waves that a unit load sends out; None: no such waves
    transfers : of time filters
    tangent_compliances : functions of a strain map [..., sample, channel]: ratio of its change to that in the base
        model
    """

    response: Response | None = None
    settlement: Settlement | None = None
    compliance: Field | None = None
    poisson_change: Field | None = None
    radiation: Radiation | None = None
    transfers: tuple[TimeTransfer, ...] = ()
    tangent_compliances: tuple[MapFunction, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether it responds to single loads like a homogeneous elastic half-space at rest."""
        own = (self.response, self.settlement, self.compliance, self.poisson_change, self.radiation)
        return all(law is None for law in own)

    def displacement_rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """Displacement rate [..., 3] of a unit load, by its own law or Boussinesq's."""
        return (self.response or displacement_rate)(offset, velocity, poisson_ratio)

    def displacement(self, offset: Tensor, poisson_ratio: Ratio) -> Tensor:
        """Displacement [..., 3] of a unit load, by its own law or Boussinesq's."""
        return (self.settlement or displacement)(offset, poisson_ratio)

    def responding(self, rate: Response, settlement: Settlement | None = None) -> "Ground":
        """The ground as a law changes it, under loads that move and, where that is given, under loads that change.

        What it adds to Boussinesq's law adds to any law that there is.
        """
        known, settled = self.response, self.settlement
        response = rate if known is None else both_moved(known, rate)
        if isinstance(known, Law) and isinstance(rate, Law):
            response = Both(known, rate)
        if settled is not None and settlement is not None:
            return replace(self, response=response, settlement=both_settled(settled, settlement))
        return replace(self, response=response, settlement=settlement or settled)

    def softened(self, compliance: Field) -> "Ground":
        """The ground with a further compliance at places."""
        known = self.compliance
        whole = compliance if known is None else lambda point: known(point) * compliance(point)
        return replace(self, compliance=whole)

    def with_ratio_changed(self, change: Field) -> "Ground":
        """The ground with a further change of Poisson's ratio at places."""
        known = self.poisson_change
        return replace(self, poisson_change=change if known is None else lambda point: known(point) + change(point))

    def radiating(self, radiation: Radiation) -> "Ground":
        """The ground with further waves that loads send out."""
        known = self.radiation
        whole = radiation if known is None else lambda *at: known(*at) + radiation(*at)
        return replace(self, radiation=whole)

    def filtered(self, transfer: TimeTransfer) -> "Ground":
        """The ground with a further filter of its displacement in time."""
        return replace(self, transfers=(*self.transfers, transfer))

    def yielding(self, compliance: MapFunction) -> "Ground":
        """The ground with a further compliance that depends on strain."""
        return replace(self, tangent_compliances=(*self.tangent_compliances, compliance))


@dataclass(frozen=True)
class Both(Law):
    """What two laws add to Boussinesq's, under a load that moves.

    Parameters
    ----------
    one, other : the laws
    """

    one: Law
    other: Law

    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """As of `Law`."""
        return both_moved(self.one, self.other)(offset, velocity, poisson_ratio)

    def has_pass(self, derivatives: bool, uniform: bool) -> bool:
        """As of `Law`."""
        return all(law.has_pass(derivatives, uniform) for law in (self.one, self.other))

    def added(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """As of `Law`."""
        one = self.one.added(at, poisson_ratio)
        other = None if one is None else self.other.added(at, poisson_ratio)
        return None if one is None or other is None else one + other

    def derived(self, at: Placed, poisson_ratio: Tensor) -> "Derivatives | None":
        """As of `Law`."""
        one = self.one.derived(at, poisson_ratio)
        other = None if one is None else self.other.derived(at, poisson_ratio)
        return None if one is None or other is None else one.plus(other)


def both_moved(one: Response, other: Response) -> Response:
    """What two laws add to Boussinesq's, under a load that moves."""
    return lambda *at: one(*at) + other(*at) - displacement_rate(*at)


def both_settled(one: Settlement, other: Settlement) -> Settlement:
    """What two laws add to Boussinesq's, under a load at rest."""
    return lambda *at: one(*at) + other(*at) - displacement(*at)
