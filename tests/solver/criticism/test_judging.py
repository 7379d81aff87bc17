"""What a verdict says, on posteriors that are given."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from solver.catalogue.catalogue import built_in, family
from solver.criticism import judging
from solver.criticism.bench import Asked
from solver.criticism.candidate import Candidate
from solver.criticism.diagnosis import steps, with_fault
from solver.criticism.explaining import Explainer, in_order
from solver.criticism.explanations import Explanation, Posterior, Weighed
from solver.criticism.judging import NEVER_ALONE, Weighing, best_pair, hidden_with, judge, leading, order
from solver.criticism.placing import levels
from solver.criticism.policy import POLICY
from solver.effect import Effect
from solver.fit.held_out_gain import HeldOutGain

KNOWN = built_in()
EVERY = list(KNOWN.values())
ASKED = Asked(EVERY, held_out=False, advance=lambda n: None)


def candidate(name: str, strength: float, **changes: Any) -> Candidate:
    one = KNOWN[name]
    found = Candidate(
        effect=name,
        stage=one.stage,
        generic=one.generic,
        verdict="present",
        delta_chi2=2 * strength,
        predicted=2 * strength,
        evidence=strength,
        p_value=0.0,
        estimate=1.0,
        sigma=0.1,
        unit="1",
        numbers=1,
        shape={},
        retained_share=1.0,
        detectable_size=0.1,
        refitted=True,
        families=one.families,
    )
    return replace(found, **changes)


class Judged:
    """A bench of given candidates, none of them a fault."""

    def __init__(self, *, leveled: bool = False) -> None:
        self.audit = SimpleNamespace(leveled=leveled, loud=0.3)
        self.scorer = SimpleNamespace(stress=0.0, variance=1.0)
        self.faults: list[Any] = []
        self.table: list[Any] = []

    def is_fault(self, one: Candidate) -> bool:
        return False

    def effect(self, one: Candidate) -> Effect:
        return KNOWN[one.effect]


def share(kind: str, probability: float, *effects: str, stage: str = "") -> Weighed:
    return Weighed(kind, effects, stage or (KNOWN[effects[0]].stage if effects else ""), probability)


def judged(
    listed: list[Candidate], *weighed: Weighed, leveled: bool = False, pushed: tuple[str, ...] = (), **besides: Any
) -> Any:
    tried: Any = {c.effect: SimpleNamespace(pushed=c.effect in pushed) for c in listed if c.refitted}
    bench: Any = Judged(leveled=leveled)
    ranked = tuple(sorted(weighed, key=lambda one: -one.probability))
    return judge(bench, listed, tried, ASKED, Weighing(Posterior(ranked), besides))


def names(listed: Any) -> list[str]:
    return [one.effect for one in listed]


def test_one_is_put_at_the_head_and_the_rest_keep_their_order():
    listed = [candidate(name, 10.0) for name in ("camber", "lowpass", "saturation")]
    assert names(order(listed, listed[2])) == ["saturation", "camber", "lowpass"]
    assert names(order(listed, candidate("braking", 1.0))) == ["braking", "camber", "lowpass", "saturation"]


def test_whatever_else_lowers_the_misfit_is_open_until_the_first_is_in_the_model():
    listed = [candidate("camber", 10.0), candidate("lowpass", 9.0, verdict="excluded"), candidate("braking", 8)]
    found = leading(listed, listed[2])
    assert names(found) == ["braking", "camber", "lowpass"]
    assert [one.verdict for one in found] == ["present", "inconclusive", "excluded"]


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


def test_steps_are_counted_for_the_progress_bar():
    assert steps(EVERY) - steps(EVERY[:-1]) == 2
    assert steps([]) > 2 * POLICY.racers


LISTED = [candidate("gauge_length", 500.0), candidate("pulse_width", 480.0), candidate("generic_twin", 450.0)]


def test_nothing_holds_most():
    found = judged(
        [candidate("lowpass", 3.0, verdict="inconclusive")], share("nothing", 0.9), share("effect", 0.1, "lowpass")
    )
    assert found.verdict == "adequate"
    assert found.words == "nothing is missing that this survey could show. It could not have shown: lowpass."
    assert found.candidates[0].probability == 0.1


def test_one_effect_holds_all_but_little():
    found = judged(LISTED, share("effect", 0.97, "gauge_length"), share("nothing", 0.03))
    first = found.candidates[0]
    assert (found.verdict, first.effect, first.verdict, first.confounded_with) == (
        "missing-effect", "gauge_length", "present", ()
    )  # fmt: skip
    assert first.probability == 0.97
    assert [c.verdict for c in found.candidates[1:]] == ["inconclusive", "inconclusive"]
    assert found.words.startswith("gauge_length is missing at the interrogator stage")
    assert found.explanations[0].effects == ("gauge_length",)


def test_a_set_is_named_together():
    found = judged(
        LISTED, share("effect", 0.7, "gauge_length"), share("effect", 0.28, "pulse_width"), share("nothing", 0.02)
    )
    assert found.verdict == "missing-effect"
    assert found.candidates[0].confounded_with == ("pulse_width",)
    assert "cannot tell it from pulse_width" in found.words and found.separate


def test_more_beside_it_is_said():
    beside = SimpleNamespace(second=POLICY.found + 1)
    weighed = share("two", 0.99, "gauge_length", "lowpass"), share("nothing", 0.01)
    found = judged(LISTED, *weighed, gauge_length=beside)
    assert "more is missing beside it" in found.words and found.left == POLICY.found + 1
    assert "more is missing" not in judged(LISTED, *weighed).words


def test_something_unknown_holds_most():
    found = judged(
        LISTED, share("unknown", 0.9, "generic_twin", stage="interrogator"), share("effect", 0.1, "gauge_length")
    )
    first = found.candidates[0]
    assert (found.verdict, first.effect, first.stage) == ("unknown-effect", "generic_twin", "interrogator")
    assert "at the interrogator stage" in found.words and "nearest is gauge_length, with 111 % of it" in found.words


def test_something_unknown_that_a_known_effect_stands_in_for():
    found = judged(LISTED, share("unknown", 0.9, "generic_twin", "gauge_length"), share("effect", 0.1, "gauge_length"))
    assert found.words.startswith("gauge_length explains the most of all known effects, but leaves too much")


def test_the_best_known_effect_at_a_size_that_cannot_be():
    found = judged(LISTED, share("unknown", 0.9, "generic_twin", "gauge_length"), pushed=("gauge_length",))
    assert "only at an impossible size" in found.words
    assert {c.effect: c.verdict for c in found.candidates}["gauge_length"] == "excluded"


def test_noise_that_is_weaker_where_vehicles_are_loud():
    listed = [*LISTED, candidate("generic_gain", 20.0)]
    found = judged(listed, share("unknown", 0.9, "generic_gain", stage="processing"), leveled=True)
    assert (found.verdict, found.candidates[0].stage) == ("unknown-effect", "processing")
    assert "30 % of the variance" in found.words


@pytest.mark.parametrize("name", ["gauge_length", "camber"])
def test_neither_holds_enough(name):
    listed = [candidate(name, 20.0), candidate("generic_shift", 18.0)]
    found = judged(listed, share("effect", 0.6, name), share("unknown", 0.3, "generic_shift"), share("nothing", 0.1))
    assert found.verdict == "inconclusive" and found.separate
    assert f"{name} 60 %, something unknown at the trajectory stage 30 %, nothing 10 %" in found.words
    assert [one.verdict for one in found.candidates] == ["inconclusive", "inconclusive"]
    assert ("poisson_ratio" in found.words) == (name == "camber"), (
        "what the route hides is said with its twins here too"
    )


def test_what_shows_at_a_size_that_does_not_matter_is_not_missing():
    listed = [candidate("road_bump", 80.0, verdict="negligible")]
    found = judged(listed, share("effect", 0.99, "road_bump"), share("nothing", 0.01))
    assert found.verdict == "adequate" and "road_bump shows, but is negligible" in found.words


def test_of_two_that_explain_together_one_may_be_small_until_both_are_there():
    """Soil that stiffens with depth fitted best at a twentieth of its size while the cable's shear lag was absent."""
    listed = [candidate("gibson_soil", 80.0, verdict="negligible"), candidate("shear_lag", 7.0)]
    found = judged(listed, share("two", 0.99, "gibson_soil", "shear_lag"), share("nothing", 0.01))
    assert found.verdict == "missing-effect" and found.candidates[0].effect == "gibson_soil"


@pytest.mark.parametrize(
    ("gain", "verdict"),
    [
        (HeldOutGain(-30.0, 1e4, 1.0, 2.0, 25.0), "inconclusive"),
        # By chance, as far as the effect changes what is predicted.
        (HeldOutGain(-9.0, 1e4, 1.0, 2.0, 25.0), "missing-effect"),
        (HeldOutGain(30.0, 1e4, 1.0, 2.0, 25.0), "missing-effect"),
        # No group of passes shows it: they say nothing about the others.
        (None, "missing-effect"),
    ],
)
def test_passes_held_out_may_object_beyond_chance(monkeypatch: pytest.MonkeyPatch, gain, verdict) -> None:
    monkeypatch.setattr(judging, "gain_of", lambda scorer, winner: gain)
    bench: Any = Judged()
    tried: Any = {"track_scale": SimpleNamespace(pushed=False)}
    posterior = Posterior((share("effect", 0.99, "track_scale"), share("nothing", 0.01)))
    asked = replace(ASKED, held_out=True)
    found = judge(bench, [candidate("track_scale", 29.0)], tried, asked, Weighing(posterior, {}))
    assert found.verdict == verdict
    assert found.candidates[0].held_out_gain == (None if gain is None else gain.fall / gain.freedom)
    assert found.candidates[0].confounded_with == ("track_offset", "track_rotation", "channel_stretch")
    assert "cannot tell it from track_offset, track_rotation, channel_stretch" in found.words
    assert "anchors" in found.separate


def test_two_effects_that_explain_together_are_held_out_together():
    pair: Any = SimpleNamespace(effect=KNOWN["gibson_soil"])
    other: Any = SimpleNamespace(effect=KNOWN["lowpass"])
    beside: Any = SimpleNamespace(seconds=(other, pair))
    two = Weighed("two", ("road_bump", "gibson_soil"), "load", 0.9)
    alone = Weighed("effect", ("road_bump",), "load", 0.1)
    assert best_pair("road_bump", Weighing(Posterior((two, alone)), {"road_bump": beside})) is pair
    assert best_pair("road_bump", Weighing(Posterior((alone, two)), {"road_bump": beside})) is None
    assert best_pair("road_bump", Weighing(Posterior((two,)), {})) is None


def test_a_fault_that_was_mended_is_part_of_every_known_explanation():
    rest = [
        share("nothing", 0.5), share("effect", 0.3, "lowpass"), share("unknown", 0.1, "generic_echo"),
        share("overlooked", 0.1),
    ]  # fmt: skip
    found = [with_fault(one, "cycle_skips", "interrogator") for one in rest]
    assert [(one.kind, one.effects) for one in found] == [
        ("fault", ("cycle_skips",)), ("two", ("cycle_skips", "lowpass")), ("unknown", ("generic_echo",)),
        ("overlooked", ()),
    ]  # fmt: skip


def explainer(
    monkeypatch: pytest.MonkeyPatch, table: list[Any], tried: dict[str, Any], *, leveled: bool = False
) -> Explainer:
    bench: Any = Judged(leveled=leveled)
    bench.table = table
    found = Explainer(bench, tried, EVERY)
    monkeypatch.setattr(found, "stage", lambda one: "processing" if leveled else one.stage)
    return found


def scored(name: str, evidence: float) -> Any:
    return SimpleNamespace(effect=KNOWN[name], evidence=evidence)


def fitted(name: str, evidence: float, *, pushed: bool = False) -> Any:
    return SimpleNamespace(effect=KNOWN[name], evidence=evidence, pushed=pushed)


def test_every_explanation_has_its_evidence(monkeypatch):
    tried = {"gauge_length": fitted("gauge_length", 500.0), "generic_twin": fitted("generic_twin", 450.0)}
    table = [scored("gauge_length", 400.0), scored("lowpass", 3.0), scored("generic_twin", 410.0)]
    beside: Any = SimpleNamespace(
        refit=tried["gauge_length"],
        tolerated=5.0,
        seconds=[fitted("lowpass", 30.0)],
        table=[scored("lowpass", 20.0), scored("generic_twin", 7.0)],
    )
    found = explainer(monkeypatch, table, tried).all({"gauge_length": beside})
    evidence = {(one.kind, one.effects): one.evidence for one in found}
    assert evidence == {
        ("nothing", ()): 0.0,
        ("overlooked", ()): 0.0,
        ("effect", ("gauge_length",)): 505.0,
        ("effect", ("lowpass",)): 3.0,
        ("two", ("gauge_length", "lowpass")): 535.0,
        ("unknown", ("generic_twin", "gauge_length")): 512.0,
        ("unknown", ("generic_twin",)): 450.0,
    }
    simpler = {one.effects: one.simpler for one in found}
    assert simpler["generic_twin", "gauge_length"] == simpler["gauge_length", "lowpass"] == ("gauge_length", 505.0)
    prior = {one.effects: one.prior for one in found}
    assert prior["generic_twin", "gauge_length"] < prior["generic_twin",] / 10


@pytest.mark.parametrize(("second", "names"), [(300.0, ("lowpass", "camber")), (600.0, ("camber", "lowpass"))])
def test_of_two_the_one_that_explains_more_alone_is_first_and_must_be_beaten(second, names):
    pair = Explanation("two", ("lowpass", "camber"), "interrogator", 0.01, 620.0, ("lowpass", 500.0))
    alone = {
        name: Explanation("effect", (name,), KNOWN[name].stage, 0.1, evidence)
        for name, evidence in (("lowpass", 500.0), ("camber", second))
    }
    found = in_order(pair, alone)
    assert (found.effects, found.simpler) == (names, (names[0], max(500.0, second)))
    assert found.stage == KNOWN[names[0]].stage


def test_an_effect_at_a_size_that_cannot_be_only_stands_in_for_the_unknown(monkeypatch):
    tried = {"gauge_length": fitted("gauge_length", 500.0, pushed=True)}
    beside: Any = SimpleNamespace(
        refit=tried["gauge_length"],
        tolerated=5.0,
        seconds=[],
        table=[scored("lowpass", 20.0), scored("generic_twin", 7.0)],
    )
    found = explainer(monkeypatch, [scored("gauge_length", 400.0)], tried).all({"gauge_length": beside})
    assert [(one.kind, one.effects) for one in found] == [
        ("nothing", ()),
        ("overlooked", ()),
        ("unknown", ("generic_twin", "gauge_length")),
    ]
    assert found[-1].simpler == ("", 0.0)


def test_leveled_noise_speaks_for_something_in_the_processing(monkeypatch):
    plain = explainer(monkeypatch, [scored("generic_gain", -4.0)], {}).all({})[-1]
    loud = explainer(monkeypatch, [scored("generic_gain", -4.0)], {}, leveled=True).all({})[-1]
    assert plain.evidence == -4.0
    assert (loud.stage, loud.evidence) == ("processing", POLICY.leveled)
