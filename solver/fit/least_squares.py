"""Maximum a posteriori fit of a spline route by Levenberg-Marquardt, with covariance.

Minimizes sum(((d - f) / sigma)^2) + sum(((theta - prior) / sd)^2) over route, amplitudes, track shifts, wheel layouts
and Poisson ratio (Tarantola 2005, Inverse Problem Theory, eq. 3.51), with Huber weights for bad samples.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from solver.cable import SplineBasis
from solver.fit.prior import Rows, anchor_rows, shape_rows
from solver.fit.problem import Problem
from solver.load import layout_of
from solver.model import Fiber, Sensitivities, Vehicles

KNOT_SPACING = 10.0
HUBER = 4.0
SHALLOWEST = 0.1
PER_PASS = ("amplitude", "along", "across", "wheelbase", "front_share")


@dataclass(frozen=True)
class State:
    """All that is fitted: route coefficients [knot, 3] (m), vehicles, Poisson ratio []."""

    coefficients: Tensor
    vehicles: Vehicles
    poisson_ratio: Tensor

    def vector(self) -> Tensor:
        """One vector: route, then each per-pass quantity, then the Poisson ratio."""
        per_pass = [getattr(self.vehicles, name) for name in PER_PASS]
        return torch.cat([self.coefficients.reshape(-1), *per_pass, self.poisson_ratio.reshape(1)])

    def moved(self, vector: Tensor) -> "State":
        """The state that `vector` describes."""
        shape, passes = self.coefficients.shape, len(self.vehicles.amplitude)
        route, rest = vector[: self.coefficients.numel()], vector[self.coefficients.numel() : -1]
        columns = dict(zip(PER_PASS, rest.reshape(len(PER_PASS), passes), strict=True))
        return State(route.reshape(shape), replace(self.vehicles, **columns), vector[-1].clamp(0.0, 0.495))


class MapFit:
    """One maximum a posteriori problem: residuals, priors, steps.

    Parameters
    ----------
    problem : the survey
    knot_spacing : of the route, m
    known_ground : leave route and Poisson ratio as they are and fit the vehicles only
    """

    def __init__(self, problem: Problem, knot_spacing: float = KNOT_SPACING, known_ground: bool = False):
        self.problem = problem
        self.basis = SplineBasis(*problem.span, knot_spacing)
        self.ends = problem.ends(self.basis)
        self.path = problem.path
        self.measured = problem.measured
        self.data = torch.where(self.measured, problem.strain_rate, 0.0)
        self.mean, self.sd = self._prior()
        if known_ground:
            self.sd[: 3 * self.basis.size] = 0.0
            self.sd[-1] = 0.0
        self.free = self.sd > 0

    def start(self) -> State:
        """Begin at the rough route and the expected Poisson ratio."""
        route = torch.from_numpy(self.basis.interpolate(self.problem.distance, self.problem.start))
        return self.start_at(route, torch.tensor(self.problem.prior.poisson_ratio[0], dtype=torch.float64))

    def start_at(self, route: Tensor, nu: Tensor) -> State:
        """Vehicles of their class, with the amplitudes that fit a route [coefficient, 3] best."""
        return self.settled(State(route, Vehicles.of(self.problem.passes), nu), self.measured.double())

    def settled(self, state: State, weight: Tensor) -> State:
        """The same state with the amplitudes that fit best: they enter linearly, so no step need search for them."""
        traffic = self.problem.traffic
        vehicles = replace(state.vehicles, amplitude=torch.ones_like(state.vehicles.amplitude))
        rows = self.path.rows(Fiber.of(self.ends, state.coefficients), vehicles.rows(traffic), state.poisson_ratio)
        alone = torch.zeros(traffic.passes, *self.data.shape, dtype=torch.float64)
        alone[traffic.pass_index, traffic.sample_index] = rows
        scale = weight.sqrt() / self.problem.noise
        alone = (alone * scale).flatten(1)
        matrix = alone @ alone.T
        # A vehicle that is not felt at all keeps an amplitude of zero.
        matrix += 1e-12 * matrix.diagonal().max() * torch.eye(traffic.passes, dtype=torch.float64)
        amplitude = torch.linalg.solve(matrix, alone @ (self.data * scale).flatten())
        return replace(state, vehicles=replace(vehicles, amplitude=amplitude))

    def _prior(self) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of every parameter [parameter]; sd inf for the route (see `route_rows`)."""
        p = self.problem
        layouts = [layout_of(one.vehicle_class) for one in p.passes]
        sd = {
            "amplitude": [np.inf] * len(layouts),
            "along": [p.prior.along] * len(layouts),
            "across": [p.prior.across] * len(layouts),
            "wheelbase": [layout.wheelbase_sd for layout in layouts],
            "front_share": [layout.front_share_sd for layout in layouts],
        }
        route = torch.zeros(self.basis.size, 3, dtype=torch.float64)
        nu, nu_sd = p.prior.poisson_ratio
        mean = State(route, Vehicles.of(p.passes), torch.tensor(nu, dtype=torch.float64)).vector()
        flat = np.concatenate([np.full(route.numel(), np.inf), *(sd[name] for name in PER_PASS), [nu_sd]])
        return mean, torch.from_numpy(flat)

    def route_rows(self, coefficients: Tensor) -> tuple[Rows, Rows]:
        """Rows of the prior on the route's shape, and of its anchors."""
        p = self.problem
        return (
            shape_rows(self.basis, p.prior, coefficients),
            anchor_rows(self.basis, p.anchors, p.anchor_distance, coefficients),
        )

    def shape_matrix(self, coefficients: Tensor) -> Tensor:
        """Normal matrix [free, free] of the prior on the route's shape alone."""
        rows = self.route_rows(coefficients)[0].jacobian
        matrix = torch.zeros(len(self.mean), len(self.mean), dtype=torch.float64)
        matrix[: rows.shape[1], : rows.shape[1]] = rows.T @ rows
        return matrix[self.free][:, self.free]

    def prior_matrix(self, coefficients: Tensor) -> Tensor:
        """Normal matrix [free, free] of all priors, anchors left out."""
        return self.shape_matrix(coefficients) + torch.diag(self.sd[self.free] ** -2)

    def residual(self, state: State) -> Tensor:
        """(measured - model) / noise, [sample, channel], 0 where not measured."""
        model = self.path.strain_rate(Fiber.of(self.ends, state.coefficients), state.vehicles, state.poisson_ratio)
        return torch.where(self.measured, self.data - model, 0.0) / self.problem.noise

    def jacobian(self, local: Sensitivities) -> Tensor:
        """Derivative of the model in noise units by every parameter, [sample, channel, parameter]."""
        traffic = self.problem.traffic
        size, passes = self.basis.size, traffic.passes
        rows, channels = local.rate.shape
        route = torch.zeros(rows, channels, size, 3, dtype=torch.float64)
        for f in fields(Fiber):
            route += torch.einsum("rck,cj->rcjk", local.by[f.name], getattr(self.ends, f.name))
        out = torch.zeros(len(traffic.samples), channels, len(self.mean), dtype=torch.float64)
        out[..., : 3 * size] = traffic.superpose(route.reshape(rows, channels, -1))
        for number, name in enumerate(PER_PASS):
            column = 3 * size + number * passes + traffic.pass_index
            out[traffic.sample_index, :, column] += local.by[name]
        out[..., -1] = traffic.superpose(local.by["poisson_ratio"])
        return out / self.problem.noise[:, None]

    def track_variance(self, local: Sensitivities) -> Tensor:
        """Variance, in noise units, that the uncertain track of each pass adds to each sample, [sample, channel]."""
        traffic = self.problem.traffic
        # The sigmas are of x and y; the shifts are along and across the heading.
        cosine, sine = (traffic.heading**2).unbind(-1)
        x, y = (traffic.sigma**2).unbind(-1)
        along = local.by["along"] ** 2 * (cosine * x + sine * y)[:, None]
        across = local.by["across"] ** 2 * (sine * x + cosine * y)[:, None]
        return traffic.superpose(along + across) / self.problem.noise**2

    def cost(self, state: State, weight: Tensor) -> float:
        """Weighted misfit plus priors."""
        shift = (state.vector() - self.mean)[self.free] / self.sd[self.free]
        rows = sum(float((r.residual**2).sum()) for r in self.route_rows(state.coefficients))
        return float((weight * self.residual(state) ** 2).sum() + (shift**2).sum()) + rows

    def buried(self, state: State) -> bool:
        """Whether the whole route is under the ground, where the half-space is."""
        everywhere = self.problem.distance_of(self.problem.route_channel)
        depth = torch.from_numpy(self.basis.at(everywhere)) @ state.coefficients[:, 2]
        return bool(depth.min() > SHALLOWEST)

    def normal(self, state: State) -> tuple[Tensor, Tensor, Tensor]:
        """Normal matrix [free, free], right-hand side [free] and sample weights [sample, channel]."""
        local = self.path.sensitivities(Fiber.of(self.ends, state.coefficients), state.vehicles, state.poisson_ratio)
        model = self.path.traffic.superpose(local.rate)
        residual = torch.where(self.measured, self.data - model, 0.0) / self.problem.noise
        weight = self.measured / (1 + self.track_variance(local))
        weight = weight * huber(residual * weight.sqrt(), self.measured)
        jacobian = (self.jacobian(local) * weight.sqrt()[..., None]).reshape(-1, len(self.mean))
        matrix = jacobian.T @ jacobian
        right = jacobian.T @ (residual * weight.sqrt()).reshape(-1)
        for rows in self.route_rows(state.coefficients):
            route = rows.jacobian.shape[1]
            matrix[:route, :route] += rows.jacobian.T @ rows.jacobian
            right[:route] -= rows.jacobian.T @ rows.residual
        free = self.free
        precision = self.sd[free] ** -2
        shift = (self.mean - state.vector())[free]
        return matrix[free][:, free] + torch.diag(precision), right[free] + precision * shift, weight


def huber(residual: Tensor, measured: Tensor) -> Tensor:
    """Weights [...] that bound the pull of single bad samples (Huber 1964), on the scale of the residual itself."""
    scale = torch.clamp(1.4826 * residual[measured].abs().median(), min=1.0)
    return (HUBER * scale / residual.abs().clamp_min(1e-12)).clamp(max=1.0)


@dataclass(frozen=True)
class Solution:
    """Where Levenberg-Marquardt ended, how many steps it took and whether it converged."""

    state: State
    iterations: int
    converged: bool


def solve(fit: MapFit, state: State, iterations: int = 40, advance: Callable[[int], None] = lambda n: None) -> Solution:
    """Levenberg-Marquardt (Marquardt 1963) until the cost stands still or steps are small in posterior sigmas."""
    free, damping, converged, step_number = fit.free, 1e-3, False, 0
    matrix, right, weight = fit.normal(state)
    cost = fit.cost(state, weight)
    while step_number < iterations and damping < 1e8 and not converged:
        step_number += 1
        advance(1)
        step = torch.zeros_like(fit.mean)
        step[free] = torch.linalg.solve(matrix + damping * torch.diag(matrix.diagonal()), right)
        candidate = state.moved(state.vector() + step)
        new_cost = np.inf
        if fit.buried(candidate):
            candidate = fit.settled(candidate, weight)
            new_cost = fit.cost(candidate, weight)
        if new_cost > cost:
            damping *= 8
            continue
        fall = cost - new_cost
        state, damping = candidate, max(damping / 8, 1e-9)
        matrix, right, weight = fit.normal(state)
        cost = fit.cost(state, weight)
        largest = float((step[free].abs() * matrix.diagonal().sqrt()).max())
        converged = fall < 1e-3 * max(1.0, 1e-3 * cost) or largest < 0.02
    return Solution(state, step_number, converged)
