"""What is said of an effect by its score: present, excluded, negligible or inconclusive."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import chi2

from solver.catalogue.catalogue import FAULTS, built_in
from solver.criticism.bench import racers
from solver.criticism.candidate import fault_candidate, first_kind, idle_candidate, score_candidate
from solver.criticism.fault import Fault
from solver.criticism.marginal import Spectrum, fault_evidence
from solver.criticism.policy import POLICY
from solver.criticism.score import Score
from solver.effect import Effect

RACERS, LOOSE = POLICY.racers, POLICY.unknown_racers
PLAIN = next(
    one
    for one in built_in().values()
    if len(one.amplitudes) == 1 and one.amplitudes[0].scope == "one" and not one.generic
)
PLAUSIBLE = PLAIN.amplitudes[0].plausible


def scored(size: float, sigma: float, effect: Effect = PLAIN, trials: int = 1) -> Score:
    """Score of an effect of one number, in units of its plausible size."""
    fall = (size / sigma) ** 2
    estimate, sigmas = np.array([size * PLAUSIBLE]), np.array([sigma * PLAUSIBLE])
    left = Spectrum(np.array([sigma**-2]), np.array([fall * sigma**-2]))
    return Score(effect, {}, False, fall, 1, trials, (1,), estimate, sigmas, 0.4, None, torch.zeros(1), left, 1.0)


@pytest.mark.parametrize(
    ("size", "sigma", "verdict"),
    [
        (1.0, 0.05, "present"),
        (1e-4, 1e-6, "negligible"),  # sure, and too small to matter
        (0.0, 0.05, "excluded"),  # half the plausible size would have shown
        (0.0, 0.3, "negligible"),  # one and a half times would have
        (0.0, 0.7, "inconclusive"),  # not even three times
        (0.0, 1e4, "inconclusive"),
    ],
)
def test_the_verdict_follows_from_size_and_what_would_have_shown(size, sigma, verdict):
    found = score_candidate(scored(size, sigma), None)
    assert found.verdict == verdict and not found.refitted
    assert found.estimate == pytest.approx(size * PLAUSIBLE) and found.sigma == pytest.approx(sigma * PLAUSIBLE)
    expected = 5 * sigma * PLAUSIBLE if sigma < 1e3 else np.inf
    assert found.detectable_size == pytest.approx(expected)


@pytest.mark.parametrize("trials", [1, 8])
def test_the_p_value_pays_for_the_shapes_tried(trials):
    found = score_candidate(scored(1.0, 0.25, trials=trials), None)
    assert found.p_value == pytest.approx(trials * chi2.sf(16.0, 1))
    assert found.evidence == pytest.approx(16 / 17 * 16 / 2 - np.log(17) / 2 - np.log(trials))
    assert score_candidate(scored(0.0, 1.0, trials=trials), None).p_value == 1.0


def test_of_many_numbers_alike_the_root_mean_square_is_reported():
    """Those that the survey does not hear count nowhere."""
    name = next(n for n, one in built_in().items() if any(p.scope == "fiber" for p in one.amplitudes))
    one = built_in()[name]
    values, sigmas = np.array([3.0, -4.0, 9.0]), np.array([0.1, 0.3, np.nan])
    more = np.zeros(len(one.amplitudes) - 1)
    score = Score(
        one, {}, False, 900.0, 2, 1, (3, *(1 for _ in more)),
        np.append(values, more), np.append(sigmas, np.full(len(more), np.nan)), 1.0, None, torch.zeros(1),
        Spectrum(np.ones(2), np.full(2, 900.0)), 1.0,
    )  # fmt: skip
    parameter, alike = first_kind(score)
    assert parameter is one.amplitudes[0] and alike.tolist()[:3] == [True, True, False] and not alike[3:].any()
    found = score_candidate(score, None)
    assert found.estimate == pytest.approx(np.sqrt((9 + 16) / 2)) and found.sigma == pytest.approx(0.2)


def test_an_effect_with_nothing_to_act_on_is_inconclusive():
    found = idle_candidate(PLAIN)
    assert (found.verdict, found.numbers, found.p_value, found.detectable_size) == ("inconclusive", 0, 1.0, np.inf)
    assert found.estimate == PLAIN.amplitudes[0].null and found.families == PLAIN.families


def fault(name: str, fall: float, estimate: float, sigma: float) -> Fault:
    return Fault(name, "load", fall, 4, 100, estimate, sigma, "1", 0.3, "words", lambda survey: survey)


@pytest.mark.parametrize(
    ("name", "fall", "estimate", "verdict"),
    [
        ("cycle_skips", 400.0, 0.001, "present"),
        ("cycle_skips", 10.0, 0.001, "excluded"),
        ("unseen_vehicle", 400.0, 1.0, "present"),
        ("unseen_vehicle", 400.0, 0.2, "excluded"),  # below five of its sigmas
    ],
)
def test_a_fault_is_present_by_its_evidence_and_a_vehicle_by_its_size_too(name, fall, estimate, verdict):
    found = fault_candidate(fault(name, 2 * fall, estimate, 0.05), 2.0)
    assert found.verdict == verdict and found.effect == name and not found.generic
    assert found.evidence == pytest.approx(fault_evidence(fall, 4, 100)) and found.detectable_size == 0.3
    assert (found.evidence > POLICY.found) or verdict == "excluded"
    assert set(FAULTS) >= {name}


def test_the_best_of_both_kinds_are_fitted_in_full():
    known = [one for one in built_in().values() if not one.generic and not one.varies][: RACERS + 2]
    loose = [one for one in built_in().values() if one.generic][: LOOSE + 1]
    table = sorted(
        [scored(1.0, 0.1 + 0.001 * n, one) for n, one in enumerate([*known, *loose])],
        key=lambda score: -score.evidence,
    )
    chosen = racers(table)
    assert [score.effect for score in chosen] == [*known[: RACERS - LOOSE], *loose[:LOOSE]]
    assert racers([scored(0.1, 1.0, one) for one in known]) == [], "what does not show is not fitted"


def test_known_effects_are_fitted_that_their_scores_speak_for_and_of_many_numbers_unless_against_them():
    """Channels out of step by their spacing scored 5, wandering channels 2: only these were fitted, and named."""
    one, many = (
        [known for known in built_in().values() if not known.generic and known.varies == varies][:RACERS]
        for varies in (False, True)
    )
    loose = next(known for known in built_in().values() if known.generic)
    strong, weak, hidden, absent, unknown = (
        [scored(size, sigma, effect) for effect in some]
        for some, size, sigma in (
            (one[:-1], 1.0, 0.1),
            (one[-1:], 1.0, 0.35),
            (many[:1], 0.2, 0.35),
            (many[1:2], 0.1, 0.1),
            ([loose], 1.0, 0.35),
        )
    )
    assert 0 < weak[0].evidence == unknown[0].evidence < POLICY.found
    assert -POLICY.bare < hidden[0].evidence < 0 and absent[0].evidence < -POLICY.bare
    assert racers([*weak, *unknown, *hidden, *absent]) == [*weak, *hidden], "the unknown must show"
    chosen = racers([*strong, *weak, *hidden, *absent])
    assert [score.effect for score in chosen] == [*one[: RACERS - LOOSE], many[0]]


def test_where_the_base_model_is_not_exact_more_must_show():
    """What would have shown grows with the root of the variance that the noise counts as."""
    exact = scored(1.0, 0.1)
    sure, unsure = score_candidate(exact, None), score_candidate(replace(exact, variance=9.0), None)
    assert unsure.detectable_size == pytest.approx(3 * sure.detectable_size)
    assert unsure.evidence < sure.evidence
