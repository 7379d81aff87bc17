"""What a known effect leaves, and whether that casts doubt on it, on tables made by hand."""

from types import SimpleNamespace
from typing import Any

import pytest
from test_verdicts import candidate, refit, shown

from solver.catalogue.catalogue import built_in
from solver.criticism.beside import (
    AS_STRICT,
    ASTRAY,
    CLOSE,
    FEW,
    FINER,
    LEFT,
    MANY,
    STRICTER,
    Beside,
    akin,
    of_family,
    outdone,
    suspects,
)
from solver.criticism.score import FOUND

KNOWN = built_in()
FIRST = candidate("lowpass", 2000.0, stage="interrogator")  # chi2 falls by 4000
NOWHERE: Any = SimpleNamespace()


def beside(*refits: Any) -> Beside:
    """What these refits are beside a winner."""
    others = [SimpleNamespace(effect=one.effect, fall=one.fall, evidence=one.evidence) for one in refits]
    return Beside(NOWHERE, others, {one.effect.name: one for one in refits})  # type: ignore[arg-type]


@pytest.mark.parametrize("numbers", [1, FEW, FEW + 1, 40])
def test_a_discrepancy_model_must_explain_more_than_a_share_and_a_margin(numbers):
    share = STRICTER if numbers > FEW else AS_STRICT
    edge = (500.0 + CLOSE) / share
    assert not outdone(500.0, edge - 0.01, numbers)
    assert outdone(500.0, edge + 0.01, numbers)


def test_a_strict_discrepancy_model_is_held_to_less():
    """Between the two shares only one of few numbers wins."""
    between = (1000.0 + CLOSE) / (0.5 * (STRICTER + AS_STRICT))
    assert outdone(1000.0, between, FEW) and not outdone(1000.0, between, FEW + 1)


@pytest.mark.parametrize(
    ("name", "stage", "family"),
    [
        ("generic_neighbors", True, True),  # of the interrogator, and blurs
        ("generic_kernel", False, True),  # blurs, in the ground
        ("generic_echo", True, False),
        ("generic_track", False, False),
    ],
)
def test_kin_are_of_the_stage_or_the_family(name, stage, family):
    assert KNOWN[name].stage == FIRST.stage or not stage
    assert of_family(FIRST, KNOWN[name]) == family
    assert akin(FIRST, KNOWN[name]) == (stage or family)


def test_what_has_no_family_is_of_none():
    assert not of_family(candidate("saturation", 1.0), KNOWN["generic_gain"])
    assert not of_family(candidate("saturation", 1.0), KNOWN["generic_shift"])


@pytest.mark.parametrize(
    ("name", "share", "numbers"),
    [
        ("generic_neighbors", LEFT, 1),  # of its own kind
        ("generic_neighbors", FINER, MANY + 1),  # on knots, of which finer ones are left
        ("generic_track", ASTRAY, 1),  # of another kind
        ("generic_track", ASTRAY, MANY + 1),
    ],
)
def test_a_law_may_be_off_by_a_share_of_what_it_explains(name, share, numbers):
    first = candidate("lowpass", 2000.0, stage="interrogator", numbers=numbers)
    edge = share * first.delta_chi2 / 2
    more = refit(name, edge + 0.1, generic=True, numbers=6)
    assert beside(more).doubt(first) is more
    assert beside(refit(name, edge - 0.1, generic=True, numbers=6)).doubt(first) is None


def test_one_of_another_kind_counts_as_kin_where_kin_explain_as_much():
    """It is the same that is left, whatever model takes it up."""
    astray, kin = refit("generic_track", 80.0, generic=True, numbers=6), refit("generic_neighbors", 80.0, generic=True)
    assert ASTRAY * FIRST.delta_chi2 < 2 * 80.0
    assert beside(astray).doubt(FIRST) is astray
    assert beside(astray, kin).doubt(FIRST) is None
    weaker = refit("generic_neighbors", 79.0, generic=True)
    assert beside(astray, weaker).doubt(FIRST) is astray


def test_what_a_known_effect_explains_as_well_casts_no_doubt():
    left = refit("generic_track", 500.0, generic=True, numbers=6)
    assert beside(left).doubt(FIRST) is left
    assert beside(left, refit("clock_offset", 499.0)).doubt(FIRST) is None
    assert beside(left, refit("clock_offset", 400.0)).doubt(FIRST) is left


def test_nothing_left_casts_no_doubt():
    nothing = beside()
    assert (nothing.left, nothing.known, nothing.discrepancy) == (0.0, 0.0, None)
    assert nothing.doubt(FIRST) is None
    assert beside(refit("clock_offset", 900.0)).doubt(FIRST) is None, "a known effect is a second one"


def test_the_best_of_both_kinds_are_told_apart():
    found = beside(
        refit("generic_echo", 90.0, generic=True),
        refit("clock_offset", 70.0),
        refit("camber", 75.0),
        refit("generic_track", 60.0, generic=True),
    )
    assert found.left == 90.0 and found.known == 75.0
    assert found.discrepancy is found.tried["generic_echo"]


def test_suspects_are_those_that_showed_and_all_discrepancy_models():
    table = [shown(refit("clock_offset", FOUND + 1)), shown(refit("camber", FOUND - 1))]
    asked = [KNOWN[name] for name in ("clock_offset", "camber", "lowpass", "generic_echo", "generic_gain")]
    names = [one.name for one in suspects(table, asked)]  # type: ignore[arg-type]
    assert names == ["clock_offset", "generic_echo", "generic_gain"]
