"""The parts of a verdict, on tables of candidates that are given."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from test_verdicts import ASKED, Judged, candidate, refit, shown

from solver.catalogue.catalogue import built_in, family
from solver.criticism import diagnosis
from solver.criticism.beside import CLOSE, FEW, MANY
from solver.criticism.diagnosis import (
    ALIKE,
    NEVER_ALONE,
    RIVAL,
    confounded,
    held_out_gain,
    hidden_with,
    impossible,
    judge,
    leading,
    levels,
    order,
    plainest,
    steps,
    unknown_as_well,
)

KNOWN = built_in()
EVERY = list(KNOWN.values())


def of_numbers(name: str, strength: float, numbers: int, *, refitted: bool = True) -> Any:
    return replace(candidate(name, strength, numbers=numbers), refitted=refitted)


def names(listed: Any) -> list[str]:
    return [one.effect for one in listed]


def test_one_is_put_at_the_head_and_the_rest_keep_their_order():
    listed = [candidate(name, 10.0) for name in ("camber", "lowpass", "saturation")]
    assert names(order(listed, listed[2])) == ["saturation", "camber", "lowpass"]
    assert names(order(listed, candidate("braking", 1.0))) == ["braking", "camber", "lowpass", "saturation"]


def test_whatever_else_lowers_the_misfit_is_open_until_the_first_is_in_the_model():
    listed = [
        candidate("camber", 10.0),
        replace(candidate("lowpass", 9.0), verdict="excluded"),
        candidate("braking", 8),
    ]
    found = leading(listed, listed[2])
    assert names(found) == ["braking", "camber", "lowpass"]
    assert [one.verdict for one in found] == ["present", "inconclusive", "excluded"]


@pytest.mark.parametrize(
    ("many", "few", "chosen"),
    [
        (of_numbers("dynamic_load", 500.0, MANY + 1), of_numbers("saturation", 499.0, 1), "saturation"),
        (of_numbers("dynamic_load", 500.0, MANY), of_numbers("saturation", 499.0, 1), "dynamic_load"),
        (of_numbers("dynamic_load", 500.0, MANY + 1), of_numbers("saturation", 499.0, FEW + 1), "dynamic_load"),
        (of_numbers("dynamic_load", 500.0, MANY + 1), of_numbers("saturation", 300.0, 1), "dynamic_load"),
        (
            of_numbers("dynamic_load", 500.0, MANY + 1),
            of_numbers("saturation", 499.0, 1, refitted=False),
            "dynamic_load",
        ),
    ],
)
def test_the_plainest_explanation_is_one_of_few_numbers_that_explains_nearly_as_much(many, few, chosen):
    assert plainest([many, few]).effect == chosen


@pytest.mark.parametrize("name", [name for name, one in KNOWN.items() if not one.generic])
def test_what_the_route_hides_is_never_named_alone(name):
    found = hidden_with(candidate(name, 10.0), EVERY)
    assert name not in found
    kinds = set(NEVER_ALONE) & set(KNOWN[name].families)
    assert bool(found) == bool(kinds)
    assert set(found) == {twin for kind in kinds for twin in family(kind, EVERY)} - {name}


@pytest.mark.parametrize("name", ["generic_gain", "generic_echo", "saturation"])
def test_what_levels_all_channels_says_so(name):
    said = KNOWN[name].discrepancy
    assert levels(KNOWN[name]) == (said is not None and said.levels)


def test_some_discrepancy_model_levels():
    assert sum(map(levels, EVERY)) >= 1, "`judge` looks for one where the noise was leveled"


def test_steps_are_counted_for_the_progress_bar():
    assert steps(EVERY) - steps(EVERY[:-1]) == 2
    assert steps([]) > 2 * diagnosis.RACERS


@pytest.mark.parametrize(
    ("rival", "strength", "numbers", "open_still"),
    [
        # Beside a strong effect: one of another kind, as strict, that explains more than its law may be off by.
        ("generic_echo", 5001.0, 1, True),
        ("generic_echo", 5001.0, FEW + 1, False),
        ("generic_echo", 4800.0, 1, False),
        # One of its own stage and family is its law's own error.
        ("generic_kernel", 5600.0, 1, False),
    ],
)
def test_beside_a_strong_effect_only_a_strict_rival_of_another_kind_counts(rival, strength, numbers, open_still):
    first = candidate("gibson_soil", 4900.0, stage="ground")
    assert first.evidence > diagnosis.PLAIN
    other = candidate(rival, strength, generic=True, numbers=numbers, stage=KNOWN[rival].stage)
    bench: Any = Judged()
    assert unknown_as_well(first, [other], bench) is (other if open_still else None)


@pytest.mark.parametrize(("more", "open_still"), [(0.1, True), (-0.1, False)])
def test_beside_a_weak_effect_one_of_another_kind_need_only_come_close(more, open_still):
    first = candidate("gibson_soil", 40.0, stage="ground")
    rival = candidate("generic_echo", 40.0 - CLOSE + more, generic=True, stage="interrogator")
    kin = candidate("generic_kernel", 40.0 + more, generic=True, stage="ground")
    bench: Any = Judged()
    assert (unknown_as_well(first, [rival], bench) is rival) == open_still
    assert (unknown_as_well(first, [kin], bench) is kin) == open_still


def scored(name: str, strength: float) -> Any:
    return SimpleNamespace(effect=KNOWN[name], evidence=strength)


@pytest.mark.parametrize(
    ("alike", "rival", "told"),
    [
        (ALIKE + 0.01, None, True),  # the signals look alike, and it was not fitted
        (ALIKE - 0.01, None, False),
        (1.0, 0.99 * RIVAL, False),  # it was fitted, and explains too little
        (0.0, 1.01 * RIVAL, True),
    ],
)
def test_one_of_the_family_is_told_apart_by_its_signal_or_its_full_fit(monkeypatch, alike, rival, told):
    monkeypatch.setattr(diagnosis, "similarity", lambda scorer, one, other: alike)
    first = candidate("lowpass", 1000.0, stage="interrogator")
    bench: Any = SimpleNamespace(table=[scored("lowpass", 1000.0), scored("clock_offset", 500.0)], scorer=None)
    tried = {"lowpass": refit("lowpass", 1000.0)}
    if rival is not None:
        tried["clock_offset"] = refit("clock_offset", 1000.0 * rival)
    found = confounded(bench, first, [first], tried, EVERY)
    assert found == (("clock_offset",) if told else ())


def test_whatever_explains_as_much_is_not_told_apart_though_of_no_family(monkeypatch):
    monkeypatch.setattr(diagnosis, "similarity", lambda scorer, one, other: 0.0)
    first = candidate("saturation", 1000.0, stage="interrogator")
    listed = [
        first,
        of_numbers("braking", 1000.0 - CLOSE + 0.1, 1),
        of_numbers("road_bump", 1000.0 - CLOSE - 0.1, 1),
        of_numbers("long_vehicle", 1000.0, 1, refitted=False),
        replace(candidate("generic_echo", 1200.0, generic=True), refitted=True),
    ]
    bench: Any = SimpleNamespace(table=[scored("saturation", 1000.0)], scorer=None)
    assert confounded(bench, first, listed, {"saturation": refit("saturation", 1000.0)}, EVERY) == ("braking",)


def test_a_discrepancy_model_alone_is_the_unknown(monkeypatch):
    monkeypatch.setattr(diagnosis, "placed", lambda one, bench: replace(one, stage="processing"))
    bench: Any = Judged()
    found = judge(bench, [candidate("generic_echo", 300.0, generic=True)], {}, ASKED)
    assert (found.verdict, found.candidates[0].stage) == ("unknown-effect", "processing")
    assert "at the processing stage" in found.words and "nearest is" not in found.words


def test_nothing_present_is_adequate():
    bench: Any = Judged()
    absent = replace(candidate("lowpass", 3.0), verdict="inconclusive")
    found = judge(bench, [absent], {}, ASKED)
    assert (found.verdict, found.candidates, found.separate, found.left) == ("adequate", (absent,), "", 0.0)
    assert found.words.endswith("It could not have shown: lowpass.")


def test_what_was_not_fitted_in_full_is_not_named():
    bench: Any = Judged()
    found = judge(bench, [replace(candidate("lowpass", 300.0), refitted=False)], {}, ASKED)
    assert found.verdict == "adequate"


def test_where_all_that_fits_is_impossible_the_best_is_the_clue():
    listed = [candidate("track_bend", 2000.0, stage="trajectory")]
    pushed = refit("track_bend", 2000.0)
    pushed.pushed = True
    bench: Any = Judged()
    found = impossible(bench, listed[0], listed, {"track_bend": pushed})
    assert found.verdict == "unknown-effect" and "at the trajectory stage" in found.words
    assert [one.verdict for one in found.candidates] == ["excluded"]


@pytest.mark.parametrize(
    ("without", "with_it", "gain"), [(1.5, 1.2, 0.3), (1.2, 1.5, -0.3), (None, 1.2, None), (1.2, None, None)]
)
def test_the_gain_of_passes_held_out_is_what_their_misfit_falls_by(monkeypatch, without, with_it, gain):
    misfits = {"scorer": without, "winner": with_it}

    def misfit(problem: Any, at: Any) -> Any:
        chi2 = misfits[at[0].name]
        assert problem == f"{at[0].name}, as located" and at[1] == f"{at[0].name} state"
        return None if chi2 is None else SimpleNamespace(chi2_per_dof=chi2)

    monkeypatch.setattr(diagnosis, "held_out_misfit", misfit)
    monkeypatch.setattr(diagnosis, "as_located", lambda problem: f"{problem}, as located")
    monkeypatch.setattr(diagnosis, "side_by_side", lambda function, of: list(map(function, of)))

    def fit(name: str) -> Any:
        return SimpleNamespace(name=name, problem=name)

    scorer: Any = SimpleNamespace(fit=fit("scorer"), state="scorer state")
    winner: Any = SimpleNamespace(fit=fit("winner"), solution=SimpleNamespace(state="winner state"))
    found = held_out_gain(scorer, winner)
    assert found == (None if gain is None else pytest.approx(gain))


def test_a_bench_finds_effects_and_faults_by_name():
    from solver.criticism.bench import Bench

    fault = SimpleNamespace(name="cycle_skips")
    table: Any = [shown(refit("lowpass", 10.0))]
    table[0].effect = KNOWN["lowpass"]
    bench = Bench(SimpleNamespace(), SimpleNamespace(), table, [KNOWN["long_vehicle"]], [fault])  # type: ignore[arg-type,list-item]
    assert bench.effect(candidate("lowpass", 1.0)) is KNOWN["lowpass"]
    assert bench.effect(candidate("long_vehicle", 1.0)) is KNOWN["long_vehicle"]
    assert not bench.is_fault(candidate("lowpass", 1.0))
    assert bench.is_fault(replace(candidate("lowpass", 1.0), effect="cycle_skips"))
