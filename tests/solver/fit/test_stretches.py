"""A chain of stretches is one problem: the same normal equations, steps and covariance as a dense one."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.normal import Banded, Factor, Normal
from solver.fit.normal_parts import Block, Part
from solver.fit.posterior import Posterior
from solver.fit.spline import fit_spline, initial_state
from solver.fit.stretches import crowds, nearby, parts, some, stretches

RNG = np.random.default_rng(4)


def positive(size: int) -> np.ndarray:
    root = RNG.normal(size=(size, size + 3))
    return root @ root.T


@pytest.fixture(scope="module")
def equations() -> tuple[Normal, np.ndarray, np.ndarray]:
    """Three stretches of a route of 10 numbers, 2 that all share, two vehicles each; and the same in full."""
    size, border = 10, np.arange(2)
    blocks, parts = [], []
    whole = np.zeros((12 + 3 * 2 * 3, 12 + 3 * 2 * 3))
    own = 12
    for stretch, first in enumerate((0, 3, 5)):
        shared = np.concatenate([np.arange(first, first + 5), size + border])
        total = np.zeros((7, 7))
        for _ in range(2):
            matrix = positive(10)
            mine = np.arange(own, own + 3)
            at = np.concatenate([mine, shared])
            whole[np.ix_(at, at)] += matrix
            parts.append(Part(matrix[:3, :3], matrix[:3, 3:], RNG.normal(size=3), np.full(3, 0.1), stretch))
            total += matrix[3:, 3:]
            own += 3
        blocks.append(Block(first, 5, border, total))
    right = RNG.normal(size=12)
    every = np.concatenate([right, *(part.right for part in parts)])
    return Normal(size, 2, blocks, [], parts, right), whole, every


def test_the_dense_equations_are_all_that_was_summed(equations: tuple) -> None:
    normal, whole, right = equations
    matrix, side = normal.dense()
    np.testing.assert_allclose(matrix, whole, rtol=1e-12)
    np.testing.assert_array_equal(side, right)


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_steps_are_those_of_the_dense_equations(equations: tuple, damping: float) -> None:
    normal, whole, right = equations
    expected = np.linalg.solve(whole + damping * np.diag(np.diagonal(whole)), right)
    shared, own = normal.step(damping)
    np.testing.assert_allclose(np.concatenate([shared, *own]), expected, rtol=1e-8)


def test_the_decrement_is_the_length_of_the_step_in_sigmas(equations: tuple) -> None:
    normal, whole, right = equations
    assert normal.decrement == pytest.approx(float(right @ np.linalg.solve(whole, right)) ** 0.5)


def test_what_is_held_takes_no_step_and_the_rest_as_if_it_were_not_there(equations: tuple) -> None:
    normal, whole, right = equations
    held = np.zeros(len(right), bool)
    held[[11, 13, 20]] = True  # the second of those shared, one of the first vehicle's, one of the third's
    own = np.split(held[12:], 6)
    shared, steps = normal.holding(held[10:12], own).step(0.0)
    found = np.concatenate([shared, *steps])
    np.testing.assert_array_equal(found[held], 0.0)
    np.testing.assert_allclose(found[~held], np.linalg.solve(whole[np.ix_(~held, ~held)], right[~held]), rtol=1e-8)
    assert normal.holding(np.zeros(2, bool), [np.zeros(3, bool)] * 6) is normal


def test_a_banded_factor_solves(equations: tuple) -> None:
    normal, _, _ = equations
    matrix = Banded.of(normal.blocks, 10, 2)
    dense = np.zeros((12, 12))
    for block in normal.blocks:
        where = block.where(10)
        dense[np.ix_(where, where)] += block.matrix
    right = RNG.normal(size=(12, 4))
    np.testing.assert_allclose(Factor(matrix).solved(right), np.linalg.solve(dense, right), rtol=1e-8)


def dense(chain: Chain, visit) -> tuple[torch.Tensor, np.ndarray]:
    """Normal matrix [free, free] of all links without any elimination, and the free parameters' numbers."""
    matrix = torch.zeros(len(chain.mean), len(chain.mean), dtype=torch.float64)
    for link in chain.links:
        at = link.fit.linearized(chain.part_of(visit.state, link))
        where = link.where[link.fit.free]
        matrix[where[:, None], where] += at.jacobian.transposed_times(at.jacobian)
    for one in chain.rows(visit.state):
        matrix[one.where[:, None], one.where] += one.rows.jacobian.T @ one.rows.jacobian
    matrix += torch.diag(torch.nan_to_num(chain.prior.precision(visit.state), posinf=0.0))
    free = torch.nonzero(chain.free).flatten()
    return matrix[free][:, free], free.numpy()


def test_a_chain_has_the_covariance_of_the_dense_problem(case, cut_short: None) -> None:
    chain = Chain.of(case.problem)
    assert len(chain.links) > 2 * 3 - 1 and chain.long
    end = solve(chain, chain.start())
    assert end.converged
    visit = chain.visit(end.state)
    matrix, free = dense(chain, visit)
    covariance = torch.linalg.inv(matrix).numpy()
    posterior = Posterior(chain, visit)
    sigma = posterior.sigmas().numpy()[free]
    route = 3 * chain.basis.size
    expected = np.sqrt(posterior.scale * np.diagonal(covariance))
    np.testing.assert_allclose(sigma[route:], expected[route:], rtol=1e-4)
    at = chain.basis.at(case.problem.distance)
    block = covariance[:route, :route].reshape(chain.basis.size, 3, chain.basis.size, 3)
    total = posterior.scale * np.einsum("ci,iajb,cj->cab", at, block, at)
    np.testing.assert_allclose(posterior.route(case.problem.distance)[1], total, rtol=1e-4, atol=1e-9)
    mean = at.mean(0)
    common = posterior.scale * np.einsum("i,iaja,j->a", mean, block, mean)
    shares = common / np.einsum("caa->a", total) * len(total)
    np.testing.assert_allclose(posterior.shared(case.problem.distance, total), shares, rtol=1e-4)
    assert (shares > 0).all() and (shares < 1).all()


def test_the_links_equations_in_the_vector_s_order_are_those_of_the_dense_problem(case, cut_short: None) -> None:
    chain = Chain.of(replace(case.problem, effects=(built_in()["channel_coupling"],)))
    state = chain.visit(chain.start(), chain.unsettled(chain.start())).state
    matrix, right = chain.dense(state, [link.fit.linearized(chain.part_of(state, link)) for link in chain.links])
    expected, free = dense(chain, chain.visit(state))
    np.testing.assert_allclose(matrix, expected, rtol=1e-8, atol=1e-8 * float(expected.abs().max()) ** 0.5)
    assert matrix.shape == (len(free), len(free)) and right.shape == (len(free),)
    shared, _ = chain.visit(state).normal.step(0.0)
    step = torch.linalg.solve(matrix, right)
    route = chain.layout["route"].stop
    np.testing.assert_allclose(step[:route], shared[:route], rtol=1e-4, atol=1e-7)


def test_stretches_find_the_route_that_one_fit_finds(case, cut_short: None) -> None:
    """Vehicles with numbers of their own in each stretch cost some precision, no truth."""
    result = fit_spline(case.problem)
    keep = np.isin(result.channel, case.problem.channel)
    error = result.route[keep] - case.truth
    assert result.converged and 0.9 < result.chi2_per_dof < 1.1
    assert np.linalg.norm(error, axis=1).max() < 0.3
    assert (np.abs(error) < 4 * result.sigma[keep]).all()
    assert np.isnan(result.model).any() and (result.weight[np.isnan(result.model)] == 0).all()


def test_prior_parts_are_shares_of_the_whole(case, cut_short: None) -> None:
    chain = Chain.of(case.problem)
    posterior = Posterior(chain, chain.visit(chain.start(), None))
    _, total, prior, shape = posterior.route(case.problem.distance)
    for part in (prior, shape):
        ratio = np.diagonal(part, axis1=1, axis2=2) / np.diagonal(total, axis1=1, axis2=2)
        assert (ratio > -1e-9).all() and (ratio < 1 + 1e-9).all()
    assert 0 < posterior.decided < float(chain.free.sum())


def test_a_chain_of_one_is_the_problem_itself(case) -> None:
    fit = MapFit(case.problem)
    chain = Chain.single(fit)
    assert len(chain.links) == 1
    torch.testing.assert_close(chain.start().vector(), fit.start().vector())
    state = chain.start()
    assert chain.visit(state).cost == pytest.approx(fit.linearized(state).misfit + fit.prior.total(state))


def test_stretches_hold_each_channel_once(case, cut_short: None) -> None:
    cuts = stretches(case.problem)
    assert [cut.start for cut in cuts[1:]] == [cut.stop for cut in cuts[:-1]]
    assert (cuts[0].start, cuts[-1].stop) == (0, len(case.problem.channel)) and len(cuts) == 3


def test_only_the_near_part_of_a_pass_counts(case) -> None:
    one, route = case.problem.passes[0], case.problem.start[:20]
    near = nearby(one, route, 10.0)
    assert near is not None
    distance = np.hypot(*(near.position[[0, -1], None, :] - route[None, :, :2]).transpose(2, 0, 1)).min(1)
    assert (distance <= 10.0).all() and len(near.rows) < len(one.rows)
    assert nearby(replace(one, position=one.position + 500.0), route, 10.0) is None
    assert sum(len(crowd) for crowd in crowds(case.problem.passes)) == len(case.problem.passes)


def test_a_long_fiber_begins_with_whole_crowds(case, cut_short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every vehicle that is near is in the model: else what it leaves would pull the route away."""
    monkeypatch.setattr("solver.fit.spline.FIRST", 2)
    chain = Chain.of(case.problem)
    begun = initial_state(case.problem, chain, lambda n: None)
    seen = route_of(begun, case)
    assert np.abs(seen - route_of(solve(chain, begun).state, case))[5:-5].max() < 0.3
    whole = {tuple(one.track_id for one in link.fit.problem.passes) for link in chain.links}
    few = Chain.of(case.problem, groups=[some(group, 2) for group in parts(case.problem)])
    assert {tuple(one.track_id for one in link.fit.problem.passes) for link in few.links} <= whole
    assert len(few.links) < len(chain.links)


def route_of(state, case) -> np.ndarray:
    """The route [channel, 3] of a state."""
    chain = Chain.of(case.problem)
    return chain.basis.along(state.coefficients.numpy(), case.problem.distance)


@pytest.mark.parametrize("name", ["channel_stretch", "channel_wander"])
def test_covariance_of_a_route_holds_what_effects_may_move_along_it(case, name: str) -> None:
    fit = MapFit(replace(case.problem, effects=(built_in()[name],)))
    chain, state = Chain.single(fit), solve(fit, fit.start(), iterations=2).state
    visit = chain.visit(state)
    matrix, free = dense(chain, visit)
    posterior = Posterior(chain, visit)
    distance = case.problem.distance[::20]
    route, total, _, _ = posterior.route(distance)

    def routed(vector: torch.Tensor) -> np.ndarray:
        moved = replace(visit, state=state.moved(vector))
        return Posterior(chain, moved).route(distance)[0]

    vector, by = state.vector(), []
    for number in free:
        step = torch.zeros_like(vector)
        step[number] = 1e-4
        by.append((routed(vector + step) - routed(vector - step)) / 2e-4)
    columns = np.stack(by, -1)
    covariance = posterior.scale * torch.linalg.inv(matrix).numpy()
    expected = np.einsum("cai,ij,cbj->cab", columns, covariance, columns)
    np.testing.assert_allclose(total, expected, rtol=1e-3, atol=1e-7)
    assert np.abs(routed(vector) - route).max() == 0
