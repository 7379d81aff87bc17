"""What is fitted, and where a fit is linearized."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from solver.fit.parameter_layout import AXES, PER_PASS, Layout
from solver.fit.windowed import Windowed
from solver.signal_path.extension import Values
from solver.signal_path.sensitivities import Sensitivities
from solver.signal_path.traffic import Vehicles

#: Least and largest Poisson ratio of a fit. Isotropic solids lie between -1 and .5; the prior keeps soils near .25, and
#: a limit at 0, where a wrong model may press it, would stop a fit before it converges.
POISSON = (-0.95, 0.495)


@dataclass(frozen=True)
class State:
    """All that is fitted: route coefficients [knot, 3] (m), vehicles, Poisson ratio [], numbers of the effects."""

    coefficients: Tensor
    vehicles: Vehicles
    poisson_ratio: Tensor
    numbers: Tensor

    @property
    def layout(self) -> Layout:
        """Where `vector` holds what."""
        return Layout(len(self.coefficients), len(self.vehicles.amplitude), len(self.numbers))

    def vector(self) -> Tensor:
        """All in one vector [parameter], laid out as `layout` says."""
        per_pass = [getattr(self.vehicles, name) for name in PER_PASS]
        return torch.cat([self.coefficients.reshape(-1), *per_pass, self.poisson_ratio.reshape(1), self.numbers])

    def moved(self, vector: Tensor) -> "State":
        """The state that `vector` [parameter] describes, of the same vehicles."""
        return State.of(vector, self.layout, self.vehicles)

    @classmethod
    def of(cls, vector: Tensor, layout: Layout, vehicles: Vehicles) -> "State":
        """The state of a vector [parameter]; `vehicles` have what is not fitted of them."""
        return cls(
            vector[layout["route"]].reshape(-1, AXES),
            replace(vehicles, **{name: vector[layout[name]] for name in PER_PASS}),
            vector[layout["poisson_ratio"]][0].clamp(*POISSON),
            vector[layout["numbers"]],
        )


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
    jacobian : [sample * channel, free parameter], whitened and weighted
    residual : [sample * channel], likewise
    weights : of the samples
    model : [sample, channel], 1/s
    local : strain rate of each vehicle alone and its local derivatives
    """

    jacobian: Windowed
    residual: Tensor
    weights: Weights
    model: Tensor
    local: Sensitivities

    @property
    def bare(self) -> "Linearized":
        """Without derivatives by what is fitted."""
        return replace(self, jacobian=Windowed((), self.jacobian.rows, 0))

    @property
    def misfit(self) -> float:
        """Chi2 of the whitened, weighted residual."""
        return float((self.residual**2).sum())
