"""How far parts of a record disagree about a route: against noise alone, and where a part is wrong."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from noisy_trials import noisy
from torch import Tensor

from solver.catalogue.catalogue import built_in
from solver.criticism import disagreement
from solver.criticism.directions import Directions
from solver.criticism.disagreement import Disagreement, clusters, route_derivative, ways_of_route
from solver.criticism.route_change import moved_by
from solver.criticism.scorer import Scorer, score_all
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.windowed import Windowed

SAMPLES, CHANNELS, PASSES, PLACES, FREE = 60, 4, 3, 5, 8
#: A number that does not move the route is among those fitted.
BY_FREE = np.random.default_rng(4).normal(size=(PLACES, 3, FREE)) * (np.arange(FREE) < FREE - 1)


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> Callable[[Tensor, np.random.Generator], Any]:
    """The end of a linear fit of noise and more [sample, channel]; numbers are as their prior has them."""
    monkeypatch.setattr(disagreement, "route_derivative", lambda fit, state: BY_FREE)
    rows = SAMPLES * CHANNELS
    matrix = torch.from_numpy(np.random.default_rng(5).normal(size=(rows + CHANNELS, FREE))) / 10
    # Half of what is told of them is told by a few samples.
    matrix[100:112] *= 5

    def end(more: Tensor, rng: np.random.Generator) -> Any:
        truth = torch.from_numpy(rng.normal(size=FREE))
        noise = torch.from_numpy(rng.normal(size=rows + CHANNELS))
        noise[:rows] += more.flatten()
        heard = matrix @ truth + noise
        factor = torch.linalg.cholesky(matrix.T @ matrix + torch.eye(FREE, dtype=torch.float64))
        step = torch.cholesky_solve((matrix.T @ heard)[:, None], factor)[:, 0]
        problem = SimpleNamespace(passes=[None] * PASSES)
        fit = SimpleNamespace(data=torch.zeros(SAMPLES, CHANNELS), problem=problem)
        jacobian = Windowed.of(matrix, CHANNELS)
        return SimpleNamespace(
            fit=fit, state=None, jacobian=jacobian, residual=heard, step=step, factor=factor, fitted=FREE
        )

    return end


def test_noise_alone_makes_parts_disagree_by_about_one(fitted):
    rng, nothing = np.random.default_rng(6), torch.zeros(SAMPLES, CHANNELS, dtype=torch.float64)
    factors = [Disagreement.of(fitted(nothing, rng)).factor for _ in range(300)]
    assert np.mean(factors) == pytest.approx(1.0, abs=4 * np.std(factors) / np.sqrt(len(factors)))
    assert np.std(factors) < 0.5


def test_parts_that_pull_the_route_apart_widen_it(fitted):
    rng = np.random.default_rng(7)
    # What moves the route one way in the first half and the other way in the second.
    end = fitted(torch.zeros(SAMPLES, CHANNELS, dtype=torch.float64), rng)
    way = end.jacobian.between(0, SAMPLES * CHANNELS).times(torch.ones(FREE, dtype=torch.float64))
    apart = 8 * way.reshape(SAMPLES, CHANNELS) * torch.where(torch.arange(SAMPLES) < 26, 1.0, -1.0)[:, None]
    found = Disagreement.of(fitted(apart, rng))
    assert found.factor > 4
    np.testing.assert_allclose(found.added, (found.factor - 1) * found.covariance)
    by = torch.from_numpy(BY_FREE)
    expected = by @ torch.cholesky_inverse(end.factor) @ by.mT
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-9)


def test_parts_that_agree_better_than_noise_narrow_nothing():
    assert not Disagreement(0.6, np.ones((2, 3, 3))).added.any()


def test_a_record_falls_into_parts_that_tell_as_much(fitted):
    end = fitted(torch.zeros(SAMPLES, CHANNELS, dtype=torch.float64), np.random.default_rng(8))
    record, (ways, _) = end.jacobian.between(0, SAMPLES * CHANNELS), ways_of_route(end)
    parts = list(clusters(record, ways, CHANNELS, 6))
    assert parts[0][0] == 0 and parts[-1][1] == SAMPLES * CHANNELS and len(parts) == 6
    assert all(last == first for (_, last), (first, _) in pairwise(parts))
    assert all(first % CHANNELS == 0 for first, _ in parts)
    told = [float(record.between(*part).times(ways).square().sum()) for part in parts]
    most = float(record.times(ways).square().reshape(len(ways), SAMPLES, CHANNELS).sum((0, 2)).max())
    assert max(told) - sum(told) / 6 <= most


@pytest.mark.parametrize("moving", [(), ("channel_stretch",), ("channel_wander",)])
def test_the_routes_derivatives_are_those_of_its_moves(moving):
    """Also by one number, or many, of effects that move channels along it."""
    fit = noisy(30, 2, effects=tuple(built_in()[name] for name in moving))
    state = solve(fit, fit.start(), iterations=3).state
    scorer: Any = Directions(fit, state)
    change = 1e-6 * torch.from_numpy(np.random.default_rng(9).normal(size=scorer.fitted))
    move = moved_by(scorer, change)
    np.testing.assert_allclose(route_derivative(fit, state) @ change.numpy(), move, atol=1e-4 * np.abs(move).max())


def test_passes_disagree_until_what_is_missing_is_in_the_model():
    """Gauges a fifth longer than told: each pass by itself would put the fiber elsewhere."""
    gauge = built_in()["gauge_length"]
    fit = noisy(30, 2, gauge, 0.2)
    scorer = Scorer(fit, solve(fit, fit.start()).state)
    assert Disagreement.of(scorer).factor > 2
    assert Disagreement.of(scorer, score_all(scorer, [gauge])[0]).factor < 1.5
    grown = MapFit(replace(fit.problem, effects=(gauge,)))
    assert Disagreement.of(Directions(grown, solve(grown, grown.start()).state)).factor < 1.5
