"""What the score test says where nothing is missing, or only what the tracks themselves own up to."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from noisy_trials import noisy

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import Trial, trial_survey
from solver.criticism.candidate import score_candidate
from solver.criticism.policy import POLICY
from solver.criticism.score import Score, one_sided, outcome
from solver.criticism.scorer import FEEBLE, Scorer, figures, score_all, similarity, sizes_of
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


def signal_of(score: Score) -> torch.Tensor:
    """What a score's estimate changes [sample * channel + anchor]."""
    assert score.signal is not None
    return score.signal.times(torch.ones(1, dtype=torch.float64))


@pytest.fixture(scope="module")
def stretched() -> Scorer:
    """A survey of which gauges are longer than thought by a twentieth, in noise of a thirtieth of the signal."""
    fit = noisy(30, 6, built_in()["gauge_length"], 0.05)
    return Scorer(fit, solve(fit, trial_survey()[1]).state)


def test_the_score_of_one_shape_is_the_outcome_of_its_projection(stretched: Scorer) -> None:
    effect = built_in()["gauge_length"]
    extension = stretched.fit.problem.extension([effect])
    columns, counts = stretched.columns(effect, {}, extension)
    (score,) = stretched.of_shapes(effect, [{}], extension, 1)
    found = outcome(
        stretched.project([columns])[0], one_sided(effect, [1]), torch.tensor([effect.amplitudes[0].plausible])
    )
    assert (score.fall, score.freedom, score.retained) == (found.fall, found.freedom, found.retained)
    assert score.counts == tuple(counts) == (1,) and score.variance == stretched.variance
    signal = signal_of(score)
    torch.testing.assert_close(signal, columns.times(torch.from_numpy(score.estimate)))
    torch.testing.assert_close(score.crossed, stretched.jacobian.along(signal))
    assert stretched.spectrum(effect, {}).evidence(score.variance) == pytest.approx(score.evidence)


def test_what_a_score_changes_takes_away_the_misfit_that_it_says(stretched: Scorer) -> None:
    effect = built_in()["gauge_length"]
    (score,) = stretched.of_shapes(effect, [{}], stretched.fit.problem.extension([effect]), 1)
    change, residual = stretched.changed(score), stretched.at.residual
    assert change.shape == stretched.fit.data.shape
    left = float((residual - change.flatten()).square().sum())
    assert float(residual.square().sum()) - left == pytest.approx(score.fall, rel=0.1)
    alone = signal_of(score)[: change.numel()]
    assert float(change.square().sum()) < 0.9 * float(alone.square().sum()), "all else follows"


def test_shapes_in_batches_are_scored_as_each_by_itself(stretched: Scorer, monkeypatch: pytest.MonkeyPatch) -> None:
    effect = built_in()["lowpass"]
    extension = stretched.fit.problem.extension([effect])
    shapes, trials = effect.tried(lambda: stretched.heard(extension))
    together = list(stretched.of_shapes(effect, shapes, extension, trials))
    monkeypatch.setattr("solver.criticism.scorer.BATCH", 1)
    alone = list(stretched.of_shapes(effect, shapes, extension, trials))
    assert [one.shape for one in together] == [one.shape for one in alone] == list(shapes)
    assert [one.fall for one in together] == pytest.approx([one.fall for one in alone], rel=1e-7, abs=1e-7)
    assert {one.trials for one in together} == {trials}


def test_what_changes_less_than_rounding_is_not_scored(stretched: Scorer) -> None:
    effect = built_in()["gauge_length"]
    extension = stretched.fit.problem.extension([effect])
    columns, _ = stretched.columns(effect, {}, extension)
    for share, scores in ((0.9, 0), (1.1, 1)):
        size = replace(effect.amplitudes[0], plausible=share * FEEBLE / columns.norm)
        small = replace(effect, parameters=(size,))
        within = stretched.fit.problem.extension([small])
        assert len(list(stretched.of_shapes(small, [{}], within, 1))) == scores


def test_the_best_of_a_table_stands_first_and_what_does_nothing_is_left_out(stretched: Scorer) -> None:
    """On which side of nothing an effect is, the evidence says."""
    names = ("clock_offset", "gauge_length", "sloping_fiber", "highpass")
    table = score_all(stretched, [built_in()[name] for name in names])
    assert [one.evidence for one in table] == sorted((one.evidence for one in table), reverse=True)
    assert {one.effect.name for one in table} <= set(names) and all(one.freedom for one in table)


def test_the_whole_change_is_kept_where_it_says_more(stretched: Scorer) -> None:
    """Never less than the derivative says; and in proportion to it where an effect acts on the vehicles."""
    for name in ("gauge_length", "clock_offset"):
        score = max(stretched.scores(built_in()[name]), key=lambda one: one.fall)
        far = stretched.reaching(score)
        assert far.fall >= score.fall and far.counts == score.counts and far.shape == score.shape
    near = max(stretched.scores(built_in()["track_jitter"]), key=lambda one: one.fall)
    assert stretched.reaching(near) is near
    generic = max(stretched.scores(built_in()["generic_gain"]), key=lambda one: one.fall)
    assert stretched.reaching(generic) is generic


def test_refined_shapes_stay_within_their_bounds_and_explain_no_less(stretched: Scorer) -> None:
    effect = built_in()["lowpass"]
    extension = stretched.fit.problem.extension([effect])
    (p,) = effect.shapes
    for value in (p.grid[0], p.grid[-1]):
        (score,) = stretched.of_shapes(effect, [{p.name: value}], extension, 7)
        better = stretched.refined(score, extension, 7)
        assert better.fall >= score.fall and better.trials == 7
        assert p.lower <= better.shape[p.name] <= p.upper
        assert abs(better.shape[p.name] - value) <= p.spacing


def test_signals_are_alike_by_what_the_fit_leaves_of_them(stretched: Scorer) -> None:
    one = max(stretched.scores(built_in()["gauge_length"]), key=lambda s: s.fall)
    other = max(stretched.scores(built_in()["clock_offset"]), key=lambda s: s.fall)
    assert similarity(stretched, one, one) == pytest.approx(1.0)
    turned = stretched.kept(-3.0 * signal_of(one))
    assert similarity(stretched, one, replace(one, signal=turned)) == pytest.approx(1.0)
    found = similarity(stretched, one, other)
    assert found == pytest.approx(similarity(stretched, other, one)) and 0 <= found <= 1
    signals = torch.stack([signal_of(one), signal_of(other)], 1)
    jacobian = torch.stack(
        [stretched.jacobian.times(e) for e in torch.eye(stretched.jacobian.width, dtype=torch.float64)], 1
    )
    crossed = jacobian.T @ signals
    left = signals.T @ signals - crossed.T @ torch.cholesky_solve(crossed, stretched.factor)
    assert found == pytest.approx(float(left[0, 1].abs() / (left[0, 0] * left[1, 1]).sqrt()), rel=1e-5)


def test_what_other_processes_send_back_is_all_but_the_effect(stretched: Scorer) -> None:
    score = next(iter(stretched.scores(built_in()["gauge_length"])))
    sent = figures(score)
    assert "effect" not in sent and replace(score, **sent) == score


def test_sizes_of_numbers_that_passes_share_are_those_of_one() -> None:
    effect = next(one for one in built_in().values() if len(one.amplitudes) == 2)
    first, second = (p.plausible for p in effect.amplitudes)
    counts = [3, 2]
    each = torch.eye(5, dtype=torch.float64)
    assert sizes_of(effect, counts, each).tolist() == [first] * 3 + [second] * 2
    shared = torch.block_diag(torch.ones(3, 1), torch.ones(2, 1)).double()
    assert sizes_of(effect, counts, shared).tolist() == [first, second]
