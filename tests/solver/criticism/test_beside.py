"""What a known effect leaves: what its law may be off by, and what a second one would explain."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism import beside, diagnosis
from solver.criticism.bench import Asked
from solver.criticism.beside import Beside, beyond, off, shown, suspects
from solver.criticism.marginal import Spectrum, mixture
from solver.criticism.policy import POLICY
from solver.fit.windowed import Windowed

KNOWN = built_in()
ASKED = Asked(list(KNOWN.values()), held_out=False, advance=lambda n: None)


def scored(name: str, evidence: float, left: float = 0.0) -> Any:
    """A score whose two directions have so much of chi2 left."""
    spectrum = Spectrum(np.ones(2), np.full(2, left / 2))
    return SimpleNamespace(effect=KNOWN[name], evidence=evidence, fall=left, tolerated=spectrum.tolerated, trials=1)


def fitted(name: str, evidence: float, fall: float = 0.0, *, pushed: bool = False) -> Any:
    return SimpleNamespace(effect=KNOWN[name], evidence=evidence, fall=fall or 2 * evidence, pushed=pushed)


def left_by(one: Any, *table: Any, seconds: tuple[Any, ...] = ()) -> Beside:
    bench: Any = SimpleNamespace(scorer=SimpleNamespace(variance=1.0 + off(one)))
    return Beside(one, bench, table, seconds)


def test_what_a_law_may_be_off_by_grows_with_its_signal():
    assert off(fitted("lowpass", 100.0, 20_000.0)) == pytest.approx(POLICY.tolerance**2 * 20_000)
    left = scored("generic_neighbors", 90.0, 200.0)
    strong, weak = (left_by(fitted("lowpass", 500.0, fall), left).tolerated for fall in (40_000.0, 100.0))
    assert strong > 80 > 20 > weak > 0


def test_a_law_is_off_in_the_way_of_one_discrepancy_model_or_not_at_all():
    one = fitted("lowpass", 5000.0, 10_000.0)
    models = [scored("generic_neighbors", 90.0, 100.0), scored("generic_road", 90.0, 40.0)]
    expected = mixture([0.0, *(model.tolerated(1.0, off(one)) for model in models)])
    assert left_by(one, *models).tolerated == pytest.approx(expected) and expected > 30
    assert left_by(one, scored("clock_drift", 90.0, 100.0)).tolerated == 0.0


def test_the_hope_of_a_refit_bounds_what_its_tolerance_adds():
    one = fitted("lowpass", 500.0, 3000.0)
    for left in (10.0, 100.0, 1000.0):
        for variance in (1.0, 4.0):
            spectrum = Spectrum(np.ones(1), np.array([left]))
            added = spectrum.tolerated(variance, off(one))
            assert added <= Beside.hope(one, one.fall + left, variance)


def test_a_second_effect_is_the_best_known_or_unknown_one_that_shows_beside_the_first():
    kin, second = scored("generic_neighbors", 40.0, 100.0), scored("clock_drift", 60.0)
    assert left_by(fitted("lowpass", 5000.0), kin, second).second == 60.0
    raced = left_by(fitted("lowpass", 5000.0), kin, second, seconds=(fitted("clock_drift", 90.0),))
    assert raced.second == 90.0
    assert left_by(fitted("lowpass", 5000.0), scored("generic_road", -3.0)).second == -3.0


def test_suspects_are_those_of_a_table_and_all_discrepancy_models():
    table = [scored("clock_offset", POLICY.found + 1), scored("camber", POLICY.found - 1)]
    assert [one.effect.name for one in shown(table)] == ["clock_offset"]
    asked = [KNOWN[name] for name in ("clock_offset", "camber", "lowpass", "generic_echo", "generic_gain")]
    names = [one.name for one in suspects(shown(table), asked)]
    assert names == ["clock_offset", "generic_echo", "generic_gain"]


def test_what_only_imitates_the_first_is_not_looked_at_again():
    """Of two signals that correlate with what is there, one holds something of its own."""
    rng = np.random.default_rng(1)
    first, own = rng.normal(size=(2, 400))
    residual = 5 * first + 3 * own
    signals = {
        "gauge_length": first,
        "pulse_width": 0.9 * first + 0.1 * rng.normal(size=400),
        "clock_drift": first + own,
    }

    def project(parts: Any) -> Any:
        columns = torch.zeros(400, 3, dtype=torch.float64)
        for part in parts[0].parts:
            columns[part.first : part.last, part.columns] = part.values.T
        score = columns.T @ torch.from_numpy(residual)
        return [SimpleNamespace(score=score, information=columns.T @ columns)]

    data = torch.zeros(40, 10)
    scorer: Any = SimpleNamespace(project=project, fit=SimpleNamespace(data=data), variance=20.0)
    scores: Any = [
        SimpleNamespace(effect=KNOWN[name], signal=Windowed.whole(torch.from_numpy(values)[None]))
        for name, values in signals.items()
    ]
    assert [one.effect.name for one in beyond(scorer, scores[0], scores)] == ["clock_drift"]


def test_what_did_not_show_before_is_asked_where_it_is_widened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clipping did not show beside vehicles that bounce much more strongly, and then seemed to be something unknown."""
    bounce, clips = KNOWN["dynamic_load"], KNOWN["saturation"]
    problem = SimpleNamespace(effects=[bounce], base_parts=set())
    bench: Any = SimpleNamespace(scorer=SimpleNamespace(fit=SimpleNamespace(problem=problem), variance=1.0))
    late = fitted("saturation", 440.0)
    monkeypatch.setattr(beside, "score_all", lambda scorer, effects, advance: [scored("saturation", 400.0)])
    monkeypatch.setattr(beside, "started_elsewhere", lambda scorer, effects: [(scorer, one) for one in effects])
    begun = []

    def race(scorer: Any, scores: Any, advance: Any, others: Any) -> dict[str, Any]:
        begun.extend(one.name for _, one in others)
        return {s.effect.name: late for s in scores}

    monkeypatch.setattr(beside, "race", race)
    monkeypatch.setattr(beside, "with_slow_errors", lambda scorer, tried: tried)
    before = Beside(fitted("dynamic_load", 1000.0), bench, [scored("generic_nonlinearity", 400.0)])
    asked = Asked([bounce, clips], held_out=False, advance=lambda n: None)
    wide = before.widened(asked)
    assert [one.effect.name for one in wide.seconds] == ["saturation"]
    assert wide.second == 440.0
    assert begun == ["saturation"], "from where it says itself, too, as it may not show beside what has followed it"


@pytest.mark.parametrize(
    ("fits", "looked"),
    [
        ([fitted("lowpass", 900.0), fitted("generic_echo", 2000.0)], []),  # hopeless
        ([fitted("lowpass", 1990.0), fitted("generic_echo", 2000.0)], ["lowpass"]),
        ([fitted("lowpass", 3.0)], []),  # nothing shows
        ([fitted("lowpass", 2000.0), fitted("clock_drift", 1500.0)], ["lowpass"]),
        ([fitted("lowpass", 2000.0), fitted("clock_drift", 1995.0)], ["lowpass", "clock_drift"]),
    ],
)
def test_only_what_could_be_best_is_looked_beside_of(monkeypatch, fits, looked):
    monkeypatch.setattr(Beside, "of", lambda bench, one, asked: left_by(one))
    bench: Any = SimpleNamespace(scorer=SimpleNamespace(variance=1.0))
    tried = {one.effect.name: one for one in fits}
    assert list(diagnosis.looked_beside(bench, tried, ASKED)) == looked


@pytest.mark.parametrize(("unknown", "widened"), [(0.5, ["layered_ground", "gibson_soil"]), (0.01, [])])
def test_beside_rivals_alike_more_is_fitted_where_the_unknown_is_not_ruled_out(monkeypatch, unknown, widened):
    """Tracks beside a layer were fitted in full, those beside stiffening soil only scored: 12700 of the pairs."""
    done = []

    def rival(name: str, both: float) -> Any:
        return SimpleNamespace(both=both, widened=lambda asked: done.append(name))

    besides = {"layered_ground": rival("layered_ground", 249.0), "gibson_soil": rival("gibson_soil", 252.0)}
    monkeypatch.setattr(diagnosis, "looked_beside", lambda *asked: besides | {"camber": rival("camber", 200.0)})
    monkeypatch.setattr(diagnosis, "Explainer", lambda *made: SimpleNamespace(all=lambda besides: []))
    posterior = SimpleNamespace(of_kind=lambda kind: unknown)
    monkeypatch.setattr(diagnosis, "Posterior", SimpleNamespace(of=lambda explanations: posterior))
    bench: Any = None
    found = diagnosis.weighed(bench, {}, ASKED)
    assert done == widened and list(found.besides) == ["layered_ground", "gibson_soil", "camber"]


def test_both_are_the_effect_with_its_inexact_law_and_a_second_one():
    one, left = fitted("lowpass", 500.0, 40_000.0), scored("generic_neighbors", 90.0, 200.0)
    beside_it = left_by(one, left)
    assert beside_it.both == pytest.approx(500.0 + beside_it.tolerated + 90.0)


@pytest.mark.parametrize(
    ("winner", "again", "lead"),
    [
        ("generic_train", ["gibson_soil", "long_vehicle"], 0.0),
        ("generic_delay", ["clock_offset"], 0.0),
        ("shear_lag", ["gibson_soil"], 2800.0),
        ("channel_coupling", ["poisson_gradient"], 2800.0),
        ("saturation", [], 2800.0),
    ],
)
def test_what_the_winner_may_stand_for_is_fitted_before_the_verdict(monkeypatch, winner, again, lead):
    """Five axles over 14 m showed a fifth of what a train did, and explain more: 1009 of the blind trials."""
    strengths = {winner: 2800.0, "pulse_width": 1900.0, "clock_offset": 1500.0}
    strengths |= {"gibson_soil": 980.0, "long_vehicle": 650.0, "road_bump": 2.0, "poisson_gradient": -1.0}
    table = [scored(name, size) for name, size in strengths.items()]
    tried: dict[str, Any] = {name: fitted(name, strengths[name]) for name in (winner, "pulse_width")}
    bench: Any = SimpleNamespace(table=table, scorer=None)
    monkeypatch.setattr(diagnosis, "race", lambda scorer, scores, advance, lead: {"asked": (scores, lead)})
    scores, least = diagnosis.stood_for(bench, tried, ASKED)["asked"]
    assert [one.effect.name for one in scores] == again and least == lead
    assert diagnosis.stood_for(bench, {}, ASKED) == {}
