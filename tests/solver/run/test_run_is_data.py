"""A run folder is data: whatever lies in it, no command runs it, and users' effects come from where the user says."""

import json
import pickle
import py_compile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from roadfiber.command import app
from solver.catalogue.plugins import catalogue
from solver.run.code import with_plugins
from solver.run.folder import read_run, write_run
from solver.run.run import Run, run_of
from vision.contract import InputError

GRIP = """
from dataclasses import replace
from solver.effect import Parameter, effect

@effect("grip", "cable", [Parameter("share", "1", 0.1)], physics="Mine.", source="Mine.")
def mine(cable, p, survey):
    return replace(cable, gain=cable.gain * (1 + p["share"]))
"""
#: Commands that read a run, and whether they evaluate its model.
COMMANDS = {
    "compare": (("compare", "{run}", "--out", "{out}"), False),
    "ladder": (("ladder", "{run}"), False),
    "diagnose": (("diagnose", "{run}"), True),
    "clock": (("clock", "{run}"), True),
    "add": (("add", "{run}", "camber", "--out", "{out}"), True),
    "explain": (("explain", "{run}", "--out", "{out}"), True),
}


def command(name: str, run: Path, *more: object) -> str:
    """What a command prints, or the one line with which it refuses."""
    words = [word.format(run=run, out=run.parent / "out") for word in COMMANDS[name][0]]
    try:
        return (
            CliRunner()
            .invoke(app, ["-q", *words, *map(str, more)], catch_exceptions=False, standalone_mode=False)
            .output
        )
    except InputError as error:
        assert "\n" not in str(error)
        return f"refused: {error}"


@pytest.fixture(scope="module")
def mine(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("plugin") / "mine.py"
    path.write_text(GRIP)
    return path


@pytest.fixture(scope="module")
def grip(mine):
    return catalogue([mine])


@pytest.fixture
def held(survey, grip, tmp_path, monkeypatch) -> Path:
    """Run folder of a model with a user's effect; drawing is left to other tests."""
    monkeypatch.setattr("solver.run.report.report_page.render", lambda run: "<!doctype html>")
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    run = read_run(tmp_path / "run")
    problem = replace(run.problem, effects=(grip["grip"],))
    facts = run.facts | {"problem": run.facts["problem"] | {"added": ["grip"]}}
    write_run(tmp_path / "run", with_plugins(replace(run, problem=problem, facts=facts, known=grip)))
    return tmp_path / "run"


def traps(folder: Path, marker: Path) -> None:
    """Everything that a careless reader might run; each would make `marker`."""
    code = f"import pathlib; pathlib.Path({str(marker)!r}).touch()\n{GRIP}"
    for name in ("plugin-0.py", "mine.py", "__init__.py", "conftest.py", "sitecustomize.py", "effects.py", "data.py"):
        (folder / name).write_text(code)
    py_compile.compile(str(folder / "plugin-0.py"), str(folder / "plugin-1.pyc"))
    py_compile.compile(str(folder / "mine.py"))

    class Bomb:
        def __reduce__(self):
            return Path.touch, (marker,)

    for name in ("fit.pkl", "plugin-0.pkl", "data.npy", "detections.pickle"):
        (folder / name).write_bytes(pickle.dumps(Bomb()))
    with np.load(folder / "data.npz") as file:
        arrays = {name: file[name] for name in file.files}
    np.savez(folder / "data.npz", **arrays, bomb=np.array([Bomb()], dtype=object))
    facts = json.loads((folder / "fit.json").read_text())
    facts["plugins"] = [one | {"text": code} for one in facts["plugins"]]
    (folder / "fit.json").write_text(json.dumps(facts))


@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_runs_what_lies_in_a_run_folder(held, tmp_path, monkeypatch, name):
    marker = tmp_path / "marker"
    traps(held, marker)
    monkeypatch.chdir(held)
    said = command(name, held)
    assert not marker.exists(), said
    exec((held / "plugin-0.py").read_text(), {})  # the trap itself works
    assert marker.exists()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_evaluates_the_model_asks_for_its_code_in_a_line(held, grip, name):
    said = command(name, held)
    plugin = grip.plugin_of["grip"]
    wanted = f"refused: this run was made with mine.py (sha256 {plugin.sha256}): give it with --plugin mine.py"
    assert (said == wanted) == COMMANDS[name][1], said
    assert said.startswith("refused") == COMMANDS[name][1]
    assert (held.parent / "out").exists() == (name == "compare")


def test_a_run_keeps_its_plugin_as_text(held, mine, grip):
    facts = json.loads((held / "fit.json").read_text())
    plugin = grip.plugin_of["grip"]
    assert facts["plugins"] == [{"file": "mine.py", "sha256": plugin.sha256, "effects": ["grip"], "text": GRIP}]
    assert {path.name for path in held.iterdir()} == {
        *("route.csv", "route.geojson", "fit.json", "report.html", "index.html", "data.npz")
    }


def test_the_model_is_there_where_its_effects_are_given(held, mine, grip):
    """From a file, or as objects."""
    for run in (read_run(held, plugins=[mine]), read_run(held, effects=[grip["grip"]])):
        assert [one.name for one in run.problem.effects] == ["grip"]
        assert run.problem.extension(run.problem.effects).size == 1
    without: Run = read_run(held)
    assert without.result.chi2 == run.result.chi2
    with pytest.raises(InputError, match=r"made with mine\.py"):
        without.problem.extension(without.problem.effects)


@pytest.mark.parametrize("name", [name for name, (_, evaluates) in COMMANDS.items() if evaluates])
def test_another_file_is_refused_unless_told(held, tmp_path, grip, name):
    other = tmp_path / "renamed.py"
    other.write_text(GRIP.replace("1 + p", "1 + 2 * p"))
    said = command(name, held, "--plugin", other)
    assert "renamed.py: has sha256 " in said and f"mine.py (sha256 {grip.plugin_of['grip'].sha256})" in said
    assert said.endswith("say --plugin-changed to go on with yours")
    # The made-up run has other numbers than its model: evaluation begins, and ends there.
    assert "fitted numbers" in command(name, held, "--plugin", other, "--plugin-changed")


def test_the_same_file_under_another_name_and_folder_will_do(held, tmp_path, mine):
    copy = tmp_path / "copy.py"
    copy.write_bytes(mine.read_bytes())
    assert "fitted numbers" in command("diagnose", held, "--plugin", copy)


def test_an_effect_given_in_python_is_asked_for_by_name(held):
    facts = json.loads((held / "fit.json").read_text())
    (held / "fit.json").write_text(json.dumps(facts | {"plugins": []}))
    assert "made with the effect grip, which is not installed" in command("diagnose", held)
