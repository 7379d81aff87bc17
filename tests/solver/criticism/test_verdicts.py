"""What a diagnosis concludes from candidates and refits that are given."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from solver.catalogue.catalogue import built_in
from solver.criticism import beside, diagnosis
from solver.criticism.bench import Asked, Bench
from solver.criticism.beside import Beside, both_known
from solver.criticism.candidate import Candidate
from solver.criticism.diagnosis import judge, overlooked
from solver.criticism.score import FOUND
from solver.effect import Effect


def candidate(
    name: str, strength: float, *, generic: bool = False, numbers: int = 1, stage: str = "ground"
) -> Candidate:
    return Candidate(
        effect=name,
        stage=stage,
        generic=generic,
        verdict="present",
        delta_chi2=2 * strength,
        predicted=2 * strength,
        evidence=strength,
        p_value=0.0,
        estimate=1.0,
        sigma=0.1,
        unit="1",
        numbers=numbers,
        shape={},
        retained_share=1.0,
        detectable_size=0.1,
        refitted=True,
        families=built_in()[name].families,
    )


def refit(name: str, strength: float, *, generic: bool = False, numbers: int = 1) -> Any:
    effect = SimpleNamespace(name=name, generic=generic, stage="ground", families=built_in()[name].families)
    score = SimpleNamespace(freedom=numbers, fall=2 * strength, effect=effect)
    return SimpleNamespace(effect=effect, evidence=strength, fall=2 * strength, score=score, pushed=False)


def shown(one: Any) -> Any:
    """A score that, raced, ends as a refit."""
    return SimpleNamespace(effect=one.effect, evidence=one.evidence, fall=one.fall, refit=one)


class Judged:
    """A bench of given candidates, none of them a fault."""

    def __init__(self, *, leveled: bool = False) -> None:
        self.audit, self.scorer = SimpleNamespace(leveled=leveled, loud=0.3), SimpleNamespace(stress=0.0)

    def is_fault(self, one: Candidate) -> bool:
        return False

    def effect(self, one: Candidate) -> Effect:
        return built_in()[one.effect]


ASKED = Asked(list(built_in().values()), held_out=False, advance=lambda n: None)


@pytest.mark.parametrize(
    ("second", "numbers", "rest", "looser", "named"),
    [
        (900.0, 1, 0.0, 6, True),
        (300.0, 1, 0.0, 6, False),
        (900.0, 60, 0.0, 6, False),
        (900.0, 1, 1200.0, 6, False),
        # Wheels of eight vehicles, beside which their trains have twice as many numbers.
        (900.0, 24, 0.0, 6, False),
        (900.0, 24, 0.0, 48, True),
        (900.0, 30, 0.0, 48, False),
    ],
)
@pytest.mark.parametrize("many_first", [False, True])
def test_two_strict_laws_that_explain_more_than_a_discrepancy_model(
    monkeypatch: pytest.MonkeyPatch,
    second: float,
    numbers: int,
    rest: float,
    looser: int,
    named: bool,
    many_first: bool,
) -> None:
    """Together they must explain more; neither as flexible as the discrepancy model, and nothing left over to one."""
    of_first, numbers = (numbers, 1) if many_first else (1, numbers)
    after = {"pulse_width": refit("pulse_width", second, numbers=numbers)}
    if rest:
        after["generic_time_filter"] = refit("generic_time_filter", rest, generic=True, numbers=6)
    others = [one.score for one in after.values()]
    left = Beside(SimpleNamespace(), others, after)  # type: ignore[arg-type]
    monkeypatch.setattr(Beside, "of", lambda *given: left)
    first = candidate("gibson_soil", 700.0, numbers=of_first)
    discrepancy = candidate("generic_time_filter", 1000.0, generic=True, numbers=looser)
    bench: Any = SimpleNamespace()
    found = both_known(bench, first, discrepancy, {"gibson_soil": refit("gibson_soil", 700.0)}, ASKED)
    assert (found is left) == named


@pytest.mark.parametrize(("left", "asked_again"), [(400.0, True), (20.0, False)])
def test_what_did_not_show_before_is_asked_where_the_winner_leaves_much(
    monkeypatch: pytest.MonkeyPatch, left: float, asked_again: bool
) -> None:
    """Clipping did not show beside vehicles that bounce much more strongly, and then seemed to be something unknown."""
    discrepancy, late = refit("generic_nonlinearity", left, generic=True, numbers=6), refit("saturation", 1.1 * left)
    bounce, clips = (built_in()[name] for name in ("dynamic_load", "saturation"))
    problem = SimpleNamespace(effects=[bounce], base_parts=set())
    at = SimpleNamespace(
        scorer=SimpleNamespace(fit=SimpleNamespace(problem=problem)), table=[shown(discrepancy)], audit=None
    )
    scored: list[str] = []

    def score_all(scorer: Any, effects: Any, advance: Any) -> list[Any]:
        scored.extend(one.name for one in effects)
        return [shown(late)]

    monkeypatch.setattr(Bench, "of", lambda *given: at)
    monkeypatch.setattr(beside, "solve", lambda *given, **more: SimpleNamespace(state=None))
    monkeypatch.setattr(beside, "score_all", score_all)
    monkeypatch.setattr(beside, "race", lambda scorer, scores, advance: {s.effect.name: s.refit for s in scores})
    winner: Any = SimpleNamespace(fit=None, solution=None)
    asked = Asked([bounce, clips], held_out=False, advance=lambda n: None)
    before: Any = SimpleNamespace(table=[], audit=None)
    found = Beside.of(before, candidate("dynamic_load", 1000.0), winner, asked)
    assert scored == (["saturation"] if asked_again else [])
    assert ("saturation" in found.tried) == asked_again
    assert found.doubt(candidate("dynamic_load", 1000.0)) is None


@pytest.mark.parametrize(
    ("winner", "again"),
    [("generic_train", ["gibson_soil", "long_vehicle"]), ("generic_delay", ["clock_offset"]), ("lowpass", [])],
)
def test_what_a_discrepancy_model_may_imitate_is_fitted_before_the_verdict_is_unknown(
    monkeypatch: pytest.MonkeyPatch, winner: str, again: list[str]
) -> None:
    """Five axles over 14 m showed a fifth of what a train did, and explain more: 1009 of the blind trials."""
    monkeypatch.setattr(
        diagnosis, "score_candidate", lambda s, end: candidate(s.effect.name, s.evidence, stage=s.effect.stage)
    )
    strengths = {winner: 2800.0, "pulse_width": 1900.0, "clock_offset": 1500.0}
    strengths |= {"gibson_soil": 980.0, "long_vehicle": 650.0, "road_bump": 2.0}
    table = [SimpleNamespace(effect=built_in()[name], evidence=size) for name, size in strengths.items()]
    tried: dict[str, Any] = {
        name: SimpleNamespace(effect=built_in()[name], evidence=strengths[name]) for name in (winner, "pulse_width")
    }
    bench: Any = SimpleNamespace(table=table)
    assert [one.effect.name for one in overlooked(bench, tried)] == again
    assert overlooked(bench, {}) == []


@pytest.mark.parametrize("strength", [FOUND + 8, 20 * FOUND])
def test_noise_that_is_weaker_where_vehicles_are_loud_hides_no_strong_effect(
    monkeypatch: pytest.MonkeyPatch, strength: float
) -> None:
    """A gain that follows the signal makes weak effects seem: then it is said that the record was leveled."""
    seen: list[str] = []
    monkeypatch.setattr(diagnosis, "concluded", lambda bench, verdict, *more: seen.append(verdict))
    monkeypatch.setattr(diagnosis, "placed", lambda one, bench: one)
    monkeypatch.setattr(diagnosis, "confirmed", lambda *given: seen.append("missing-effect"))
    listed = [candidate("stiffness_contrast", strength), candidate("generic_nonlinearity", 0.0, generic=True)]
    listed[1] = replace(listed[1], verdict="negligible")
    bench: Any = Judged(leveled=True)
    judge(bench, listed, {"stiffness_contrast": refit("stiffness_contrast", strength)}, ASKED)
    assert seen == ["missing-effect" if strength > diagnosis.PLAIN else "unknown-effect"]


@pytest.mark.parametrize(
    ("first", "strength", "discrepancy", "rival", "named"),
    [
        ("layered_ground", 22.0, "generic_twin", 17.0, False),
        ("layered_ground", 22.0, "generic_twin", 13.0, True),
        ("layered_ground", 200.0, "generic_twin", 197.0, True),
        ("layered_ground", 270.0, "generic_twin", 276.0, False),
        ("gibson_soil", 8011.0, "generic_twin", 8042.0, True),
        ("camber", 25.0, "generic_shift", 23.0, False),
        ("camber", 25.0, "generic_shift", 18.0, True),
        ("shear_lag", 22.0, "generic_twin", 17.0, False),
        ("track_offset", 74.0, "generic_shift", 78.0, False),
        ("track_offset", 74.0, "generic_shift", 70.0, True),
        ("track_bend", 102.0, "generic_track", 101.0, True),
        # Of its stage alone: bent tracks, which are longer on one side; of its family alone: it is at another stage.
        ("track_scale", 42.0, "generic_track", 47.0, True),
        ("track_bias", 50.0, "generic_delay", 53.0, True),
    ],
)
def test_an_effect_that_something_unknown_explains_as_well(
    monkeypatch: pytest.MonkeyPatch, first: str, strength: float, discrepancy: str, rival: float, named: bool
) -> None:
    """Trucks seen beside their wheels, or light by two ways, had been named layered ground; or an offset of all tracks.

    What the route hides is said with its twins here too.
    """
    seen: list[str] = []
    monkeypatch.setattr(diagnosis, "confirmed", lambda *given: seen.append("missing-effect"))
    known = built_in()
    listed = [
        candidate(first, strength, stage=known[first].stage),
        candidate(discrepancy, rival, generic=True, stage=known[discrepancy].stage),
    ]
    bench: Any = Judged()
    found = judge(bench, listed, {first: refit(first, strength)}, ASKED)
    assert seen == (["missing-effect"] if named else [])
    if not named:
        assert found.verdict == "inconclusive"
        assert first in found.words
        assert discrepancy in found.words
        assert found.separate
        assert [one.verdict for one in found.candidates] == ["inconclusive", "inconclusive"]
        assert ("poisson_ratio" in found.words) == (first == "camber")
        assert found.candidates[0].confounded_with == tuple(diagnosis.hidden_with(found.candidates[0], ASKED.effects))


@pytest.mark.parametrize(
    ("second", "numbers", "also", "stage"),
    [
        ("dynamic_load", 18, False, "load"),
        ("generic_road", 12, False, "load"),
        ("generic_road", 12, True, "trajectory"),
    ],
)
def test_what_fits_only_at_a_size_that_cannot_be_leaves_the_stage_to_what_can(
    monkeypatch: pytest.MonkeyPatch, second: str, numbers: int, also: bool, stage: str
) -> None:
    """A rough road had moved the route, and seemed a bend of all tracks by two meters."""
    monkeypatch.setattr(diagnosis, "placed", lambda one, bench: one)
    generic = second.startswith("generic")
    listed = [
        candidate("track_bend", 2000.0, numbers=13, stage="trajectory"),
        candidate(second, 1500.0, generic=generic, numbers=numbers, stage="load"),
    ]
    tried = {one.effect: refit(one.effect, one.evidence, generic=one.generic) for one in listed}
    tried["track_bend"].pushed, tried[second].pushed = True, also
    bench: Any = Judged()
    found = judge(bench, listed, tried, ASKED)
    assert found.verdict == "unknown-effect"
    assert f"at the {stage} stage" in found.words
    assert found.candidates[0].stage == stage
    verdicts = {one.effect: one.verdict for one in found.candidates}
    assert verdicts == {"track_bend": "excluded", second: "present" if generic and not also else "inconclusive"}


def test_what_the_route_hides_is_said_to_be_inseparable_even_where_passes_held_out_do_not_confirm_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nothing = Beside(SimpleNamespace(faults=[]), [], {})  # type: ignore[arg-type]
    monkeypatch.setattr(Beside, "of", lambda *given: nothing)
    monkeypatch.setattr(diagnosis, "held_out_gain", lambda scorer, winner: -1e-6)
    won = refit("track_scale", 29.0)
    bench: Any = Judged()
    bench.table = [shown(won)]
    asked = replace(ASKED, held_out=True)
    found = judge(bench, [candidate("track_scale", 29.0, stage="trajectory")], {"track_scale": won}, asked)
    assert found.verdict == "inconclusive"
    assert found.candidates[0].confounded_with == ("track_offset", "track_rotation", "channel_stretch")
    assert "cannot tell it from track_offset, track_rotation, channel_stretch" in found.words
    assert "anchors" in found.separate
