"""Ground stage: how the ground answers a load."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from torch import Tensor

from solver.ground.boussinesq import Ratio, Response, displacement, displacement_rate
from solver.transfers import Field, MapFunction, TimeTransfer


@dataclass(frozen=True)
class Ground:
    """How the ground answers a load.

    Parameters
    ----------
    response : (offset [..., 3], velocity [..., 2], Poisson's ratio) -> displacement rate [..., 3] of a unit load
    settlement : (offset, Poisson's ratio) -> displacement [..., 3] of a unit load
    compliance : strain here over that of the base model
    poisson_change : added to Poisson's ratio here
    radiation : (offset [..., 3], velocity [..., 2], time [row, 1, ...], s) -> velocity [..., 3] of the ground in the
        waves that a unit load sends out; None: no such waves
    transfers : of time filters
    tangent_compliances : functions of a map of strain [..., sample, channel]: how much more it changes than in the base
        model
    """

    response: Response = displacement_rate
    settlement: Callable[[Tensor, Ratio], Tensor] = displacement
    compliance: Field | None = None
    poisson_change: Field | None = None
    radiation: Callable[[Tensor, Tensor, Tensor], Tensor] | None = None
    transfers: tuple[TimeTransfer, ...] = ()
    tangent_compliances: tuple[MapFunction, ...] = ()

    def filtered(self, transfer: TimeTransfer) -> "Ground":
        """Whose displacement is filtered in time."""
        return replace(self, transfers=(*self.transfers, transfer))

    def yielding(self, compliance: MapFunction) -> "Ground":
        """Whose strain changes more, or less, by what it is."""
        return replace(self, tangent_compliances=(*self.tangent_compliances, compliance))
