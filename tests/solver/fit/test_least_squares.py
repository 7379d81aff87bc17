"""Derivatives, priors and steps of the maximum a posteriori fit."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver import simulator
from solver.cable.fiber import SplineBasis
from solver.fit.chain import Chain
from solver.fit.least_squares import PATIENCE, solve
from solver.fit.map_fit import MapFit
from solver.fit.prior import Prior, anchor_rows, shape_rows, track_cost, track_precision
from solver.fit.robust import huber
from solver.fit.spline import fit_spline
from solver.signal_path.traffic import Traffic
from tests.solver.simulated import case_of


def test_jacobian_by_finite_differences(case) -> None:
    fit = MapFit(case.problem)
    state = fit.start()
    local = fit.path.sensitivities(fit.fiber(state, {}), state.vehicles, state.poisson_ratio)
    jacobian = fit.jacobian(state, local, {}) / case.problem.noise
    vector = state.vector()
    rng = np.random.default_rng(0)
    columns = [*rng.choice(3 * fit.basis.size, 6, replace=False), *range(3 * fit.basis.size, len(vector), 3), -1]
    for column in columns:
        step = 1e-4 * max(abs(float(vector[column])), 1e-4 if float(vector[column]) else 1.0)
        ahead, behind = vector.clone(), vector.clone()
        ahead[column] += step
        behind[column] -= step
        numeric = (fit.residual(state.moved(behind)) - fit.residual(state.moved(ahead))) / (2 * step)
        expected = torch.where(fit.measured, jacobian[column], 0.0)
        torch.testing.assert_close(numeric, expected, rtol=1e-4, atol=1e-5 * float(expected.abs().max()))


def test_a_glance_has_the_derivatives_that_weights_need(case, monkeypatch) -> None:
    monkeypatch.setattr("solver.signal_path.signal_path.AT_ONCE", 1)  # row by row
    fit = MapFit(case.problem)
    state = fit.start()
    whole, glance = fit.evaluate(state), fit.glance(state)
    assert glance.local.bytes < 0.2 * whole.local.bytes
    torch.testing.assert_close(glance.model, whole.model)
    torch.testing.assert_close(fit.weighted(glance)[0].soft, fit.weighted(whole)[0].soft)


@pytest.mark.parametrize("rows", ["shape", "anchors"])
def test_prior_rows_by_finite_differences(case, rows: str) -> None:
    basis = SplineBasis.even(0.0, 60.0, 10.0)
    rng = np.random.default_rng(1)
    aside, depth = rng.normal(4, 1, basis.size), rng.uniform(0.1, 0.4, basis.size)
    route = torch.from_numpy(np.column_stack([np.linspace(-10, 70, basis.size), aside, depth]))

    def at(coefficients: torch.Tensor):
        if rows == "shape":
            return shape_rows(basis, Prior(), coefficients)
        place = torch.tensor([20.0, 41.5], dtype=torch.float64)
        return anchor_rows(basis, case.problem.anchors, place, torch.zeros(2, 0, dtype=torch.float64), coefficients)

    numeric = torch.autograd.functional.jacobian(lambda c: at(c).residual, route).flatten(1)
    torch.testing.assert_close(at(route).jacobian, numeric)


def test_huber_leaves_good_samples_and_bounds_bad_ones() -> None:
    residual = torch.from_numpy(np.random.default_rng(2).normal(size=(200, 10)))
    residual[3, 4] = 100.0
    weight = huber(residual, torch.ones_like(residual, dtype=torch.bool))
    assert float(weight[3, 4] * residual[3, 4]) < 5.0
    assert float((weight == 1).double().mean()) > 0.99


def test_the_end_is_a_minimum(case) -> None:
    fit = MapFit(case.problem)
    end = solve(fit, fit.start())
    assert end.converged
    matrix, right = Chain.single(fit).dense(end.state, [fit.linearized(end.state)])
    decrement = float(right @ torch.linalg.solve(matrix, right)) ** 0.5
    assert decrement < 0.2
    assert Chain.single(fit).visit(end.state).normal.decrement == pytest.approx(decrement, rel=1e-6)
    assert end.iterations < 10


def test_a_step_that_is_not_taken_has_no_derivatives(case, monkeypatch) -> None:
    """Most of a visit is derivatives, and the cost is known before them."""
    fit = MapFit(case.problem)
    chain, start = Chain.single(fit), fit.start()
    before = chain.visit(start)
    whole = chain.visit(start, before.weights)
    monkeypatch.setattr(MapFit, "whitened_columns", lambda *_: pytest.fail("derivatives that nothing asks for"))
    assert chain.tried(start, before.weights, whole.cost * (1 - 1e-9)) is None
    with pytest.raises(pytest.fail.Exception):
        chain.tried(start, before.weights, whole.cost * (1 + 1e-9))


def test_a_route_that_is_pulled_out_of_the_ground_converges(case) -> None:
    """Loads taken for deeper than they look press the route against the surface."""
    shallow = replace(case.problem.prior, depth=(0.15, 0.01))
    fit = MapFit(replace(case.problem, prior=shallow, anchors=case.problem.anchors[:0]))
    end = solve(fit, fit.start())
    assert end.converged and fit.buried(end.state)


def test_a_fit_that_its_record_pushes_out_of_the_ground_converges() -> None:
    """Of a stiffness contrast that the model lacks; a weaker wall, or a Poisson ratio of 0 at least, holds steps up."""
    contrast = simulator.Scenario(name="soft", seed=5, passes=4, snr_db=24.0, effects={"stiffness_contrast": -0.9})
    fit = MapFit(case_of(simulator.simulate(contrast)).problem)
    end = solve(fit, fit.start())
    assert end.converged and fit.buried(end.state)


def test_steps_that_swing_about_their_end_are_mixed() -> None:
    """Of loads on wheels as of points much is left: each whole step goes too far and the next one takes it back."""
    point_loads = simulator.Scenario(name="points", seed=2, passes=4, snr_db=18.0, effects={"wheel_layout": 1.0})
    fit = MapFit(case_of(simulator.simulate(point_loads)).problem)
    assert solve(fit, fit.start()).converged  # after 50 steps that know nothing of one another


def test_out_of_steps_is_not_converged(case) -> None:
    fit = MapFit(case.problem)
    assert not solve(fit, fit.start(), iterations=1).converged


def test_a_fit_on_the_wrong_side_is_given_up(case) -> None:
    fit = MapFit(case.problem)
    route = fit.start().coefficients
    mirrored = route * torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)
    wrong = fit.start_at(mirrored, torch.tensor(0.25, dtype=torch.float64))
    end = solve(fit, wrong, hopeless=1.2 * float(fit.measured.sum()))
    assert PATIENCE <= end.iterations < 20 and not end.converged
    right = solve(fit, fit.start(), hopeless=1.2 * float(fit.measured.sum()))
    assert right.converged
    torch.testing.assert_close(fit.state_of(right.state.vector()).vector(), right.state.vector())


def test_prior_on_track_errors_by_finite_differences(case) -> None:
    """The gradient of the Student-t cost is that of the Gaussian whose precision is taken."""
    errors = torch.tensor([0.4, -0.1, 0.2, 0.0], dtype=torch.float64, requires_grad=True)
    size = 0.05
    cost = (2.0 + 4) * torch.log1p((errors**2).sum() / (2.0 * size**2))
    assert float(cost.detach()) == pytest.approx(track_cost(errors.detach(), size, 2.0))
    (gradient,) = torch.autograd.grad(cost, errors)
    torch.testing.assert_close(gradient, 2 * track_precision(errors.detach(), size, 2.0) * errors.detach())


def test_a_track_that_was_guessed_may_be_off_as_a_whole(case) -> None:
    """Its error counts by its own size; the gradient of the cost is that of the precision."""
    first, *others = case.problem.passes
    fit = MapFit(replace(case.problem, passes=[replace(first, offset=1.5), *others]))
    assert float(fit.prior.sd[fit.layout["along"]][0]) == pytest.approx(np.hypot(1.5, fit.problem.prior.along))
    state = fit.start()
    moved = replace(state.vehicles, along=torch.tensor([0.9, 0.02, -0.03, 0.01], dtype=torch.float64))
    state = replace(state, vehicles=moved)
    cost = fit.prior.cost(state)
    for number in range(2):
        step = torch.zeros(4, dtype=torch.float64)
        step[number] = 1e-6
        there = replace(state, vehicles=replace(moved, along=moved.along + step))
        slope = 2 * fit.prior.precision(state)[fit.layout["along"]][number] * moved.along[number]
        assert (fit.prior.cost(there) - cost) / 1e-6 == pytest.approx(float(slope), rel=1e-4)
    assert cost < MapFit(case.problem).prior.cost(state) / 3


def test_tracks_that_are_off_loosen_each_other(case) -> None:
    """Tracks displaced by 1 m each: anchors hold the route, and its sigma says how well."""
    rng = np.random.default_rng(3)
    passes = [replace(one, position=one.position + rng.normal(0, 1.0, 2)) for one in case.problem.passes]
    traffic = Traffic.of(passes, case.problem.traffic.samples)
    displaced = replace(case.problem, passes=passes, traffic=traffic)
    result = fit_spline(displaced)
    here = np.isin(result.channel, case.problem.channel)
    assert result.converged
    assert np.linalg.norm(result.route[here] - case.truth, axis=1).max() < 0.25
    assert (np.abs(result.route[here, 1] - case.truth[:, 1]) < 3.5 * result.sigma[here, 1]).all()


def test_known_ground_moves_vehicles_only(case) -> None:
    fit = MapFit(case.problem, known_ground=True)
    start = fit.start()
    end = solve(fit, start).state
    torch.testing.assert_close(end.coefficients, start.coefficients, rtol=0, atol=0)
    assert float(end.poisson_ratio) == float(start.poisson_ratio)
    assert not torch.equal(end.vehicles.along, start.vehicles.along)


def test_unmeasured_samples_do_not_matter(case) -> None:
    rate = case.problem.record.copy()
    rate[::7, ::5] = np.nan
    missing = replace(case.problem, record=rate)
    rate_of_noise = np.where(np.isnan(rate), 1.0, rate)
    fits = [MapFit(missing), MapFit(replace(case.problem, record=rate_of_noise))]
    fits[1].measured = fits[0].measured
    ends = [solve(fit, fits[0].start()).state.coefficients for fit in fits]
    torch.testing.assert_close(*ends)
