"""Maximum a posteriori fit of a spline route by Levenberg-Marquardt, with covariance.

Minimizes |W (d - f)|^2 + sum(((theta - prior) / sd)^2) over route, amplitudes, track shifts, wheel layouts, Poisson
ratio and what the effects in the model bring (Tarantola 2005, Inverse Problem Theory, eq. 3.51); W whitens the noise,
Huber weights bound the pull of bad samples.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from solver.cable import GaugeEnds, SplineBasis
from solver.extension import Values
from solver.fit.derivatives import Seen, derivative, observed_tangents
from solver.fit.prior import Rows, anchor_rows, shape_rows, track_cost, track_precision
from solver.fit.problem import Problem
from solver.load import layout_of
from solver.model import Fiber, Sensitivities, SignalPath, Vehicles
from solver.observation import BASE

KNOT_SPACING = 10.0
HUBER = 4.0
#: Times the scale of the residual beyond which a sample is no noise.
SPIKE = 7.0
SHALLOWEST = 0.02
#: A step that would gain less than this in sigmas, over all parameters together, is not worth taking.
ENOUGH = 0.2
#: Steps before a fit may be given up, and falls as predicted that it may hope for.
PATIENCE = 5
PER_PASS = ("amplitude", "along", "across", "wheelbase", "front_share")
#: What is wrong with a whole track: the passes together tell how large it is.
TRACK_ERRORS = ("along", "across")
#: Effect that fits the slow error of each track, and the variance of a cubic spline of unit coefficients.
SLOW_ERROR, SPLINE_VARIANCE = "track_jitter", 0.48


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


class MapFit:
    """One maximum a posteriori problem: residuals, priors, steps.

    Parameters
    ----------
    problem : the survey and the effects in its model
    knot_spacing : of the route, m
    known_ground : leave all but the vehicles as it is
    span : ends of the route, distance along the fiber, m; those of the problem where None
    """

    def __init__(
        self,
        problem: Problem,
        knot_spacing: float = KNOT_SPACING,
        known_ground: bool = False,
        span: tuple[float, float] | None = None,
    ):
        self.problem = problem
        self.basis = SplineBasis(*(span or problem.span), knot_spacing)
        self.path = problem.path
        self.extension = self.path.extension
        self.measured = problem.measured
        self.data = torch.where(self.measured, problem.strain_rate, 0.0)
        self.whiten = problem.whitener
        self._ends = GaugeEnds.of(self.basis, problem.distance, problem.gauge_length, problem.curved)
        self.mean, self.sd = self._prior()
        if known_ground:
            self._hold_ground()
        self.free = self.sd > 0

    def start(self) -> State:
        """Begin at the rough route and the expected Poisson ratio, without any effect."""
        route = torch.from_numpy(self.basis.interpolate(self.problem.distance, self.problem.start))
        return self.start_at(route, torch.tensor(self.problem.prior.poisson_ratio[0], dtype=torch.float64))

    def start_at(self, route: Tensor, nu: Tensor, numbers: Tensor | None = None) -> State:
        """Vehicles of their class, with the amplitudes that fit a route [coefficient, 3] best."""
        numbers = self.extension.numbers() if numbers is None else numbers
        state = State(route, Vehicles.of(self.problem.passes), nu, numbers)
        every = self.measured.double()
        return self.settled(state, Weights(every, every))

    def state_of(self, vector: Tensor) -> State:
        """The state of a vector [parameter], as `State.vector` gives it."""
        route = torch.zeros(self.basis.size, 3, dtype=torch.float64)
        nu = torch.zeros((), dtype=torch.float64)
        return State(route, Vehicles.of(self.problem.passes), nu, self.extension.numbers()).moved(vector)

    def bounded(self, state: State) -> State:
        """The same state with the effects' numbers within their bounds."""
        return replace(state, numbers=self.extension.bounded(state.numbers))

    def values(self, state: State) -> Values:
        """Values of the effects' parameters at each row and channel."""
        return self.extension.local(state.numbers)

    def ends_at(self, values: Values) -> GaugeEnds:
        """Basis matrices at the gauges' ends, as effects move them."""
        return self._ends_of(self.path, values)

    def _ends_of(self, path: SignalPath, values: Values, derivative: int = 0) -> GaugeEnds:
        stages = path.described(values)
        cable, gauge = stages.cable, stages.interrogator.gauge_length
        if path.extension.surroundings is None and not derivative:
            return self._ends
        within = path.curved or cable.path_integral is not BASE.cable.path_integral
        return GaugeEnds.at(self.basis, cable.distance, gauge, within, derivative)

    def fiber(self, state: State, values: Values) -> Fiber:
        """The gauges' ends on the route of a state."""
        return Fiber.of(self.ends_at(values), state.coefficients)

    def fiber_at(self, path: SignalPath, coefficients: Tensor, values: Values, derivative: int = 0) -> Fiber:
        """The gauges' ends on a route, in another path with more effects; or their derivative by distance."""
        return Fiber.of(self._ends_of(path, values, derivative), coefficients)

    def model(self, state: State) -> Tensor:
        """Strain rate [sample, channel], 1/s."""
        values = self.values(state)
        return self.path.strain_rate(self.fiber(state, values), state.vehicles, state.poisson_ratio, values)

    def settled(self, state: State, weights: Weights) -> State:
        """The same state with the amplitudes that fit best: they enter linearly, so no step need search for them."""
        traffic, values = self.problem.traffic, self.values(state)
        stages = self.path.described(values)
        if stages.nonlinear and bool((state.vehicles.amplitude != 1).any()):
            # What clips is not linear; the steps themselves find the amplitudes.
            return state
        vehicles = replace(state.vehicles, amplitude=torch.ones_like(state.vehicles.amplitude))
        fiber = self.fiber(state, values)
        rows = self.path.rows(fiber, vehicles.rows(traffic), state.poisson_ratio, values)
        alone = torch.zeros(traffic.passes, len(traffic.samples), rows.shape[1], dtype=torch.float64)
        alone[traffic.pass_index, traffic.sample_index] = rows
        alone = stages.linear.observed(alone, traffic.samples) * weights.good
        scale = weights.soft.sqrt()
        columns = (self.whiten(alone.permute(1, 2, 0)) * scale[..., None]).flatten(0, 1)
        data = (self.whiten(self.data * weights.good) * scale).flatten()
        matrix = columns.T @ columns
        # A vehicle that is not felt at all keeps an amplitude of zero.
        matrix += 1e-12 * matrix.diagonal().max() * torch.eye(traffic.passes, dtype=torch.float64)
        amplitude = torch.linalg.solve(matrix, columns.T @ data)
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
        numbers = self.extension.numbers()
        spread = np.zeros(self.extension.size)
        for slot in self.extension.slots:
            grid = slot.parameter.grid
            plausible = max(grid) - min(grid) if len(grid) > 1 else slot.parameter.plausible
            spread[slot.where] = p.prior.jitter if slot.effect.name == SLOW_ERROR else plausible
        mean = State(route, Vehicles.of(p.passes), torch.tensor(nu, dtype=torch.float64), numbers).vector()
        flat = np.concatenate([np.full(route.numel(), np.inf), *(sd[name] for name in PER_PASS), [nu_sd], spread])
        return mean, torch.from_numpy(flat)

    def _hold_ground(self) -> None:
        """Fix route, Poisson ratio and all of the effects that is not of single passes."""
        after = len(self.sd) - self.extension.size
        self.sd[: 3 * self.basis.size] = 0.0
        self.sd[after - 1] = 0.0
        for slot in self.extension.slots:
            if slot.parameter.scope not in ("pass", "track"):
                self.sd[after:][slot.where] = 0.0

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

    def precision(self, state: State) -> Tensor:
        """Precision [parameter] of the priors; those on the tracks' errors depend on how large they all are."""
        precision = self.sd**-2
        for name in TRACK_ERRORS:
            where = self.block(name)
            if bool(self.free[where].all()):
                precision[where] = track_precision(
                    getattr(state.vehicles, name), getattr(self.problem.prior, name), self.problem.prior.belief
                )
        return precision

    def block(self, name: str) -> slice:
        """Where the vector of all parameters holds one quantity of the passes."""
        passes = self.problem.traffic.passes
        first = 3 * self.basis.size + PER_PASS.index(name) * passes
        return slice(first, first + passes)

    def prior_cost(self, state: State) -> float:
        """-2 ln of the prior density of all but the route, but for a constant."""
        sd, tracks = self.sd.clone(), 0.0
        for name in TRACK_ERRORS:
            where = self.block(name)
            if bool(self.free[where].all()):
                sd[where] = torch.inf
                tracks += track_cost(
                    getattr(state.vehicles, name), getattr(self.problem.prior, name), self.problem.prior.belief
                )
        shift = (state.vector() - self.mean)[self.free] / sd[self.free]
        return float((shift**2).sum()) + tracks

    def prior_matrix(self, state: State) -> Tensor:
        """Normal matrix [free, free] of all priors, anchors left out."""
        return self.shape_matrix(state.coefficients) + torch.diag(self.precision(state)[self.free])

    def residual(self, state: State) -> Tensor:
        """(measured - model) / noise, [sample, channel], 0 where not measured; not whitened."""
        return torch.where(self.measured, self.data - self.model(state), 0.0) / self.problem.noise

    def whitened(self, state: State, weights: Weights) -> Tensor:
        """Whitened residual [sample, channel], with weights."""
        difference = torch.where(self.measured, self.data - self.model(state), 0.0)
        return self.whiten(difference * weights.good) * weights.soft.sqrt()

    def jacobian(self, state: State, local: Sensitivities, values: Values) -> Tensor:
        """Derivative of the model by every parameter, [sample, channel, parameter], 1/s per unit."""
        traffic = self.problem.traffic
        size, passes = self.basis.size, traffic.passes
        rows, channels = local.rate.shape
        route = torch.zeros(rows, channels, size, 3, dtype=torch.float64)
        for name, matrix in self.ends_at(values).matrices().items():
            pattern = "rck,cj->rcjk" if matrix.ndim == 2 else "rcqk,cqj->rcjk"
            route += torch.einsum(pattern, local.by[name], matrix)
        first = 3 * size + len(PER_PASS) * passes
        out = torch.zeros(len(traffic.samples), channels, first + 1, dtype=torch.float64)
        out[..., : 3 * size] = traffic.superpose(route.reshape(rows, channels, -1))
        for number, name in enumerate(PER_PASS):
            column = 3 * size + number * passes + traffic.pass_index
            out[traffic.sample_index, :, column] += local.by[name]
        out[..., first] = traffic.superpose(local.by["poisson_ratio"])
        if not self.extension.effects:
            return out
        alone = traffic.superpose(local.rate)
        columns = observed_tangents(self.path, alone, out.permute(2, 0, 1), values).permute(1, 2, 0)
        return torch.cat([columns, self.effect_columns(state, local, alone)], -1)

    def effect_columns(self, state: State, local: Sensitivities, alone: Tensor) -> Tensor:
        """Derivative of the model by the effects' numbers, [sample, channel, number]."""
        seen = Seen(
            self.path, lambda values: self.fiber(state, values), state.vehicles, state.poisson_ratio, local.rate, alone
        )
        columns = [derivative(seen, slot, state.numbers) for slot in self.extension.slots]
        return torch.cat(columns, 0).permute(1, 2, 0)

    def track_variance(self, local: Sensitivities) -> Tensor:
        """Variance, in noise units, that the uncertain track of each pass adds to each sample, [sample, channel].

        Where the tracks' slow errors are fitted, only what is beyond these counts.
        """
        traffic = self.problem.traffic
        fitted = any(one.name == SLOW_ERROR for one in self.extension.effects)
        slow = SPLINE_VARIANCE * self.problem.prior.jitter**2 if fitted else 0.0
        # The sigmas are of x and y; the shifts are along and across the heading.
        cosine, sine = (traffic.heading**2).unbind(-1)
        x, y = (traffic.sigma**2 - slow).clamp_min(0.0).unbind(-1)
        along = local.by["along"] ** 2 * (cosine * x + sine * y)[:, None]
        across = local.by["across"] ** 2 * (sine * x + cosine * y)[:, None]
        chosen = self.extension.chosen
        total = traffic.superpose(along + across)
        return (total if chosen is None else total[:, chosen]) / self.problem.noise**2

    def cost(self, state: State, weights: Weights) -> float:
        """Weighted misfit plus priors."""
        return float((self.whitened(state, weights) ** 2).sum()) + self.belief(state)

    def belief(self, state: State) -> float:
        """-2 ln of the prior density and of the anchors, but for a constant."""
        rows = sum(float((r.residual**2).sum()) for r in self.route_rows(state.coefficients))
        return self.prior_cost(state) + rows

    def buried(self, state: State) -> bool:
        """Whether the whole route is under the ground, where the half-space is."""
        everywhere = self.problem.distance_of(self.problem.route_channel)
        depth = torch.from_numpy(self.basis.at(everywhere)) @ state.coefficients[:, 2]
        return bool(depth.min() > SHALLOWEST)

    def normal(self, state: State) -> tuple[Tensor, Tensor, Weights]:
        """Normal matrix [free, free], right-hand side [free] and weights of the samples."""
        return self.normal_of(state, self.linearized(state))

    def normal_of(self, state: State, at: "Linearized") -> tuple[Tensor, Tensor, Weights]:
        """The same of a problem that is linearized already."""
        matrix, right = at.jacobian.T @ at.jacobian, at.jacobian.T @ at.residual
        for rows in self.route_rows(state.coefficients):
            route = rows.jacobian.shape[1]
            matrix[:route, :route] += rows.jacobian.T @ rows.jacobian
            right[:route] -= rows.jacobian.T @ rows.residual
        free = self.free
        precision = self.precision(state)[free]
        shift = (self.mean - state.vector())[free]
        return matrix[free][:, free] + torch.diag(precision), right[free] + precision * shift, at.weights

    def linearized(self, state: State) -> "Linearized":
        """The problem near a state: whitened, weighted residual and derivatives."""
        values = self.values(state)
        fiber = self.fiber(state, values)
        local = self.path.sensitivities(fiber, state.vehicles, state.poisson_ratio, values)
        model = self.path.observed(self.path.traffic.superpose(local.rate), values)
        difference = torch.where(self.measured, self.data - model, 0.0)
        tracks = self.track_variance(local) + self.problem.signal_noise * (model / self.problem.noise) ** 2
        good = self.measured * near_noise(difference / self.problem.noise / (1 + tracks).sqrt(), self.measured)
        residual = self.whiten(difference * good)
        soft = self.measured / (1 + tracks)
        soft = soft * huber(residual * soft.sqrt(), self.measured)
        jacobian = self.whiten(self.jacobian(state, local, values) * good[..., None]) * soft.sqrt()[..., None]
        return Linearized(jacobian.flatten(0, 1), (residual * soft.sqrt()).flatten(), Weights(good, soft), model, local)


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


def huber(residual: Tensor, measured: Tensor) -> Tensor:
    """Weights [...] that bound the pull of single bad samples (Huber 1964), on the scale of the residual itself."""
    scale = torch.clamp(1.4826 * residual[measured].abs().median(), min=1.0)
    return (HUBER * scale / residual.abs().clamp_min(1e-12)).clamp(max=1.0)


def near_noise(residual: Tensor, measured: Tensor) -> Tensor:
    """1 where a residual [...] may be noise, 0 for spikes: a filter must not smear them over their neighbors."""
    scale = torch.clamp(1.4826 * residual[measured].abs().median(), min=1.0)
    return (residual.abs() < SPIKE * scale).double()


@dataclass(frozen=True)
class Solution:
    """Where Levenberg-Marquardt ended, how many steps it took, whether it converged, and the problem there."""

    state: State
    iterations: int
    converged: bool
    at: Linearized


def solve(
    fit: MapFit,
    state: State,
    iterations: int = 40,
    advance: Callable[[int], None] = lambda n: None,
    hopeless: float = float("inf"),
) -> Solution:
    """Levenberg-Marquardt (Marquardt 1963) until the Newton decrement is small.

    The decrement, sqrt(g' H^-1 g) with gradient g and normal matrix H, is the length of the next step in posterior
    sigmas and the norm of what is left of the residual along all that is fitted: nothing else is called converged.

    Parameters
    ----------
    iterations : at most
    advance : called with 1 before each step
    hopeless : chi2; a fit that is not about to come below it is given up
    """
    free, damping, taken = fit.free, 1e-3, 0
    at, matrix, right = linear(fit, state)
    cost = at.misfit + fit.belief(state)
    while not (converged := (left := decrement(matrix, right)) < ENOUGH) and taken < iterations and damping < 1e8:
        # A quadratic misfit would fall by the decrement squared; this one by a few times that at most.
        if taken >= PATIENCE and at.misfit - PATIENCE * left**2 > hopeless:
            break
        taken += 1
        advance(1)
        step = torch.zeros_like(fit.mean)
        step[free] = torch.linalg.solve(matrix + damping * torch.diag(matrix.diagonal()), right)
        candidate = fit.bounded(state.moved(state.vector() + step))
        new_cost = np.inf
        if fit.buried(candidate):
            candidate = fit.settled(candidate, at.weights)
            new_cost = fit.cost(candidate, at.weights)
        if new_cost > cost:
            damping *= 8
            continue
        state, damping = candidate, max(damping / 8, 1e-9)
        at, matrix, right = linear(fit, state)
        cost = at.misfit + fit.belief(state)
    return Solution(state, taken, converged, at)


def linear(fit: MapFit, state: State) -> tuple[Linearized, Tensor, Tensor]:
    """A problem near a state, its normal matrix [free, free] and right-hand side [free]."""
    at = fit.linearized(state)
    matrix, right, _ = fit.normal_of(state, at)
    return at, matrix, right


def decrement(matrix: Tensor, right: Tensor) -> float:
    """Newton decrement sqrt(g' H^-1 g) of a normal matrix H [free, free] and right-hand side g [free].

    >>> round(decrement(torch.tensor([[4.0, 0.0], [0.0, 1.0]]), torch.tensor([6.0, 4.0])), 3)
    5.0
    """
    factor = torch.linalg.cholesky(matrix)
    return float(torch.linalg.solve_triangular(factor, right[:, None], upper=False).norm())
