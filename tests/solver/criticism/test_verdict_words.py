"""Verdicts in words: what is missing, how large, what it cannot be told from, and what would help."""

import re
from dataclasses import replace

import pytest

from solver.catalogue.catalogue import built_in, family
from solver.criticism.candidate import Candidate, idle_candidate
from solver.criticism.explanations import Weighed
from solver.criticism.policy import POLICY
from solver.criticism.verdict_words import (
    ADVICE,
    advice,
    beside_unknown_words,
    impossible_words,
    left_open,
    leveled_words,
    missing_words,
    negligible_words,
    open_words,
    power_words,
    size_words,
    twin_words,
    unknown_words,
    untrusted_words,
)


def found(name: str = "gauge_length", **changes) -> Candidate:
    values = {"estimate": 1.2345, "sigma": 0.0678, "unit": "m", "delta_chi2": 345.6, "verdict": "present"}
    return replace(idle_candidate(built_in()[name]), **values | changes)


def test_a_size_has_its_sigma_and_unit_and_a_pure_number_none():
    assert size_words(found()) == "size 1.234 ± 0.068 m"
    assert size_words(found(unit="1")) == "size 1.234 ± 0.068"


@pytest.mark.parametrize(("left", "more"), [(POLICY.found - 0.1, False), (POLICY.found + 0.1, True)])
def test_a_missing_effect_says_stage_size_and_whether_more_is_missing(left, more):
    words = missing_words(found(), left)
    assert words.startswith("gauge_length is missing at the interrogator stage; size 1.23")
    assert "lowers chi2 by 346" in words
    assert ("more is missing beside it" in words) is more


def test_what_it_cannot_be_told_from_is_said_with_every_verdict():
    first = found(confounded_with=("pulse_width", "shear_lag"))
    said = "This survey cannot tell it from pulse_width, shear_lag"
    for words in (
        missing_words(first, 0.0),
        untrusted_words(first),
        open_words(first, [Weighed("effect", ("gauge_length",), "interrogator", 0.6)]),
        twin_words(first),
    ):
        assert words.endswith(said)
    assert twin_words(found()) == ""


def test_what_stays_open_is_said_of_all_that_were_added():
    first, second = found(confounded_with=("pulse_width",)), found("camber", confounded_with=())
    assert left_open([first, second]).startswith("Still open: this survey cannot tell gauge length from pulse width.")
    assert left_open([second]) == left_open([]) == ""


def test_advice_is_of_the_families_that_both_belong_to():
    effects = list(built_in().values())
    for kind in ADVICE:
        one, *others = family(kind, effects)
        first = found(one, confounded_with=tuple(others[:1]))
        if others:
            assert ADVICE[kind] in advice(first, effects)
    assert advice(found(), effects) == ""
    stranger = next(n for n in built_in() if not set(built_in()[n].families) & set(built_in()["gauge_length"].families))
    assert advice(found(confounded_with=(stranger,)), effects) == "another lane, other speeds, or an anchor"


def test_something_unknown_is_said_by_what_it_does_and_what_is_nearest():
    words = unknown_words(
        found(delta_chi2=1000.0), "Each channel holds shares of others.", [found("camber", delta_chi2=400.0)]
    )
    assert "as if each channel holds shares of others (gauge_length)" in words
    assert words.endswith("nearest is camber, with 40 % of it")
    assert "nearest" not in unknown_words(found(), "It blurs.", [])


def test_an_impossible_size_is_reported_with_it():
    assert "only at an impossible size (size 1.234 ± 0.068 m)" in impossible_words(found(), "ground")
    assert impossible_words(found(), "ground").endswith("at the ground stage")


def test_a_gain_that_follows_the_signal_is_reported_in_percent():
    assert "the noise has 42 % of the variance" in leveled_words(0.42)


def test_what_could_have_hidden_is_named_but_no_discrepancy_model():
    every = [found(verdict="inconclusive"), found("camber", verdict="excluded")]
    generic = found(next(n for n, one in built_in().items() if one.generic), verdict="inconclusive")
    assert re.fullmatch(r"It could not have shown: gauge_length\.", power_words([*every, generic]))
    assert power_words([every[1], generic]) == "Every effect of the catalogue would have shown at a plausible size."


def test_what_is_open_is_said_with_its_probabilities():
    among = [
        Weighed("effect", ("gauge_length",), "interrogator", 0.6),
        Weighed("unknown", ("generic_twin",), "cable", 0.25),
        Weighed("nothing", (), "", 0.12),
    ]
    words = open_words(found(), among)
    assert words.endswith("gauge_length 60 %, something unknown at the cable stage 25 %, nothing 12 %")


def test_what_a_known_effect_leaves_and_what_does_not_matter():
    words = beside_unknown_words("camber", found(), "It blurs.")
    assert words.startswith("camber explains the most of all known effects") and "as if it blurs" in words
    assert negligible_words(found(), "So it is.").endswith("is negligible: size 1.234 ± 0.068 m. So it is.")
