"""`roadfiber ingest` and `roadfiber view`, and that `locate` uses the store."""

import json
import logging
import shutil

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import roadfiber as rf
from roadfiber.command import app
from solver.simulator import read_scenario, simulate
from solver.simulator.survey_files import write_survey


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """A street whose site.toml says nothing of vehicles."""
    folder = tmp_path_factory.mktemp("ingest") / "street"
    write_survey(simulate(read_scenario("street", seed=1, passes=2, laid="winding")), folder)
    return folder


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_store_is_made_used_and_renewed(survey, caplog):
    raw = rf.read(survey).record
    told = run("ingest", survey, "--json")
    assert told.exit_code == 0, told.output
    said = json.loads(told.stdout)
    assert said["store"] == str(survey / "das-store")
    assert (said["channels"], said["dead"], said["gaps"]) == ([0, 240], 0, 0)
    record = rf.read(survey).record
    assert record.provenance["store"] == "das-store"
    assert record.strain_rate.dtype == np.float32
    assert np.allclose(record.strain_rate, raw.strain_rate[: len(record.time)], rtol=0, atol=1e-13)
    assert record.provenance["sha256"] == raw.provenance["sha256"]
    assert record.provenance["files"] == raw.provenance["files"]
    words = run("ingest", survey).output
    assert "channels 0 to 240 at 5 Hz" in words and "no gap; noise" in words
    assert "5 Hz (Raw OutputDataRate 5 Hz, PartStartTime to PartEndTime 5 Hz, RawDataTime 5 Hz)" in words
    assert "  start     2025-08-11T06:" in words.partition("trajectories.csv states, and taken is:")[2]
    assert record.statements == raw.statements
    site = survey / "site.toml"
    text = site.read_text()
    site.write_text(text.replace("[das]", "[das]\nexclude = [3]"))
    with caplog.at_level(logging.WARNING):
        assert "store" not in rf.read(survey).record.provenance
    assert "[das] of site.toml changed since it was made" in caplog.text
    site.write_text(text)


def test_a_waterfall_needs_no_trajectories(survey, tmp_path):
    shutil.copytree(survey / "das", tmp_path / "das")
    text = (survey / "site.toml").read_text()
    (tmp_path / "site.toml").write_text(text.replace("[trajectories]\nfiles", "#").replace("[anchors]\nfile", "#"))
    told = run(
        "view",
        tmp_path,
        "--from",
        "20",
        "--to",
        "2025-08-11T06:00:50Z",
        "--channels",
        "30-90",
        "--out",
        tmp_path / "a.png",
    )
    assert told.exit_code == 0, told.output
    assert "gauge length      10 m (Acquisition GaugeLength 10 m" in told.output
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    figure = rf.view(tmp_path, 20, 50.0, (30, 90))
    waterfall, noise = [axes for axes in figure.axes if axes.get_label() in ("record", "noise")]
    left, right, low, high = waterfall.images[0].get_extent()
    assert (left, low, high) == (0, 29.5, 90.5)
    assert right == pytest.approx(30.2, abs=0.3)
    assert noise.lines[0].get_ydata().tolist() == list(range(30, 91))
    assert "trajectories" not in told.output
    (tmp_path / "tracks.csv").write_text("no tracks")
    (tmp_path / "site.toml").write_text(text.replace("trajectories.csv", "tracks.csv").replace("[anchors]\nfile", "#"))
    assert "no column time" in " ".join(run("view", tmp_path, "--out", tmp_path / "a.png").output.split())
    with h5py.File(next((tmp_path / "das").glob("*.h5")), "a") as file:
        file["Acquisition/Raw[0]/RawData"][100:160] = 0
    for last, told_so in ((40, True), (10, False)):
        words = run("view", tmp_path, "--to", last, "--out", tmp_path / "a.png").output
        assert ("not measured" in words) == ("in 60 samples (12.0 s) all channels hold" in words) == told_so
    # Of a store, or one file, likewise.
    assert rf.view(next((survey / "das").glob("*.h5")), 0, 5).axes
    done = rf.ingest(tmp_path, tmp_path / "kept", rate=4.0)
    assert done.sampling_rate == 5.0 and done.record(channels=(5, 9)).channel.tolist() == [5, 6, 7, 8, 9]
    assert rf.view(tmp_path / "kept").axes


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--from", "noon"], "time 'noon'; give UTC as 2025-08-11T06:00:10Z, or seconds since the start"),
        (["--from", "9000"], "nothing from 2025-08-11T08:30:00"),
        (["--channels", "90"], "--channels 90: give the first and the last, as 100-250"),
        (["--channels", "90-9000"], "no channels 90 to 9000; the record has 0 to 240"),
        (["--out", "a.txt"], "give a name that ends in .png, .svg or .pdf"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(survey, words, says):
    told = run("view", survey, *words)
    assert told.exit_code != 0
    assert says in str(told.exception) and "\n" not in str(told.exception)
