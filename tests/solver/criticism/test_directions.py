"""Whitened directions at the end of a fit, against dense matrices of the same small survey."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from noisy_trials import noisy
from torch import Tensor

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.directions import Directions
from solver.criticism.policy import POLICY
from solver.criticism.slow_errors import SCALES, SMALLEST, slow_evidence, slow_precision
from solver.fit.chain import Chain
from solver.fit.map_fit import SPLINE_VARIANCE, MapFit
from solver.fit.windowed import Windowed
from solver.signal_path.traffic import Traffic
from solver.survey.anchors import Anchor
from solver.trajectory.trajectory_effects import SLOW_ERROR
from solver.trajectory.vehicle_pass import Pass

KNOWN = built_in()
SPOOL = KNOWN["slack_spool"]


def dense(windowed: Windowed) -> Tensor:
    return torch.stack([windowed.times(one) for one in torch.eye(windowed.width, dtype=torch.float64)], 1)


def anchored() -> MapFit:
    """The trial survey in noise that makes a car's signal 30 sigmas, with two anchors."""
    problem = trial_survey()[0].problem
    points = [Anchor("a", int(problem.channel[k]), *problem.start[k] + [0, 0.1, 0], 0.05, 0.05) for k in (3, -4)]
    return noisy(30, 2, anchors=points)


@pytest.fixture(scope="module")
def at() -> Directions:
    fit = anchored()
    return Directions(fit, replace(fit.start(), vehicles=trial_survey()[1].vehicles))


@pytest.fixture(scope="module")
def whole(at: Directions) -> tuple[Tensor, Tensor]:
    """All columns that are fitted [row, column], and the normal matrix that the factor is of."""
    return dense(at.jacobian), at.factor @ at.factor.T


def scored(signal: Tensor) -> Any:
    """As much of a score as says what it would change."""
    return SimpleNamespace(signal=Windowed.whole(signal[None]))


def columns_of(at: Directions, name: str) -> Windowed:
    effect = KNOWN[name]
    shape = {p.name: p.grid[0] for p in effect.shapes}
    return at.columns(effect, shape, at.fit.problem.extension([effect]))[0]


def test_the_normal_matrix_is_that_of_all_rows_and_the_priors(at: Directions, whole: tuple[Tensor, Tensor]) -> None:
    """What the rows of the record and of the anchors do not make of it is the priors', block by block."""
    jacobian, matrix = whole
    prior = matrix - jacobian.T @ jacobian
    fitted = at.fitted
    torch.testing.assert_close(prior[fitted:, fitted:], slow_precision(at.fit), rtol=1e-6, atol=1e-4)
    torch.testing.assert_close(prior[:fitted, fitted:], torch.zeros_like(prior[:fitted, fitted:]), rtol=0, atol=1e-5)
    lowest = float(torch.linalg.eigvalsh(prior[:fitted, :fitted]).min())
    assert lowest > -1e-9 * float(matrix.diagonal().max()), "priors only add"


def test_slow_errors_are_pulled_by_the_residual_alone(at: Directions, whole: tuple[Tensor, Tensor]) -> None:
    """They are open where they begin, at zero, so that their own prior does not pull."""
    jacobian, matrix = whole
    slow = slice(at.fitted, None)
    torch.testing.assert_close((matrix @ at.step)[slow], (jacobian.T @ at.residual)[slow], rtol=1e-8, atol=1e-6)


def test_the_step_solves_the_normal_equations_of_a_dense_chain(at: Directions) -> None:
    """Alone, without slow errors, they are those of `Chain.dense`."""
    bare = Directions(at.fit, at.state, alone=True)
    matrix, right = Chain.single(at.fit).dense(at.state, [at.fit.linearized(at.state)])
    torch.testing.assert_close(bare.step, torch.linalg.solve(matrix, right), rtol=1e-6, atol=1e-12)
    assert bare.stress == pytest.approx(
        float(torch.linalg.solve(torch.linalg.cholesky(matrix), right).abs().max()), rel=1e-8
    )


@pytest.mark.parametrize("name", ["slack_spool", "gauge_length", "clock_offset", "track_jitter"])
def test_what_the_fit_leaves_is_a_projection(at: Directions, whole: tuple[Tensor, Tensor], name: str) -> None:
    jacobian, matrix = whole
    columns = columns_of(at, name)
    x = dense(columns)
    (found,) = at.project([columns])
    crossed = jacobian.T @ x
    torch.testing.assert_close(found.gram, x.T @ x, rtol=1e-9, atol=1e-9)
    left = x.T @ x - crossed.T @ torch.linalg.solve(matrix, crossed)
    torch.testing.assert_close(found.information, left, rtol=1e-6, atol=1e-6 * float(found.gram.max()))
    score = x.T @ at.residual - crossed.T @ at.step
    torch.testing.assert_close(found.score, score, rtol=1e-6, atol=1e-7 * float(crossed.abs().max()))
    lowest = float(torch.linalg.eigvalsh(found.information).min())
    assert lowest > -1e-9 * float(found.gram.max()), "no more is left than there was"


def test_directions_are_projected_together_as_each_by_itself(at: Directions) -> None:
    every = [columns_of(at, name) for name in ("gauge_length", "clock_offset", "slack_spool")]
    for one, together in zip(every, at.project(every), strict=True):
        (alone,) = at.project([one])
        torch.testing.assert_close(together.score, alone.score)
        torch.testing.assert_close(together.information, alone.information)
    assert at.project([]) == []


def test_alone_nothing_is_fitted_beside(at: Directions) -> None:
    held = Directions(at.fit, at.state, alone=True)
    columns = columns_of(held, "gauge_length")
    (found,) = held.project([columns])
    assert found.information is found.gram
    torch.testing.assert_close(found.score, columns.along(held.residual))
    assert not held.following(scored(torch.ones(columns.rows, dtype=torch.float64))).any()


def test_what_was_fitted_follows_a_signal_by_least_squares(at: Directions, whole: tuple[Tensor, Tensor]) -> None:
    """A signal that the fit can make itself is taken back by what makes it, but for what the priors hold."""
    jacobian, matrix = whole
    weight = torch.linspace(-1, 1, jacobian.shape[1], dtype=torch.float64)
    signal = jacobian @ weight
    found = at.following(scored(signal))
    expected = -torch.linalg.solve(matrix, jacobian.T @ signal)[: at.fitted]
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-6)
    unkept = SimpleNamespace(signal=None, crossed=jacobian.T @ signal)
    torch.testing.assert_close(at.following(unkept), found, rtol=1e-8, atol=1e-10)  # type: ignore[arg-type]
    free = -torch.linalg.solve(matrix, (matrix @ weight))[: at.fitted]
    torch.testing.assert_close(free, -weight[: at.fitted])


@pytest.mark.parametrize("name", ["gauge_length", "slack_spool", "clock_offset"])
def test_a_small_change_is_the_derivative(at: Directions, name: str) -> None:
    """Of the record and of the anchors, in the same rows."""
    effect = KNOWN[name]
    shape = {p.name: p.grid[0] for p in effect.shapes}
    extension = at.fit.problem.extension([effect])
    columns, _ = at.columns(effect, shape, extension)
    base = at.numbers(extension, shape)
    where = next(slot.where for slot in extension.slots if not slot.parameter.is_shape)
    step = 1e-5 * effect.amplitudes[0].plausible
    ends = []
    for sign in (1, -1):
        numbers = base.clone()
        numbers[where] += sign * step
        ends.append(dense(at.change(extension, base, numbers))[:, 0])
    found = (ends[0] - ends[1]) / (2 * step)
    expected = dense(columns)[:, 0]
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5 * float(expected.abs().max()))
    nothing = at.change(extension, base, base)
    assert nothing.norm < 1e-9 * columns.norm


def test_at_its_null_a_candidate_changes_no_map(at: Directions) -> None:
    for name in ("gauge_length", "slack_spool", "wheel_layout", "saturation"):
        effect = KNOWN[name]
        extension = at.fit.problem.extension([effect])
        numbers = at.numbers(extension, {p.name: p.grid[0] for p in effect.shapes})
        model = at.model(extension, numbers)
        torch.testing.assert_close(model, at.at.model, rtol=1e-9, atol=1e-12 * float(at.at.model.abs().max()))


def test_numbers_are_those_of_the_fit_and_then_the_candidates() -> None:
    fit = MapFit(replace(anchored().problem, effects=(KNOWN["gauge_length"],)))
    state = replace(fit.start(), numbers=torch.tensor([0.07], dtype=torch.float64))
    at = Directions(fit, state)
    extension = fit.problem.extension([*fit.extension.effects, SPOOL])
    shape = {p.name: p.grid[1] for p in SPOOL.shapes}
    found = at.numbers(extension, shape).tolist()
    assert found[0] == 0.07
    for slot in extension.slots[1:]:
        p = slot.parameter
        assert found[slot.where] == [shape[p.name] if p.is_shape else p.null]


def test_the_noise_counts_for_more_as_the_law_may_be_off(at: Directions) -> None:
    white = at.fit.whiten(at.at.model * at.at.weights.good)
    energy = float((white.square() * at.at.weights.soft).sum())
    assert at.variance == pytest.approx(1 + POLICY.inexact**2 * energy)
    assert Directions(at.fit, at.state, alone=True, variance=3.5).variance == 3.5


def test_slow_errors_are_open_unless_they_are_fitted_or_all_is_held(at: Directions) -> None:
    fitted = dense(at.jacobian).shape[1]
    slow, counts = at.slow_errors()
    assert fitted == at.fitted + slow.width and sum(counts) == slow.width
    assert Directions(at.fit, at.state, alone=True).jacobian.width == at.fitted
    grown = MapFit(replace(at.fit.problem, effects=(SLOW_ERROR,)))
    state = replace(grown.start(), vehicles=at.state.vehicles)
    assert Directions(grown, state).jacobian.width == int(grown.free.sum())


def told(at: Directions, sigma: Callable[[Pass], np.ndarray]) -> Directions:
    """The same where the tracks say of themselves that they are so sure, m [row, 2]."""
    problem = at.fit.problem
    passes = [replace(one, sigma=sigma(one), in_view=sigma(one)[:, 0] < 0.5) for one in problem.passes]
    fit = MapFit(replace(problem, passes=passes, traffic=Traffic.of(passes, problem.traffic.samples)))
    return Directions(fit, at.state)


def slow_prior(found: Directions) -> Tensor:
    """What is known of the tracks' slow errors before the data speak, [number, number], 1/m^2."""
    jacobian = dense(found.jacobian)[:, found.fitted :]
    return (found.factor @ found.factor.T)[found.fitted :, found.fitted :] - jacobian.T @ jacobian


def test_what_the_fit_leaves_of_slow_errors_is_left_by_what_was_fitted_alone(at: Directions) -> None:
    matrix, right = Chain.single(at.fit).dense(at.state, [at.fit.linearized(at.state)])
    fitted, slow = dense(at.jacobian).split([at.fitted, at.slow_errors()[0].width], 1)
    led = torch.linalg.solve(matrix, fitted.T @ slow)
    left = at.slow_left
    assert left is not None
    torch.testing.assert_close(left.gram, slow.T @ slow)
    torch.testing.assert_close(left.information, slow.T @ slow - slow.T @ fitted @ led, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(left.score, slow.T @ at.residual - led.T @ right, rtol=1e-6, atol=1e-6)
    assert Directions(at.fit, at.state, alone=True).slow_left is None


def test_slow_errors_explain_what_they_may_at_any_size_up_to_what_the_tracks_say(at: Directions) -> None:
    left = at.slow_left
    assert left is not None
    logs = []
    covariance = torch.linalg.inv(slow_precision(at.fit))
    for scale in SCALES:
        held = scale**2 * covariance @ left.information / at.variance
        spread = torch.eye(len(held), dtype=torch.float64) + held
        along = left.score / at.variance
        gain = along @ torch.linalg.solve(spread, scale**2 * covariance @ along)
        logs.append(float(gain - torch.logdet(spread)) / 2)
    assert slow_evidence(at, at.variance) == pytest.approx(np.log(np.mean(np.exp(logs))), rel=1e-6)
    assert slow_evidence(Directions(at.fit, at.state, alone=True), 1.0) == 0.0


def test_tracks_that_are_sure_of_themselves_may_still_be_off(at: Directions) -> None:
    """By a centimeter: what is open is no less than that."""
    sure, least = (slow_prior(told(at, lambda one, s=s: np.full(one.sigma.shape, s))) for s in (1e-6, SMALLEST))
    torch.testing.assert_close(sure, least)
    assert float(track_spread(told(at, lambda one: np.full(one.sigma.shape, 1e-6)))[1].median()) == pytest.approx(
        SMALLEST, rel=0.1
    )


def track_spread(found: Directions) -> tuple[Tensor, Tensor]:
    """Weights [row, number] of a track's slow error along travel, and its standard deviation [row] before the data."""
    extension = found.fit.problem.extension([SLOW_ERROR])
    assert extension.scopes is not None
    weights = extension.scopes.along("track")
    covariance = torch.linalg.inv(slow_prior(found))[: weights.shape[1], : weights.shape[1]]
    return weights, (weights @ covariance * weights).sum(1).sqrt()


def test_a_slow_error_is_as_large_as_its_track_says(at: Directions) -> None:
    found = told(at, lambda one: np.full(one.sigma.shape, 0.05))
    weights, sd = track_spread(found)
    whole = weights.sum(0) > 0.99 * weights.sum(0).max()
    known = slow_prior(found).diagonal()[: len(whole)][whole]
    torch.testing.assert_close(known, torch.full_like(known, SPLINE_VARIANCE / 0.05**2), rtol=0.02, atol=0)
    # A little more at the ends, where fewer rows hold a number.
    assert float(sd.median()) == pytest.approx(0.05, rel=0.1)
    assert float(sd.min()) > 0.04 and float(sd.max()) < 0.25


def test_where_a_track_is_less_sure_more_of_its_slow_error_is_open_and_no_more_in_view(at: Directions) -> None:
    """As where it goes on out of view: what a vehicle did there is no fault of the model."""

    def vaguer_at_the_end(one: Pass) -> np.ndarray:
        late = np.arange(len(one.rows)) > 0.8 * len(one.rows)
        return np.where(late[:, None], [1.0, 1.0], [0.05, 0.05])

    found = told(at, vaguer_at_the_end)
    weights, sd = track_spread(found)
    late = torch.from_numpy(found.fit.problem.traffic.sigma[:, 0].numpy() > 0.5)
    reaching = (weights[late] > 0).any(0) & (weights[~late] > 0).any(0)
    assert reaching.sum() >= 3, "numbers reach over both"
    assert float(sd[~late].max()) < 0.25
    assert float(sd[late].max()) > 0.8


def test_what_candidates_share_is_computed_once(at: Directions) -> None:
    one, other = (at.fit.problem.extension([KNOWN[name]]) for name in ("gauge_length", "saturation"))
    seen = at.seen(one)
    assert at.seen(one) is seen
    there = at.seen(other)
    same = there is not seen and there.local is seen.local
    assert same


def test_what_is_heard_is_the_residual_of_every_sample(at: Directions) -> None:
    heard = at.heard(at.fit.problem.extension([KNOWN["gauge_length"]]))
    samples, channels = at.fit.data.shape
    assert heard.residual.shape == (samples, channels)
    torch.testing.assert_close(heard.residual.flatten(), at.residual[: samples * channels])
