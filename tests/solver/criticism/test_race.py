"""Where full fits with a candidate begin, and how they run side by side, on a small survey."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from noisy_trials import noisy

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism import race as criticism_race
from solver.criticism.from_far import from_far
from solver.criticism.policy import POLICY
from solver.criticism.race import (
    elsewhere,
    goes_on,
    leaders_told,
    race,
    started,
    started_elsewhere,
    unshifted,
    with_slow_errors,
)
from solver.criticism.refit import Refit, counted, with_effect
from solver.criticism.scorer import Scorer
from solver.effect import Start
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.state import Weights
from solver.fit.track_trust import strict_tracks
from solver.fit.windowed import Windowed
from solver.simulator import Scenario, simulate
from tests.solver.simulated import case_of

KNOWN = built_in()
GAUGE, CLOCK = KNOWN["gauge_length"], KNOWN["clock_offset"]
LONGER = 0.1


@pytest.fixture(scope="module")
def scorer() -> Scorer:
    """At the fit of a survey whose gauges are a tenth longer than told, in noise of a hundredth of the signal."""
    fit = noisy(100, 7, GAUGE, LONGER)
    return Scorer(fit, solve(fit, trial_survey()[1]).state)


@pytest.fixture(scope="module")
def weights(scorer: Scorer) -> Weights:
    counts = counted(scorer.fit, scorer.at)
    return Weights((counts > 0).double(), counts**2)


@pytest.fixture(scope="module")
def score(scorer: Scorer) -> Any:
    return max(scorer.scores(GAUGE), key=lambda one: one.fall)


def test_what_slow_errors_explain_as_well_is_no_evidence_of_an_effect(
    scorer: Scorer, score: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = race(scorer, [score])[GAUGE.name]
    before, after = 50.0, {GAUGE.name: 20.0, CLOCK.name: 80.0}
    monkeypatch.setattr(criticism_race, "Directions", lambda fit, state, variance: fit)
    monkeypatch.setattr(criticism_race, "slow_evidence", lambda at, variance: before if at is scorer else after[at])
    named = [replace(score, effect=KNOWN[name]) for name in (*after, "camber")]
    made = [replace(best, score=one, fit=one.effect.name) for one in named]
    made[2] = replace(made[2], fall=best.fall / 2)
    monkeypatch.setattr(Refit, "evidence", property(lambda one: one.fall + (one.slow or 0.0)))
    found = with_slow_errors(scorer, {one.effect.name: one for one in made})
    assert {name: one.slow for name, one in found.items()} == {GAUGE.name: -30.0, CLOCK.name: 0.0, "camber": None}
    assert found[GAUGE.name].evidence == best.fall - 30


def test_who_leads_by_what_slow_errors_explain_as_well_stops_nobody(
    scorer: Scorer, score: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    wandering, behind, last = (replace(score, effect=KNOWN[name]) for name in ("track_jitter", "shear_lag", "camber"))
    done, going = SimpleNamespace(converged=True), SimpleNamespace(converged=False)
    made: Any = [(wandering, done, 500.0), (behind, going, 60.0), (last, done, 40.0)]
    running = [Refit(one, one.effect.name, at, fall, 0.0) for one, at, fall in made]
    monkeypatch.setattr(Refit, "evidence", property(lambda one: one.fall + (one.slow or 0.0)))
    monkeypatch.setattr(criticism_race, "told_from_slow_errors", lambda scorer, one: replace(one, slow=-490.0))
    led = leaders_told(scorer, running)
    # The second leads then, and has not ended; the third is behind either way.
    assert [one.slow for one in led] == [-490.0, None, None]
    assert led[0].at(running[0].solution, 510.0).slow is None, "it has gone on"
    ended = [replace(one, solution=done) for one in running]
    assert leaders_told(scorer, ended) == ended, "nobody is left to stop"


def test_a_fit_starts_toward_the_estimate_where_that_lowers_the_misfit(
    scorer: Scorer, weights: Weights, score: Any
) -> None:
    fit = MapFit(with_effect(scorer.fit.problem, GAUGE))
    begun = started(fit, scorer, score, weights)
    size = float(begun.numbers[-1])
    assert np.sign(size) == np.sign(score.estimate[0]) and 0 < abs(size) <= abs(score.estimate[0]) + 1e-12
    still = replace(scorer.state, numbers=fit.extension.numbers())
    assert fit.cost(begun, weights) < fit.cost(still, weights)


@pytest.mark.parametrize("fall", [0.0, 1.0])
def test_a_start_that_only_raises_the_misfit_is_taken_as_told_or_smaller(
    scorer: Scorer, weights: Weights, score: Any, fall: float
) -> None:
    """What is predicted may be tried at a twentieth; what is told, and not predicted, begins as told."""
    fit = MapFit(with_effect(scorer.fit.problem, GAUGE))
    wrong = replace(
        score, estimate=-8 * np.abs(score.estimate), fall=fall, signal=Windowed((), len(scorer.residual), 1)
    )
    size = float(started(fit, scorer, wrong, weights).numbers[-1])
    told = max(float(wrong.estimate[0]), GAUGE.amplitudes[0].lower)
    assert size == pytest.approx(told if fall == 0 else 0.05 * float(wrong.estimate[0]), rel=1e-6)


def test_tracks_that_did_not_shift_leave_nothing_to_unshift(scorer: Scorer) -> None:
    still = replace(scorer.state.vehicles, along=torch.zeros_like(scorer.state.vehicles.along))
    at = Scorer(scorer.fit, replace(scorer.state, vehicles=still))
    assert unshifted(at, [CLOCK]) == []


def test_where_tracks_shifted_effects_of_all_passes_are_scored_without_the_shifts(scorer: Scorer) -> None:
    far = torch.full_like(scorer.state.vehicles.along, 3 * POLICY.shifted * scorer.fit.problem.prior.along)
    shifted = replace(scorer.state, vehicles=replace(scorer.state.vehicles, along=far))
    at = Scorer(scorer.fit, shifted)
    found = unshifted(at, [CLOCK, GAUGE, KNOWN["track_jitter"], KNOWN["generic_gain"]])
    assert {score.effect.name for _, score in found} <= {"clock_offset", "gauge_length"}
    for one, score in found:
        assert one.alone and one.variance == at.variance
        assert not one.state.vehicles.along.any(), "as the tracks say"
        torch.testing.assert_close(one.state.vehicles.amplitude, at.state.vehicles.amplitude)
        assert score.evidence > POLICY.late * max(other.evidence for _, other in found)


def test_an_effect_may_say_where_its_fit_starts(scorer: Scorer) -> None:
    """With numbers of its own and, where it says so, on another route."""
    distance = scorer.fit.problem.distance
    aside = np.column_stack([distance - distance.mean(), np.full(len(distance), 6.0), np.ones(len(distance))])
    for route in (None, lambda at: np.column_stack([np.interp(at, distance, aside[:, k]) for k in range(3)])):
        effect = replace(GAUGE, starts=lambda known, route=route: [Start((np.array([0.2]),), {}, route)])
        ((at, score),) = started_elsewhere(scorer, [effect])
        assert score.estimate.tolist() == [0.2] and score.counts == (1,) and score.fall == 0.0
        assert score.evidence <= 0.0, "its fit goes on by what its own steps gain"
        assert at.alone and at.variance == scorer.variance
        if route is None:
            torch.testing.assert_close(at.state.coefficients, scorer.state.coefficients)
        else:
            coefficients = at.state.coefficients.numpy()
            assert np.median(at.fit.basis.along(coefficients, distance)[:, 1]) == pytest.approx(6.0, abs=0.05)
    assert started_elsewhere(scorer, [GAUGE]) == []
    silent = replace(GAUGE, starts=lambda known: [])
    assert started_elsewhere(scorer, [silent]) == [] and elsewhere(scorer, [silent]) == unshifted(scorer, [silent])


def test_a_soft_layer_is_found_where_the_score_takes_it_for_a_stiff_one() -> None:
    """The route has followed the layer; what it could not follow looks like a layer of the other sign."""
    layer = KNOWN["layered_ground"]
    told = {"passes": 4, "snr_db": 18.2, "noise": "street", "view": (0.0, 54.5), "effects": {"layered_ground": 1.3}}
    fit = MapFit(strict_tracks(case_of(simulate(Scenario(name="layer", seed=9477, **told))).problem))
    scorer = Scorer(fit, solve(fit, fit.start()).state)
    score = scorer.reaching(max(scorer.scores(layer), key=lambda one: one.evidence))
    assert score.estimate[0] > 0
    found = race(scorer, [score], others=elsewhere(scorer, [layer]))["layered_ground"]
    assert found.solution.converged and found.estimate[0] == pytest.approx(-1.3, abs=5 * float(found.sigma[0]))


def test_long_vehicles_are_found_where_their_score_speaks_against_them() -> None:
    """Route and tracks have moved for them, so that their first small share on many axles gains next to nothing."""
    long = KNOWN["long_vehicle"]
    told = {"passes": 7, "snr_db": 10.2, "noise": "colored", "view": (0.0, 49.6), "effects": {"long_vehicle": 10.52}}
    fit = MapFit(strict_tracks(case_of(simulate(Scenario(name="long", seed=12975, **told))).problem))
    scorer = Scorer(fit, solve(fit, fit.start()).state)
    score = max(scorer.scores(long), key=lambda one: one.evidence)
    assert score.evidence < 0
    found = race(scorer, [], others=started_elsewhere(scorer, [long]))["long_vehicle"]
    assert found.solution.converged and found.evidence > 5 * POLICY.found
    assert found.shape["length"] == pytest.approx(10.52, abs=0.1)
    many = np.array([int(one.track_id) % 3 == 1 for one in fit.problem.passes])
    assert found.estimate[many].min() > 0.9 > 0.5 > found.estimate[~many].max()


def test_a_wide_pulse_is_found_from_far_where_something_unknown_leads() -> None:
    """Its fit from the score's estimate ends at a second minimum, of a narrow one."""
    told = {"passes": 4, "snr_db": 18.2, "noise": "colored", "view": (0.0, 45.0), "effects": {"pulse_width": 9.65}}
    fit = MapFit(strict_tracks(case_of(simulate(Scenario(name="pulse", seed=4, **told))).problem))
    scorer = Scorer(fit, solve(fit, fit.start()).state)
    names = ("pulse_width", "generic_neighbors")
    best = [max(scorer.scores(KNOWN[name]), key=lambda one: one.evidence) for name in names]
    tried = race(scorer, [scorer.reaching(one) for one in best])
    pulse, unknown = (tried[name] for name in names)
    assert unknown.evidence > 2 * pulse.evidence
    found = from_far(scorer, tried)["pulse_width"]
    assert found.evidence > unknown.evidence
    assert found.estimate[0] == pytest.approx(9.65**2, abs=5 * float(found.sigma[0]))
    assert not from_far(scorer, {"pulse_width": found})
    for behind in (5.0, 15.0):  # of the odds, in logs, that still count
        less = 2 * unknown.score.variance * (unknown.evidence - pulse.evidence + behind)
        late = tried | {"generic_neighbors": replace(unknown, fall=unknown.fall - less)}
        assert ("pulse_width" in from_far(scorer, late)) == (behind < POLICY.far)


@pytest.mark.parametrize(
    ("hoped", "fall", "most", "early", "expected"),
    [
        (7.0, 1.0, 12.0, False, False),
        (7.0, 1.0, 12.0, True, True),  # five e-folds behind: its probability counts
        (200.0, 1.0, 300.0, True, False),
        (-50.0, -1.0, 300.0, True, True),  # worse than nothing at its start
        (-50.0, -1.0, 300.0, False, False),
    ],
)
def test_early_only_what_is_far_behind_stops(
    hoped: float, fall: float, most: float, early: bool, expected: bool
) -> None:
    one: Any = SimpleNamespace(fall=fall, may_reach=lambda least, more: hoped > least)
    assert goes_on(one, most, float("inf"), early) is expected


def test_the_race_finds_the_size_and_the_winner(scorer: Scorer, score: Any) -> None:
    other = max(scorer.scores(CLOCK), key=lambda one: one.fall)
    told = []
    found = race(scorer, [score, other], told.append)
    assert sum(told) == 2 and set(found) == {"gauge_length", "clock_offset"}
    best = found["gauge_length"]
    assert best.fall > found["clock_offset"].fall and best.evidence > POLICY.found
    assert best.estimate[0] == pytest.approx(LONGER, abs=5 * float(best.sigma[0]))
    assert best.fit.problem.effects[-1] is GAUGE
    assert best.solution.converged and found["clock_offset"].solution.iterations == 0, "seen to be behind at its start"


def test_a_fit_that_leads_nowhere_leaves_the_race_to_the_rest(
    scorer: Scorer, score: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = max(scorer.scores(CLOCK), key=lambda one: one.fall)

    def solved(fit: MapFit, *given: Any, **more: Any) -> Any:
        if fit.problem.effects[-1] is CLOCK:
            raise np.linalg.LinAlgError("no numbers")
        return solve(fit, *given, **more)

    monkeypatch.setattr("solver.criticism.race.solve", solved)
    found = race(scorer, [score, other])
    assert set(found) == {"gauge_length"} and isinstance(found["gauge_length"], Refit)
