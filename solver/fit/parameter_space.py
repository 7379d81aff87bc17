"""What a problem and a chain of them have in common: their parameters, where a fit begins, how far it may go."""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from solver.fit.parameter_prior import ParameterPrior
from solver.fit.prior import shape_grid
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.signal_path.traffic import Vehicles

#: Least depth of a route, m, which the wall in its prior stops a fit short of.
SHALLOWEST = 0.001


class ParameterSpace(ABC):
    """All that is fitted of a survey.

    Parameters
    ----------
    problem : the survey
    prior : on all that is fitted
    """

    def __init__(self, problem: Problem, prior: ParameterPrior):
        self.problem, self.prior = problem, prior
        self.basis, self.passes, self.layout = prior.basis, prior.passes, prior.layout
        self.mean, self.sd, self.free = prior.mean, prior.sd, prior.free

    @abstractmethod
    def begun(self, state: State) -> State:
        """A start whose vehicles have unit amplitude, with the amplitudes that fit best where that is known at once."""

    def start(self) -> State:
        """Begin at the rough route and the expected Poisson ratio, without any effect."""
        route = torch.from_numpy(self.basis.interpolate(self.problem.distance, self.problem.start))
        return self.start_at(route, torch.tensor(self.problem.prior.poisson_ratio[0], dtype=torch.float64))

    def start_at(self, route: Tensor, nu: Tensor, numbers: Tensor | None = None) -> State:
        """Vehicles of their class on a route [coefficient, 3], m; `numbers` [number] of the effects, or their null."""
        numbers = self.prior.numbers.mean if numbers is None else numbers
        return self.begun(State(route, Vehicles.of(self.passes), nu, numbers))

    def state_of(self, vector: Tensor) -> State:
        """The state of a vector [parameter], as `State.vector` gives it."""
        return State.of(vector, self.layout, Vehicles.of(self.passes))

    def bounded(self, state: State) -> State:
        """The same state with the effects' numbers within their bounds; what is smooth is bounded number by number."""
        return replace(state, numbers=self.prior.numbers.bounded(state.numbers))

    def buried(self, state: State) -> bool:
        """Whether the whole route is under the ground, where the half-space is."""
        channels = self.problem.distance_of(self.problem.route_channel)
        everywhere = np.concatenate([channels, shape_grid(self.basis)])
        return bool(self.basis.along(state.coefficients[:, 2].numpy(), everywhere).min() > SHALLOWEST)
