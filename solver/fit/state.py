"""What is fitted, and where a fit is linearized."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from solver.signal_path.extension import Values
from solver.signal_path.signal_path import Sensitivities
from solver.signal_path.traffic import Vehicles
from solver.trajectory.vehicle_pass import Pass

PER_PASS = ("amplitude", "along", "across", "wheelbase", "front_share")


@dataclass(frozen=True)
class State:
    """All that is fitted: route coefficients [knot, 3] (m), vehicles, Poisson ratio [], numbers of the effects."""

    coefficients: Tensor
    vehicles: Vehicles
    poisson_ratio: Tensor
    numbers: Tensor

    def vector(self) -> Tensor:
        """One vector: route, each per-pass quantity, the Poisson ratio, the effects' numbers."""
        per_pass = [getattr(self.vehicles, name) for name in PER_PASS]
        return torch.cat([self.coefficients.reshape(-1), *per_pass, self.poisson_ratio.reshape(1), self.numbers])

    def moved(self, vector: Tensor) -> "State":
        """The state that `vector` describes."""
        shape, passes = self.coefficients.shape, len(self.vehicles.amplitude)
        sizes = [self.coefficients.numel(), len(PER_PASS) * passes, 1, len(self.numbers)]
        route, rest, nu, numbers = vector.split(sizes)
        columns = dict(zip(PER_PASS, rest.reshape(len(PER_PASS), passes), strict=True))
        vehicles = replace(self.vehicles, **columns)
        return State(route.reshape(shape), vehicles, nu[0].clamp(0.0, 0.495), numbers)

    @classmethod
    def of(cls, vector: Tensor, coefficients: int, passes: Sequence[Pass]) -> "State":
        """The state of a vector [parameter] with so many route coefficients (per axis) and such vehicles."""
        route = torch.zeros(coefficients, 3, dtype=torch.float64)
        numbers = torch.zeros(len(vector) - 3 * coefficients - len(PER_PASS) * len(passes) - 1, dtype=torch.float64)
        return cls(route, Vehicles.of(passes), torch.zeros((), dtype=torch.float64), numbers).moved(vector)


@dataclass(frozen=True)
class Weights:
    """What the robust likelihood leaves of each sample.

    Parameters
    ----------
    good : [sample, channel], 0 where not measured or far out of the noise: spikes, cycle skips
    soft : [sample, channel], 0 to 1, of the whitened residual
    """

    good: Tensor
    soft: Tensor


@dataclass(frozen=True)
class Evaluation:
    """What the vehicles of a state do.

    Parameters
    ----------
    values : of the effects' parameters at each row and channel
    local : strain rate of each vehicle alone and its local derivatives
    model : [sample, channel], 1/s
    """

    values: Values
    local: Sensitivities
    model: Tensor


@dataclass(frozen=True)
class Linearized:
    """A problem near a state.

    Parameters
    ----------
    jacobian : [sample * channel, parameter], whitened and weighted
    residual : [sample * channel], likewise
    weights : of the samples
    model : [sample, channel], 1/s
    local : strain rate of each vehicle alone and its local derivatives
    """

    jacobian: Tensor
    residual: Tensor
    weights: Weights
    model: Tensor
    local: Sensitivities

    @property
    def misfit(self) -> float:
        """Chi2 of the whitened, weighted residual."""
        return float((self.residual**2).sum())
