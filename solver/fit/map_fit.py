"""A maximum a posteriori problem over one stretch of fiber: model, residual, derivatives.

What is minimized is |W (d - f)|^2 + sum(((theta - prior) / sd)^2) over route, amplitudes, track shifts, wheel layouts,
Poisson ratio and what the effects in the model bring (Tarantola 2005, Inverse Problem Theory, eq. 3.51); W whitens the
noise, Huber weights bound the pull of bad samples.
"""

from collections.abc import Iterator
from dataclasses import fields, replace

import torch
from torch import Tensor

from solver.cable.fiber import Fiber, GaugeEnds, SplineBasis, stations_within
from solver.cable.known_ends import ends_at
from solver.fit.model_columns import columns
from solver.fit.numbers import Numbers
from solver.fit.parameter_prior import ParameterPrior
from solver.fit.parameter_space import ParameterSpace
from solver.fit.problem import Problem
from solver.fit.residual import unexplained
from solver.fit.robust import huber, near_noise, scale_of, solved_amplitudes
from solver.fit.state import Evaluation, Linearized, State, Weights
from solver.fit.windowed import Windowed
from solver.signal_path.extension import Values
from solver.signal_path.gauges import Gauges
from solver.signal_path.local import Section
from solver.signal_path.observation import Description
from solver.signal_path.sensitivities import Sensitivities
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import Vehicles

#: Variance of a cubic spline of unit coefficients.
SPLINE_VARIANCE = 0.48


class MapFit(ParameterSpace):
    """One maximum a posteriori problem.

    Parameters
    ----------
    problem : the survey and the effects in its model
    known_ground : leave all but the vehicles as it is
    basis : of the route; the problem's where None
    ends : basis matrices at the gauges' ends, where they are known already
    """

    def __init__(
        self,
        problem: Problem,
        known_ground: bool = False,
        basis: SplineBasis | None = None,
        ends: GaugeEnds | None = None,
    ):
        self.path = problem.path
        self.extension = self.path.extension
        prior = ParameterPrior(
            basis or problem.basis,
            problem.prior,
            problem.passes,
            problem.anchors,
            problem.anchor_distance,
            Numbers.of(self.extension, problem.prior),
            known_ground,
            self.extension,
        )
        super().__init__(problem, prior)
        self.measured = problem.measured
        self.data = torch.where(self.measured, problem.strain_rate, 0.0)
        self.whiten = problem.whitener
        self.ends = ends or GaugeEnds.of(self.basis, problem.distance, problem.gauge_length, problem.curved)

    def begun(self, state: State) -> State:
        """The same vehicles with the amplitudes that fit best."""
        every = self.measured.double()
        return self.settled(state, Weights(every, every))

    def values(self, state: State) -> Values:
        """Values of the effects' parameters at each row and channel."""
        return self.extension.local(state.numbers)

    def ends_of(self, path: SignalPath, stages: Description) -> GaugeEnds:
        """Basis matrices at the gauges' ends, as effects move them."""
        cable, gauge = stages.cable, stages.gauge
        if path.extension.surroundings is None:
            return self.ends
        graded = stages.ground.compliance is not None
        within = path.curved or graded or isinstance(cable.path_integral, Tensor)
        held = None if cable.loose is None else (cable.loose.begin, cable.loose.end)
        inner = stations_within(self.problem.gauge_length, self.basis) if within else 0
        return ends_at(self.basis, cable.distance, gauge, inner, held)

    def fiber(self, state: State, values: Values) -> Fiber:
        """The gauges' ends on the route of a state."""
        return self.fiber_at(self.path, state.coefficients, self.path.described(values))

    def fiber_at(self, path: SignalPath, coefficients: Tensor, stages: Description) -> Fiber:
        """The gauges' ends on a route, in another path with more effects."""
        return Fiber.of(self.ends_of(path, stages), coefficients)

    def gauges_at(self, path: SignalPath, coefficients: Tensor, stages: Description) -> Gauges:
        """The same as the ground moves them."""
        return Gauges.of(self.fiber_at(path, coefficients, stages), stages, path.curved)

    def model(self, state: State) -> Tensor:
        """Strain rate [sample, channel], 1/s."""
        values = self.values(state)
        return self.path.strain_rate(self.fiber(state, values), state.vehicles, state.poisson_ratio, values)

    def evaluate(self, state: State) -> Evaluation:
        """What the vehicles of a state do, with the local derivatives."""
        values = self.values(state)
        local = self.path.sensitivities(self.fiber(state, values), state.vehicles, state.poisson_ratio, values)
        return Evaluation(values, local, self.path.observed(self.path.traffic.superpose(local.rate), values))

    def glance(self, state: State) -> Evaluation:
        """The same with the derivatives that weights need alone, a tenth of all."""
        values = self.values(state)
        local = self.path.shifts(self.fiber(state, values), state.vehicles, state.poisson_ratio, values)
        return Evaluation(values, local, self.path.observed(self.path.traffic.superpose(local.rate), values))

    def settled(self, state: State, weights: Weights) -> State:
        """The same state with the amplitudes that fit best: they enter linearly, so no step need search for them."""
        return self.settled_at(state, weights)[0]

    def settled_at(self, state: State, weights: Weights) -> tuple[State, float]:
        """The same, and its cost, from one look at what the vehicles do."""
        values = self.values(state)
        if self.path.described(values).nonlinear and bool((state.vehicles.amplitude != 1).any()):
            # What clips is not linear; the steps themselves find the amplitudes.
            return state, self.cost(state, weights)
        rows = self.unit_rows(state, values)
        amplitude = self.amplitudes(rows, values, weights)
        state = replace(state, vehicles=replace(state.vehicles, amplitude=amplitude))
        whole = self.path.traffic.superpose(amplitude[self.path.traffic.pass_index][:, None] * rows)
        return state, self.cost(state, weights, self.path.observed(whole, values))

    def unit_rows(self, state: State, values: Values) -> Tensor:
        """What each vehicle of a state does alone with unit amplitude, [row, channel]."""
        unit = replace(state.vehicles, amplitude=torch.ones_like(state.vehicles.amplitude))
        fiber = self.fiber(state, values)
        return self.path.rows(fiber, unit.rows(self.path.traffic), state.poisson_ratio, values)

    def strengthened(self, state: State, evaluation: Evaluation, amplitude: Tensor) -> tuple[State, Evaluation]:
        """The same state with other amplitudes [pass], and the evaluation there, from that with the old ones."""
        local = replace(evaluation.local, amplitude=amplitude[self.path.traffic.pass_index])
        model = self.path.observed(self.path.traffic.superpose(local.rate), evaluation.values)
        new = replace(state, vehicles=replace(state.vehicles, amplitude=amplitude))
        return new, Evaluation(evaluation.values, local, model)

    def alone(self, rows: Tensor, values: Values) -> Tensor:
        """Maps [pass, sample, channel] of each vehicle, by what each of unit amplitude does alone, [row, channel]."""
        traffic = self.path.traffic
        alone = torch.zeros(traffic.passes, len(traffic.samples), rows.shape[1], dtype=torch.float64)
        alone[traffic.pass_index, traffic.sample_index] = rows
        return self.path.described(values).linear.observed(alone, traffic.samples)

    def amplitudes(self, rows: Tensor, values: Values, weights: Weights) -> Tensor:
        """Amplitudes [pass] that fit best, by what each vehicle of unit amplitude does alone, [row, channel]."""
        white = self.whiten.weighing(weights.good, weights.soft.sqrt())
        columns = white(self.alone(rows, values)).flatten(1)
        data = white(self.data).flatten()
        return solved_amplitudes(columns @ columns.T, columns @ data)

    def unexplained(self, model: Tensor) -> Tensor:
        """Measured - model [sample, channel], 1/s; 0 where not measured."""
        return unexplained(self.data, model, self.measured)

    def residual(self, state: State) -> Tensor:
        """(measured - model) / noise, [sample, channel], 0 where not measured; not whitened."""
        return self.unexplained(self.model(state)) / self.problem.noise

    def whitened_of(self, model: Tensor, weights: Weights) -> Tensor:
        """Whitened residual [sample, channel] of a model [sample, channel], 1/s, with weights."""
        return self.whiten.weighing(weights.good, weights.soft.sqrt())(self.unexplained(model))

    def jacobian(self, state: State, local: Sensitivities, values: Values) -> Tensor:
        """`columns` by every parameter at once, [parameter, sample, channel]."""
        out, first = torch.empty(self.layout.size, *self.data.shape, dtype=torch.float64), 0
        for some in columns(self, state, local, values):
            out[first : first + len(some)] = some
            first += len(some)
        return out

    def free_columns(
        self, state: State, local: Sensitivities, values: Values, section: Section | None = None
    ) -> Iterator[Tensor]:
        """`columns` by all that is free, [free, sample, channel]."""
        first = 0
        for some in columns(self, state, local, values, section):
            free = self.free[first : first + len(some)]
            first += len(some)
            if bool(free.any()):
                yield some if bool(free.all()) else some[free]

    def whitened_columns(self, state: State, evaluation: Evaluation, weights: Weights) -> Windowed:
        """Derivatives [sample * channel, free] by all that is free, whitened and weighted, each where it acts."""
        fitted = self.free_columns(state, evaluation.local, evaluation.values)
        white = self.whiten.weighing(weights.good, weights.soft.sqrt())
        return Windowed.through_each(fitted, white, self.whiten.memory)

    def track_variance(self, local: Sensitivities) -> Tensor:
        """Variance, in noise units, that the uncertain track of each pass adds to each sample, [sample, channel].

        Where the tracks' slow errors are fitted, only what is beyond these counts.
        """
        traffic = self.path.traffic
        fitted = any(one.slow_error for one in self.extension.effects)
        slow = SPLINE_VARIANCE * self.problem.prior.jitter**2 if fitted else 0.0
        # The sigmas are of x and y; the shifts are along and across the heading.
        cosine, sine = (traffic.heading**2).unbind(-1)
        x, y = (traffic.sigma**2 - slow).clamp_min(0.0).unbind(-1)
        along = local.vehicle("along") ** 2 * (cosine * x + sine * y)[:, None]
        across = local.vehicle("across") ** 2 * (sine * x + cosine * y)[:, None]
        return self.of_record(along + across) / self.problem.noise**2

    def of_record(self, rows: Tensor) -> Tensor:
        """Sums [sample, channel], where it was measured, over vehicles of what each has [row, channel]."""
        total = self.path.traffic.superpose(rows)[torch.from_numpy(self.path.traffic.sampled)]
        return total if self.extension.chosen is None else total[:, self.extension.chosen]

    def added_variance(self, local: Sensitivities, model: Tensor) -> Tensor:
        """Variance, in noise units, beside the noise's own: uncertain tracks, noise that grows with the signal.

        What uncertain tracks add is told of the ground; what comes after it leaves as much of that as of the signal.
        """
        ground = self.of_record(local.rate).square().sum().clamp_min(1e-300)
        tracks = self.track_variance(local) * (model.square().sum() / ground)
        return tracks + self.problem.signal_noise * (model / self.problem.noise) ** 2

    def cost(self, state: State, weights: Weights, model: Tensor | None = None) -> float:
        """Weighted misfit plus priors; `model` [sample, channel], 1/s, there if known."""
        model = self.model(state) if model is None else model
        return float((self.whitened_of(model, weights) ** 2).sum()) + self.prior.total(state)

    def weighted(self, evaluation: Evaluation) -> tuple[Weights, Tensor]:
        """Weights of the samples, and the whitened residual [sample, channel] of those that are not spikes."""
        difference, variance = self.compared(evaluation)
        size = difference / self.problem.noise / variance.sqrt()
        good = self.measured * near_noise(size, scale_of(size, self.measured))
        residual = self.whiten.weighing(good)(difference)
        soft = self.measured / variance
        return Weights(good, soft * huber(residual * soft.sqrt(), self.measured)), residual

    def compared(self, evaluation: Evaluation) -> tuple[Tensor, Tensor]:
        """Measured - model, 1/s, and the variance of that in noise units, both [sample, channel]."""
        return self.unexplained(evaluation.model), 1 + self.added_variance(evaluation.local, evaluation.model)

    def linearized(self, state: State, evaluation: Evaluation | None = None) -> Linearized:
        """The problem near a state: whitened, weighted residual and derivatives; `evaluation` there if known."""
        evaluation = evaluation or self.evaluate(state)
        weights, residual = self.weighted(evaluation)
        return Linearized(
            self.whitened_columns(state, evaluation, weights),
            (residual * weights.soft.sqrt()).flatten(),
            weights,
            evaluation.model,
            evaluation.local,
        )


def vehicles_of(vehicles: Vehicles, chosen: Tensor) -> Vehicles:
    """Some of the vehicles [chosen]."""
    return Vehicles(*(getattr(vehicles, f.name)[chosen] for f in fields(vehicles)))
