"""The blind trials of benchmarks/blind.py: what they draw."""

import importlib.util
from pathlib import Path

import pytest

from solver.simulator import EFFECTS


@pytest.fixture(scope="module")
def blind():
    path = Path(__file__).parents[2] / "benchmarks" / "blind.py"
    spec = importlib.util.spec_from_file_location("blind", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_kind_is_drawn_and_a_seed_is_a_trial(blind):
    trials = [blind.draw_trial(seed) for seed in range(200)]
    kinds = [blind.kind_of(trial) for trial in trials]
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
