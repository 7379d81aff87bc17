"""The benchmark of a diagnosis's probabilities: what it draws, and what it counts as right."""

import pytest

from benchmarks.reliability import KINDS, binned, claims, draw, judged, report

ECHO = {"kind": "unknown", "effects": ["generic_echo"], "stage": "interrogator", "probability": 0.2}
GAUGE = {"kind": "effect", "effects": ["gauge_length"], "stage": "interrogator", "probability": 0.7}
NOTHING = {"kind": "nothing", "effects": [], "stage": "", "probability": 0.1}


def test_every_kind_is_drawn_and_a_seed_is_a_survey():
    drawn = [draw(seed) for seed in range(120)]
    assert {kind for kind, _ in drawn} == set(KINDS)
    assert draw(7) == drawn[7]
    for kind, scenario in drawn:
        assert len(scenario.effects) == {"null": 0, "two": 2}.get(kind, 1)
        assert 4 <= scenario.passes <= 8 and 5 <= scenario.snr_db <= 25


@pytest.mark.parametrize(
    ("kind", "hidden", "right"),
    [
        ("one", ["gauge_length"], [False, True, False]),
        ("one", ["pulse_width"], [False, False, False]),
        ("null", [], [False, False, True]),
        ("geometry", ["camber"], [False, False, True]),
        ("unknown", ["unknown_echo"], [True, False, False]),
    ],
)
def test_one_explanation_is_right_the_unknown_counted_as_one(kind, hidden, right):
    told = claims(kind, hidden, [GAUGE, ECHO | {"stage": "ground"}, ECHO, NOTHING])
    assert told == [(0.4, right[0]), (0.7, right[1]), (0.1, right[2])]


def row(kind: str, hidden: str, verdict: str, *named: str, stage: str = "interrogator") -> dict:
    return {"kind": kind, "hidden": {hidden: 1.0} if hidden else {}, "verdict": verdict, "named": named, "stage": stage}


def test_what_is_named_is_judged():
    assert judged(row("one", "gauge_length", "missing-effect", "pulse_width", "gauge_length"))["right"] == 1.0
    assert judged(row("one", "viscoelastic_lag", "missing-effect", "maxwell_flow")) == {"right": 1.0, "wrong": 0.0}
    assert judged(row("one", "gauge_length", "missing-effect", "pulse_width")) == {"right": 0.0, "wrong": 1.0}
    assert judged(row("one", "gauge_length", "adequate", "gauge_length")) == {"right": 0.0, "wrong": 0.0}
    assert judged(row("null", "", "missing-effect", "pulse_width"))["wrong"] == 1.0
    assert judged(row("null", "", "adequate", "pulse_width"))["right"] == 1.0
    found = judged(row("unknown", "unknown_echo", "unknown-effect", "generic_echo"))
    assert (found["right"], found["placed"]) == (1.0, 1.0)


def test_bins_tell_how_often_what_was_said_was_so():
    sure = {"kind": "one", "hidden": {"gauge_length": 0.1}, "explanations": [GAUGE | {"probability": 0.9}]}
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
    assert "stage right where the unknown is called so: 1.00" in said
    assert [line.split()[0] for line in said.splitlines()[-3:-1]] == ["one", "unknown"]
    assert (tmp_path / "diagram.png").stat().st_size > 1000
