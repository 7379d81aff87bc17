"""The benchmarks of a diagnosis's probabilities and of streets as built: what they draw, and what counts as right."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks import reliability
from benchmarks.as_built import TURN, corners_of, nearest, paired
from benchmarks.as_built import draw as draw_as_built
from benchmarks.judged_probabilities import binned, claims, judged, report
from benchmarks.reliability import AS_DRAWN, KINDS, draw
from benchmarks.route_limit import PRIOR, limit
from solver.simulator import EFFECTS, Scenario, simulate

ECHO = {"kind": "unknown", "effects": ["generic_echo"], "stage": "interrogator", "probability": 0.2}
GAUGE = {"kind": "effect", "effects": ["gauge_length"], "stage": "interrogator", "probability": 0.7}
HIDDEN = (("one", "gauge_length"), ("unknown", "unknown_echo"))
NOTHING = {"kind": "nothing", "effects": [], "stage": "", "probability": 0.1}


def test_every_kind_is_drawn_and_a_seed_is_a_survey():
    drawn = [draw(seed) for seed in range(120)]
    assert {kind for kind, _ in drawn} == set(KINDS)
    assert draw(7) == drawn[7]
    assert 10 < sum(scenario.laid == "winding" for _, scenario in drawn) < 30
    for kind, scenario in drawn:
        assert len(scenario.effects) == {"null": 0, "two": 2}.get(kind, 1)
        assert 4 <= scenario.passes <= 12 and 5 <= scenario.snr_db <= 25


def row(kind: str, hidden: str, verdict: str, *named: str, misfit: float = 500.0, **more: Any) -> dict[str, Any]:
    secret = {name: 1.0 for name in hidden.split()}
    facts = {"kind": kind, "hidden": secret, "verdict": verdict, "named": named, "misfit": misfit, "then": ()}
    return facts | {"stage": "interrogator"} | more


def told(row: Mapping[str, Any]) -> dict[str, float]:
    return {key: value for key, value in judged(row).items() if value == value}


def test_what_a_smaller_number_makes_stronger_is_as_drawn():
    for seed in range(400):
        for name, value in draw(seed)[1].effects.items():
            assert name not in AS_DRAWN or EFFECTS[name].plausible[0] <= abs(value) <= EFFECTS[name].plausible[1]


@pytest.mark.parametrize(
    ("kind", "hidden", "misfit", "right"),
    [
        ("one", "gauge_length", 500.0, [False, True, False]),
        ("one", "pulse_width", 500.0, [False, False, False]),
        ("one", "pulse_width", 3.0, [False, False, True]),
        ("null", "", 0.0, [False, False, True]),
        ("geometry", "camber", 5.0, [False, False, True]),
        ("unknown", "unknown_echo", 500.0, [True, False, False]),
    ],
)
def test_one_explanation_is_so_the_unknown_counted_as_one(kind, hidden, misfit, right):
    one = row(kind, hidden, "", misfit=misfit) | {"explanations": [GAUGE, ECHO | {"stage": "ground"}, ECHO, NOTHING]}
    assert claims(one) == [(0.4, right[0]), (0.7, right[1]), (0.1, right[2])]


OVERLOOKED = {"kind": "overlooked", "effects": [], "stage": "", "probability": 0.05}


@pytest.mark.parametrize(("misfit", "nothing"), [(5.0, [(0.1, True)]), (9.0, []), (24.0, []), (25.0, [(0.1, False)])])
def test_what_is_hidden_and_does_not_show_may_be_named_and_may_be_nothing(misfit, nothing):
    """From 3 to 5 sigma neither is counted: a survey shows it, or does not."""
    told = {"explanations": [GAUGE, ECHO, NOTHING, OVERLOOKED]}
    known, unknown = (row(kind, name, "", misfit=misfit) | told for kind, name in HIDDEN)
    shows = misfit >= 25
    assert claims(known) == [(0.2, False), *([(0.7, True)] if shows else []), *nothing]
    assert claims(unknown) == [*([(0.2, True)] if shows else []), (0.7, False), *nothing]


def test_what_is_named_is_judged():
    right = {"wrong": 0.0, "named": 1.0}
    assert told(row("one", "gauge_length", "missing-effect", "pulse_width", "gauge_length")) == right
    assert told(row("one", "viscoelastic_lag", "missing-effect", "maxwell_flow")) == right
    assert told(row("one", "gauge_length", "missing-effect", "pulse_width")) == {"wrong": 1.0, "named": 0.0}
    assert told(row("one", "gauge_length", "adequate")) == {"wrong": 0.0, "named": 0.0}
    assert told(row("one", "gauge_length", "adequate", misfit=50.0)) == {"wrong": 0.0}
    assert told(row("one", "gauge_length", "adequate", misfit=5.0)) == {"wrong": 0.0, "open": 1.0}
    assert told(row("null", "", "missing-effect", "pulse_width", misfit=0.0)) == {"claimed": 1.0}
    assert told(row("unknown", "unknown_echo", "unknown-effect")) == {"blamed": 0.0, "placed": 1.0}
    assert told(row("unknown", "unknown_echo", "unknown-effect", stage="load")) == {"blamed": 0.0, "placed": 0.0}
    assert told(row("unknown", "unknown_echo", "missing-effect", "lowpass")) == {"blamed": 1.0}


def test_of_two_the_second_must_be_named_once_the_first_is_in_the_model():
    two = row("two", "gauge_length clock_drift", "missing-effect", "gauge_length")
    assert told(two)["both"] == 0.0
    assert told(two | {"then": ["clock_drift"]})["both"] == 1.0
    assert told(two | {"then": ["lowpass"]})["both"] == 0.0


def test_bins_tell_how_often_what_was_said_was_so():
    sure = row("one", "gauge_length", "") | {"explanations": [GAUGE | {"probability": 0.9}]}
    wrong = sure | {"hidden": {"lowpass": 0.1}}
    table, error = binned([sure, sure, sure, wrong])
    assert table["count"].tolist() == [4]
    assert table["right"].tolist() == [0.75] and error == pytest.approx(0.15)


def test_a_report_has_a_line_for_each_kind_and_a_diagram(capsys, tmp_path):
    corridors = {f"{what} {which}": 0.9 for what in ("inside", "half") for which in ("plain", "considered")}
    one = row("one", "gauge_length", "missing-effect", "gauge_length") | corridors | {"cpu seconds": 3.0}
    other = row("unknown", "unknown_echo", "unknown-effect", "generic_echo") | corridors | {"cpu seconds": 5.0}
    rows = [one | {"explanations": [GAUGE, ECHO]}, other | {"explanations": [GAUGE, ECHO, NOTHING]}]
    report(rows, tmp_path / "diagram.png")
    said = capsys.readouterr().out
    assert said.startswith("2 surveys; expected calibration error 0.")
    shares = {line.split()[0]: line.split()[1:] for line in said.splitlines()}
    assert shares["placed"] == ["1.0", "1"] and shares["named"] == ["1.0", "1"] and shares["claimed"] == ["NaN", "0"]
    assert [line.split()[0] for line in said.splitlines()[-2:]] == ["one", "unknown"]
    assert (tmp_path / "diagram.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("hidden", "told"),
    [(("camber", "gauge_length"), (12, "gauge_length", "gauge_length")), (("camber", "cycle_skips"), None)],
)
def test_where_nothing_was_named_the_second_is_told_beside_what_explains_more(monkeypatch, hidden, told):
    """Of a fault of the survey, which is no effect to add, nothing is told."""
    misfit = {"camber": 1.5, "gauge_length": 1.2}

    def grow(fit: None, state: None, name: str, *more: Any) -> Any:
        return SimpleNamespace(name=name, result=lambda seconds: SimpleNamespace(chi2_per_dof=misfit[name]))

    def beside(scenario: Scenario, both: Any, samples: int, named: str, first: str) -> Any:
        assert both.name == named
        return samples, named, first

    monkeypatch.setattr("solver.criticism.growth.grow", grow)
    monkeypatch.setattr(reliability, "beside", beside)
    monkeypatch.setattr(reliability, "fitted", lambda run: (None, None))
    located: Any = SimpleNamespace(problem=SimpleNamespace(strain_rate=torch.zeros(3, 4)))
    found: Any = SimpleNamespace(verdict="inconclusive", candidates=())
    scenario = Scenario(effects=dict.fromkeys(hidden, 1.0))
    assert reliability.looked_again(scenario, located, found, []) == (told, [])


def test_a_fiber_is_known_best_where_it_crosses_the_road():
    """The limit of a crossing: nothing worse than its prior, anchors held, corners known better than straight parts."""
    survey = simulate(Scenario(seed=2, laid="crossing", passes=3, snr_db=15.0, noise="white", view=(0.0, 40.0)))
    channel, across, depth = limit(survey)
    corners = corners_of(survey, TURN)
    assert len(corners) == 2 and np.isfinite([across, depth]).all() and max(across.max(), depth.max()) < PRIOR
    anchors = np.searchsorted(channel, survey.anchors["channel"])
    assert across[anchors].max() < survey.scenario.anchor_sigma
    near = nearest(survey.route[channel][:, :2], corners) < 3.0
    assert np.median(across[near]) < np.median(across[~near]) / 2
    quieter = limit(replace(survey, noise_sd=survey.noise_sd / 10))
    assert (quieter[1] < across).all() and (quieter[2] < depth).all()


def test_one_corner_told_finds_one_corner():
    dent = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 1.0], [3.0, 0.0]])
    assert paired(dent, np.array([[1.2, 1.0]])) == pytest.approx([0.2]) and len(paired(dent, np.empty((0, 2)))) == 0


def test_streets_as_built_are_half_with_nothing_hidden_and_a_few_wind():
    drawn = [draw_as_built(seed) for seed in range(60)]
    assert 20 <= sum(not one.effects for one in drawn) <= 40 and 4 <= sum(one.laid == "winding" for one in drawn) <= 18
    assert all(2 <= draw_as_built(seed, vary=True).gauge_length <= 20 for seed in range(20))
