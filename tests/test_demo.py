"""The demo: what it writes, and that it runs the public commands on it and nothing else."""

import json

import pytest
from typer.testing import CliRunner

import roadfiber.command
import roadfiber.simulating  # before anything that it imports is replaced
from calib.control_points import read_control_points
from roadfiber.hidden_demo import hidden, told
from solver.run.ladder_file import write_ladder
from solver.run.rung import Rung
from solver.simulator import read_scenario
from solver.simulator.effects import SHOWN
from solver.survey.das import read_das
from tests.offline_pages import is_whole
from vision.contract import InputError
from vision.video import open_video

NAME = ("gauge_length",)

#: Columns of route.csv that a comparison with the truth reads.
COLUMNS = "channel,x,y,z,sigma_x,sigma_y,sigma_z,constrained"


@pytest.fixture
def brief(monkeypatch):
    """A demo of two fast vehicles and a short film."""
    import solver.simulator
    import vision.scene.film as film

    scenario = read_scenario("street-filmed", seed=2, passes=2, speeds=(70.0, 78.0), headway=(4.0, 4.0))
    monkeypatch.setattr(solver.simulator, "read_scenario", lambda name, seed, laid: scenario)
    whole = film.film
    monkeypatch.setattr(film, "film", lambda scene, folder, duration, seed: whole(scene, folder, 1.0, seed))
    return scenario


def test_the_demo_writes_a_survey_and_runs_the_commands_on_it(brief, tmp_path, monkeypatch):
    commands = []

    def run_command(*words):
        commands.append([str(word) for word in words])
        if words[0] == "calibrate":
            roadfiber.command.app([str(word) for word in words], standalone_mode=False)
        if words[0] == "locate":
            known = json.loads((out / "truth.json").read_text())
            rows = [f"{k},{x},{y + 0.1},{z},1,1,1,true" for k, (x, y, z) in enumerate(known["route_xyz"])]
            (out / "run").mkdir()
            (out / "run" / "route.csv").write_text("\n".join([COLUMNS, *rows]))

    monkeypatch.setattr(roadfiber.command, "run_command", run_command)
    out = tmp_path / "demo"
    result = CliRunner().invoke(roadfiber.command.app, ["demo", "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0
    assert [command[0] for command in commands] == ["calibrate", "track", "locate"]
    assert (out / "calibration.json").is_file() and (out / "calibration.png").is_file()
    assert len(read_control_points(out / "control_points.csv")) > 20
    assert len(open_video(out / "street.mp4")) == 12
    channels = len(json.loads((out / "truth.json").read_text())["route_xyz"])
    assert read_das(sorted((out / "das").glob("*.h5"))).strain_rate.shape[1] == channels <= brief.channels
    assert "0.10 m on average over" in result.output and "report.html" in result.output
    assert f"{channels} of {channels} lie in the 95 % corridor" in result.output
    # The same again for a machine.
    monkeypatch.setattr(roadfiber.command, "run_command", lambda *words: print("a command speaks"))
    monkeypatch.setattr(roadfiber.command, "write_demo", lambda out, scenario: None)
    result = CliRunner().invoke(roadfiber.command.app, ["demo", "--out", str(out), "--json"], catch_exceptions=False)
    told = json.loads(result.stdout)
    assert told["error"]["mean"] == pytest.approx(0.1) and told["error"]["channels"] > 10
    assert told["report"] == str(out / "run" / "report.html") and "a command speaks" in result.stderr


def test_a_command_is_shown_and_run(tmp_path, capsys):
    with pytest.raises(InputError, match="no such file"):
        roadfiber.command.run_command("track", tmp_path / "my film.mp4", "--detector", tmp_path / "none.onnx")
    assert "$ roadfiber track '" in capsys.readouterr().out


def test_the_demo_leaves_other_folders_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    result = CliRunner().invoke(roadfiber.command.app, ["demo", "--out", str(tmp_path)])
    assert isinstance(result.exception, InputError) and "no simulated survey" in str(result.exception)
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_what_is_hidden_is_given_or_drawn_by_the_seed() -> None:
    assert hidden("gauge_length=-0.1", 4) == {"gauge_length": -0.1}
    assert hidden("pulse_width", 4) == hidden("pulse_width", 4) != hidden("pulse_width", 5)
    chosen = {name for seed in range(20) for name in hidden("any", seed)}
    assert chosen == set(SHOWN)
    for wrong, mend in (("nosuch", "no such effect; give one of"), ("gauge_length=x", "must be NAME or NAME=NUMBER")):
        with pytest.raises(InputError, match=mend):
            hidden(wrong, 4)


@pytest.mark.parametrize("refused", [False, True])
def test_a_hidden_effect_is_told_as_a_story_that_ends_with_the_envelope(tmp_path, monkeypatch, refused) -> None:
    """The commands' files are given; the story is of them alone."""
    out, commands = tmp_path / "demo", []

    def write_demo(out, scenario):
        out.mkdir()
        route = [[float(k), 4.0, 1.0] for k in range(60)]
        facts = {"switches": dict(scenario.effects), "active_channels": [10, 50], "route_xyz": route}
        (out / "truth.json").write_text(json.dumps(facts))

    monkeypatch.setattr(roadfiber.command, "write_demo", write_demo)

    def run_command(*words):
        commands.append(words[0])
        folder = out / ("run-2" if words[0] == "add" else "run")
        if words[0] == "add" and refused:
            raise InputError("gauge_length: held-out <passes> fit no better")
        if words[0] in ("locate", "add"):
            folder.mkdir()
            known = json.loads((out / "truth.json").read_text())
            off = 0.5 if words[0] == "locate" else 0.05
            rows = [f"{k},{x},{y + off},{z},.1,.1,.1,true" for k, (x, y, z) in enumerate(known["route_xyz"])]
            (folder / "route.csv").write_text("\n".join([COLUMNS, *rows]))
            trust = {"grade": "poor", "sentence": "Do not rely: `roadfiber diagnose RUN`."}
            (folder / "fit.json").write_text(json.dumps({"name": "s", "headline": "It runs <here>.", "trust": trust}))
        if words[0] == "compare":
            (folder / "compare.json").write_text(json.dumps({"verdict": "They differ."}))
        if words[0] == "diagnose":
            first = {"effect": "gauge_length", "route_change": 0.45}
            facts = {"verdict": "missing-effect", "headline": "Gauge length.", "candidates": [first]}
            (folder / "diagnosis.json").write_text(json.dumps(facts))
        if words[0] == "add":
            route = ((7.0, 0.0, 4.0, 1.0), (8.0, 1.0, 4.0, 1.0))
            rungs = [Rung(names, chi2, None, 1.0, 0.0, 0.0, None, route) for names, chi2 in (((), 2.0), (NAME, 1.0))]
            write_ladder(folder, rungs, "s")

    monkeypatch.setattr(roadfiber.command, "run_command", run_command)
    words = ["demo", "--hide", "gauge_length=0.2", "--out", str(out)]
    result = CliRunner().invoke(roadfiber.command.app, words, catch_exceptions=False)
    page = (out / "index.html").read_text(encoding="utf-8")
    assert commands[3:] == ["compare", "diagnose", "add", *([] if refused else ["ladder"])]
    assert "hidden was: gauge length (gauge_length = 0.2)" in result.output and "0.50 m on average" in result.output
    assert "It runs &lt;here&gt;." in page and "<code>roadfiber diagnose run</code>" in page
    assert is_whole(page)
    before, envelope = page.split("<summary>Open it</summary>")
    assert "gauge_length = 0.2" in envelope and "gauge_length = 0.2" not in before and "<td>0.50</td>" in envelope
    if refused:
        assert "held-out &lt;passes&gt; fit no better" in page and "run-2" not in page
    else:
        assert (
            'href="run-2/ladder.html"' in page and "<td>0.05</td>" in envelope and "0.05 m on average" in result.output
        )
        told_out = told(out, "")
        assert told_out["hidden"] == {"gauge_length": 0.2} and told_out["named"] == "gauge_length"
        assert [round(one["mean"], 2) for one in told_out["errors"].values()] == [0.5, 0.05]
        assert [one["inside"] for one in told_out["errors"].values()] == [0, 60]
        assert "The true error fell: 0.50 m on average before, 0.05 m after." in envelope
        put_in = before.partition("5. It was put in")[2]
        assert "and the misfit fell" in put_in and "Do not rely" in put_in
