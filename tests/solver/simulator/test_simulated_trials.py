"""The blind trials of benchmarks/blind.py: what they draw."""

import ast
import importlib.util
import json
from pathlib import Path

import pytest

from solver.simulator import EFFECTS


@pytest.fixture(scope="module")
def blind():
    path = Path(__file__).parents[3] / "benchmarks" / "blind.py"
    spec = importlib.util.spec_from_file_location("blind", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_kind_is_drawn_and_a_seed_is_a_trial(blind):
    trials = [blind.draw_trial(seed) for seed in range(200)]
    kinds = [blind.kind_of(trial.name) for trial in trials]
    assert set(kinds) == set(blind.KINDS) and 30 < kinds.count("null") < 75
    assert blind.draw_trial(7) == trials[7]
    for trial, kind in zip(trials, kinds, strict=True):
        assert len(trial.effects) == {"null": 0, "two": 2}.get(kind, 1)
        assert trial.noise == "street" and trial.track_noise == "camera"
        for name, amount in trial.effects.items():
            low, high = EFFECTS[name].plausible
            assert low <= abs(amount) <= high and (amount > 0 or EFFECTS[name].signed)
    two = [trial for trial, kind in zip(trials, kinds, strict=True) if kind == "two"]
    assert all(len({EFFECTS[name].stage for name in trial.effects}) == 2 for trial in two)


def test_a_kind_can_be_asked_for_and_every_effect_has_one(blind):
    for kind, pool in (("one", blind.FAIR), ("unknown", blind.UNKNOWN), ("geometry", blind.GEOMETRY)):
        drawn = {name for seed in range(400) for name in blind.draw_trial(seed, kind).effects}
        assert drawn == set(pool)
    assert len(blind.UNKNOWN) >= 10 and {EFFECTS[name].stage for name in blind.UNKNOWN} == {
        "load", "ground", "cable", "interrogator", "processing", "trajectory"
    }  # fmt: skip


def verdict(name, *candidates):
    return {
        "verdict": name,
        "candidates": [
            {"effect": effect, "stage": stage, "confounded_with": list(others)} for effect, stage, *others in candidates
        ],
    }


@pytest.mark.parametrize(
    ("hidden", "diagnosis", "right", "wrong"),
    [
        ("none", verdict("adequate"), True, False),
        ("none", verdict("inconclusive"), False, False),
        ("none", verdict("missing-effect", ("shear_lag", "cable")), False, True),
        ("shear_lag", verdict("missing-effect", ("shear_lag", "cable")), True, False),
        ("shear_lag", verdict("missing-effect", ("pulse_width", "interrogator", "shear_lag")), True, False),
        ("shear_lag", verdict("missing-effect", ("highpass", "interrogator")), False, True),
        ("shear_lag", verdict("inconclusive", ("highpass", "interrogator")), False, False),
        ("viscoelastic_lag", verdict("missing-effect", ("maxwell_flow", "ground")), True, False),
        ("shear_lag highpass", verdict("missing-effect", ("highpass", "interrogator")), True, False),
        ("unknown_echo", verdict("unknown-effect", ("generic_echo", "interrogator")), True, False),
        ("unknown_echo", verdict("missing-effect", ("highpass", "interrogator")), False, True),
        ("camber", verdict("adequate"), True, False),
        ("camber", verdict("missing-effect", ("poisson_ratio", "ground", "camber")), True, False),
        ("camber", verdict("missing-effect", ("poisson_ratio", "ground")), False, True),
    ],
)
def test_a_diagnosis_is_judged_as_the_bars_have_it(blind, hidden, diagnosis, right, wrong):
    found = blind.judged({"hidden_effect": hidden}, diagnosis)
    assert (found["right"], found["wrong"]) == (right, wrong)


def test_written_trials_are_judged_by_their_diagnosis(blind, tmp_path):
    for number, (kind, said) in enumerate((("null", verdict("adequate")), ("unknown", verdict("adequate")))):
        run = tmp_path / f"trial-{number:04}" / "run"
        run.mkdir(parents=True)
        truth = {"scenario": f"{kind}-{number}", "hidden_effect": "none" if kind == "null" else "unknown_echo"}
        (run.parent / "truth.json").write_text(json.dumps(truth))
        (run / "diagnosis.json").write_text(json.dumps(said))
    (tmp_path / "trial-0002").mkdir()
    table = blind.judge_all(tmp_path)
    assert table["kind"].tolist() == ["null", "unknown"] and table["right"].tolist() == [True, False]


def test_the_generator_shares_nothing_with_the_signal_path():
    allowed = {"solver.simulator", "solver.survey.das.prodml"}
    package = Path(__file__).parents[3] / "solver" / "simulator"
    for file in package.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("solver"):
                assert any(node.module == name or node.module.startswith(f"{name}.") for name in allowed), file.name
            if isinstance(node, ast.Import):
                assert not any(name.name.split(".")[0] in ("solver", "torch") for name in node.names), file.name
