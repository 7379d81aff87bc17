"""`roadfiber effects`."""

import json
import subprocess
import sys

import pytest
from test_plugins import example
from typer.testing import CliRunner

import roadfiber.command
from solver.catalogue.catalogue import FAULTS, built_in
from solver.effect import STAGES
from vision.contract import InputError


def effects(*words: object, columns: int = 100) -> str:
    result = CliRunner().invoke(
        roadfiber.command.app, ["effects", *map(str, words)], env={"COLUMNS": str(columns)}, catch_exceptions=False
    )
    assert result.exit_code == 0
    return result.stdout


def test_all_effects_are_listed_by_stage():
    text = effects()
    assert max(map(len, text.splitlines())) <= 100
    for name in [*built_in(), *FAULTS]:
        assert f"│ {name} " in text
    places = [text.index(f"\n{stage} ") if stage != "trajectory" else 0 for stage in STAGES]
    assert places == sorted(places)
    assert text.count("(generic)") == sum(one.generic for one in built_in().values())
    assert text.count("(fault)") == len(FAULTS)
    assert "offset: plausible 0.2 s, null 0, -5 to 5" in text
    assert "family blur" in text and "one per pass" in text and "smooth along the fiber" in text


def test_a_narrow_terminal_is_filled_not_overrun():
    assert max(map(len, effects(columns=70).splitlines())) <= 70


def test_machines_read_all_of_it():
    rows = json.loads(effects("--json"))
    assert {row["name"] for row in rows} == set(built_in()) | set(FAULTS)
    by_name = {row["name"]: row for row in rows}
    lag = by_name["viscoelastic_lag"]
    assert (lag["stage"], lag["kind"]) == ("ground", "physical")
    assert lag["families"] == {"even": ["grade_drag", "maxwell_flow", "highpass"]}
    creep, time = lag["parameters"]
    assert creep == {
        "name": "creep", "unit": "1", "plausible": 0.2, "null": 0.0, "lower": 0, "upper": 3, "scope": "one", "grid": [],
    }  # fmt: skip
    assert time["null"] is None and time["grid"][0] == 0.05
    assert by_name["track_bend"]["parameters"][0]["upper"] is None
    assert by_name["cycle_skips"]["kind"] == "fault" and by_name["generic_load"]["kind"] == "generic"


def test_one_effect_is_shown_in_detail():
    text = effects("viscoelastic_lag")
    assert "tried: 0.05, 0.1," in text and "Compliance 1 + creep / (1 + s time)" in text
    assert "highpass: The interrogator is AC-coupled" in text
    assert json.loads(effects("gauge_length", "--json"))["parameters"][0]["name"] == "relative"


def test_a_plugin_is_listed_too(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(example())
    assert "share: plausible 0.05, null 0, -0.5 to 0.5" in effects("downforce", "--plugin", path)


def test_an_unknown_name_is_answered_with_similar_ones():
    with pytest.raises(InputError, match="effect cycle_skip: not known; did you mean cycle_skips"):
        effects("cycle_skip")


def test_help_needs_no_heavy_import():
    code = "import sys, roadfiber; print([name for name in ('torch', 'scipy', 'pandas') if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
