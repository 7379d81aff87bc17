"""The demo: what it writes, and that it runs the public commands on it and nothing else."""

import json

import pytest
from typer.testing import CliRunner

import roadfiber.command
from calib.control_points import read_control_points
from solver.simulator import read_scenario
from solver.survey.das import read_das
from vision.contract import InputError
from vision.video import open_video


@pytest.fixture
def brief(monkeypatch):
    """A demo of two fast vehicles and a short film."""
    import solver.simulator
    import vision.scene.film as film

    scenario = read_scenario("street-filmed", seed=2, passes=2, speeds=(70.0, 78.0), headway=(4.0, 4.0))
    monkeypatch.setattr(solver.simulator, "read_scenario", lambda name, seed: scenario)
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
            rows = [f"{k},{x},{y + 0.1},{z}" for k, (x, y, z) in enumerate(known["route_xyz"])]
            (out / "run").mkdir()
            (out / "run" / "route.csv").write_text("\n".join(["channel,x,y,z", *rows]))

    monkeypatch.setattr(roadfiber.command, "run_command", run_command)
    out = tmp_path / "demo"
    result = CliRunner().invoke(roadfiber.command.app, ["demo", "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0
    assert [command[0] for command in commands] == ["calibrate", "track", "locate"]
    assert (out / "calibration.json").is_file() and (out / "calibration.png").is_file()
    assert len(read_control_points(out / "control_points.csv")) > 20
    assert len(open_video(out / "street.mp4")) == 12
    assert read_das(sorted((out / "das").glob("*.h5"))).strain_rate.shape[1] == brief.channels
    assert "0.10 m on average, 0.10 m at most" in result.output and "report.html" in result.output
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
