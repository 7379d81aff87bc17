"""What the score test says where nothing is missing, or only what the tracks themselves own up to."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import Trial, trial_survey
from solver.criticism.candidate import score_candidate
from solver.criticism.policy import POLICY
from solver.criticism.scorer import Scorer
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.signal_path.derivatives import derivative
from solver.survey.anchors import Anchor


def off_by(size: float, sigma: float):
    """A survey whose tracks, told to be off by `sigma`, are off by `size` slowly, m; and where its fit ends."""
    problem = trial_survey()[0].problem
    rng = np.random.default_rng(3)
    passes, first = [], 0
    position = problem.traffic.position.clone()
    for one in problem.passes:
        rows = len(one.rows)
        phase, t = rng.uniform(0, 2 * np.pi), np.arange(rows) / problem.sampling_rate
        error = size * np.sqrt(2) * np.sin(2 * np.pi * t / 4 + phase)
        position[first : first + rows, 0] += torch.from_numpy(error)
        passes.append(replace(one, sigma=np.full((rows, 2), sigma)))
        first += rows
    traffic = replace(problem.traffic, position=position)
    level = float(np.sqrt(np.nanmean(problem.record**2))) / 30
    record = problem.record + level * rng.normal(size=problem.record.shape)
    moved = replace(problem, passes=passes, traffic=traffic, record=record, noise=torch.full_like(problem.noise, level))
    fit = MapFit(moved)
    return fit, solve(fit, fit.start()).state


@pytest.mark.parametrize("name", ["track_jitter", "generic_gain", "generic_load"])
def test_what_tracks_may_be_off_by_their_own_account_is_not_an_effect(name):
    scores = {sigma: list(Scorer(*off_by(0.04, sigma)).scores(built_in()[name])) for sigma in (0.001, 0.08)}
    assert all(s.evidence < POLICY.found for s in scores[0.08])
    if name == "track_jitter":
        assert max(s.fall for s in scores[0.001]) > max(s.fall for s in scores[0.08])


def test_tracks_off_by_more_than_they_say_are_found():
    found = max(Scorer(*off_by(0.4, 0.03)).scores(built_in()["track_jitter"]), key=lambda s: s.evidence)
    assert found.evidence > POLICY.found


@pytest.mark.parametrize("name", ["channel_stretch", "slack_spool", "channel_wander", "gauge_length"])
def test_anchors_have_their_say_on_what_leads_channels_elsewhere(name):
    problem = trial_survey()[0].problem
    mean = problem.start[len(problem.start) // 2]
    anchors = [Anchor("a", int(problem.channel[k]), *mean, 0.05, 0.05) for k in (3, -4)]
    fit = MapFit(replace(problem, anchors=anchors))
    scorer, effect = Scorer(fit, fit.start()), built_in()[name]
    extension = fit.problem.extension([effect])
    shape = {p.name: p.grid[0] for p in effect.shapes}
    columns, _ = scorer.columns(effect, shape, extension)
    every = torch.stack([columns.times(one) for one in torch.eye(columns.width, dtype=torch.float64)], 1)
    rows = every[fit.measured.numel() :][:6]
    numbers = extension.numbers({name: shape})
    grown = MapFit(replace(fit.problem, effects=(effect,)))
    slots = [slot for slot in grown.extension.slots if not slot.parameter.is_shape]
    free = torch.cat([torch.arange(slot.where.start, slot.where.stop) for slot in slots])

    def missed(at: torch.Tensor) -> torch.Tensor:
        return grown.prior.anchored(replace(scorer.state, numbers=at))[0].rows.residual

    for column, number in enumerate(free):
        step = torch.zeros_like(numbers)
        step[number] = 1e-5
        numeric = (missed(numbers + step) - missed(numbers - step)) / 2e-5
        torch.testing.assert_close(rows[:, column], numeric, rtol=1e-4, atol=1e-4)
    assert bool(rows.any()) == (name != "gauge_length")


@pytest.fixture(scope="module")
def scorer() -> Scorer:
    fit = MapFit(trial_survey()[0].problem)
    return Scorer(fit, fit.start())


@pytest.mark.parametrize("name", sorted(name for name in built_in() if name != "curved_gauge"))
def test_what_candidates_share_changes_no_derivative(scorer, name):
    effect = built_in()[name]
    extension = scorer.fit.problem.extension([effect])
    shape = {p.name: p.grid[0] for p in effect.shapes}
    shared, _ = scorer.columns(effect, shape, extension)
    alone = Scorer(scorer.fit, scorer.state, alone=True)
    own, _ = alone.columns(effect, shape, extension)
    every = torch.eye(own.width, dtype=torch.float64)
    for number in (0, own.width - 1):
        torch.testing.assert_close(shared.times(every[number]), own.times(every[number]), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("name", "heard"), [("long_vehicle", [0, 3, 4]), ("wheel_layout", [0])])
def test_vehicles_that_an_effect_is_not_about_say_nothing_of_its_size(scorer, name, heard):
    """Of a vehicle of unknown class, a car, a van, a truck and a bus, only some may be long, or on unknown wheels."""
    many, told = sorted(scorer.scores(built_in()[name]), key=lambda s: s.shared)
    assert (many.shared, told.shared) == (False, True)
    for score in (many, told):
        assert score.counts == (5,) * len(built_in()[name].amplitudes)
        first = score.sigma[:5]
        assert np.flatnonzero(np.isfinite(first)).tolist() == heard
        found = score_candidate(score, None)
        assert found.estimate == pytest.approx(np.sqrt(np.mean(score.estimate[heard] ** 2)))
        assert found.sigma == pytest.approx(np.median(first[heard]))
        assert 0 < 5 * found.sigma <= found.detectable_size
    assert len(set(told.estimate[:5])) == 1


@pytest.mark.parametrize("name", [name for name, one in built_in().items() if one.shapes and one.seek is None])
@pytest.mark.parametrize("curved", [False, True])
def test_what_candidates_share_serves_each_of_their_shapes(name: str, curved: bool) -> None:
    """Derivatives that a scorer makes of what it has of another shape, against those made for each shape alone."""
    fit, state = trial_survey()
    fit = MapFit(replace(fit.problem, curved=curved))
    scorer, effect = Scorer(fit, state), built_in()[name]
    trial = Trial(effect, fit, state)
    for p in effect.shapes:
        for value in (p.grid[0], p.grid[-1]):
            numbers = trial.numbers({p.name: value})
            seen, alone = scorer.seen(trial.extension), trial.seen(numbers)
            for slot in (slot for slot in trial.extension.slots if not slot.parameter.is_shape):
                found, expected = (derivative(one, slot, numbers) for one in (seen, alone))
                torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-10 * float(expected.abs().max()))
