"""A simulated drive is located: clock, polarity, loops, channels; and its run folder is data."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import dascore
import numpy as np
import pandas as pd
import pytest
from jsonschema import Draft202012Validator

import roadfiber as rf
from roadfiber.command import app
from solver.drive.drive_figures import channel_figure, plan_figure
from solver.drive.drive_folder import EXPECTED
from solver.drive.drive_page import drive_page
from solver.survey.anchors import Anchor
from tests.offline_pages import EVIL, is_whole, tells


def along_error(run: rf.DriveRun, truth: dict[str, Any]) -> np.ndarray:
    """Error [channel] along the true path, m; that of channels in loops is their distance from the manhole."""
    real = np.array(truth["route_xyz"])[:, :2]
    tangent = np.gradient(real, axis=0)
    size = np.linalg.norm(tangent, axis=1, keepdims=True)
    off = run.route[["x", "y"]].to_numpy() - real
    along = (off * tangent / np.maximum(size, 1e-9)).sum(1)
    return np.where(size[:, 0] > 1e-6, along, np.linalg.norm(off, axis=1))


def test_channels_lie_where_they_are(run: rf.DriveRun, truth: dict[str, Any]) -> None:
    straight = run.arrays["heard"] & ~np.array(truth["in_loop"])
    error = along_error(run, truth)[straight]
    assert straight.mean() > 0.4
    assert np.sqrt((error**2).mean()) < 2.0
    assert (np.abs(error) < 1.96 * run.arrays["sigma_along"][straight]).mean() > 0.8


def test_clock_and_polarity(run: rf.DriveRun, truth: dict[str, Any]) -> None:
    assert run.clock_offset == pytest.approx(truth["clock_offset"], abs=0.15)
    assert run.facts["parameters"]["polarity"]["value"] == truth["polarity"]


def test_loops_are_found_and_no_others(run: rf.DriveRun, truth: dict[str, Any]) -> None:
    assert len(truth["loops"]) > 0
    found = run.loops
    assert len(found) == len(truth["loops"])
    for one, real in zip(found.to_dict("records"), truth["loops"], strict=True):
        assert one["first_channel"] == pytest.approx(real["first_channel"], abs=2.5)
        assert one["last_channel"] == pytest.approx(real["last_channel"], abs=2.5)
        assert one["length"] == pytest.approx(real["length"], abs=8.0)
        assert np.hypot(one["x"] - real["place"][0], one["y"] - real["place"][1]) < 20


def test_fixes_that_are_left_out_are_told(run: rf.DriveRun) -> None:
    assert run.warnings[0] == "gps.csv: no position: receivers without a fix write 0, 0"


def test_what_files_state_is_the_table_of_every_run(run: rf.DriveRun) -> None:
    *das, gps = run.facts["statements"]
    read = [Path(one["path"]).name for one in run.facts["inputs"] if one["role"] == "das"]
    assert [one["file"] for one in das] == read and gps["file"] == "gps.csv"
    assert {"start", "end", "rate"} <= {row["what"] for row in das[0]["rows"]}
    page = drive_page(run)
    assert "<caption>gps.csv</caption>" in page and f"<caption>{read[0]}</caption>" in page


def test_route_as_of_every_run_and_more(run: rf.DriveRun, site: Path) -> None:
    table = run.route
    assert list(table)[:11] == [
        *("channel", "distance", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "latitude", "longitude", "constrained")
    ]
    assert {"loop", "along", "sigma_along", "heard"} <= set(table)
    assert not table["constrained"].iloc[0]  # the lead
    assert table["loop"].sum() == sum(run.loops["last_channel"] - run.loops["first_channel"] + 1)


def test_folder_is_read_back(run: rf.DriveRun, tmp_path: Path) -> None:
    run.save(tmp_path / "run")
    again = rf.open(tmp_path / "run")
    pd.testing.assert_frame_equal(again.route, run.route)
    assert again.facts == run.facts
    written = json.loads((tmp_path / "run" / "fit.json").read_text())
    Draft202012Validator(rf.schema("drive-fit.json")).validate(written)
    features = json.loads((tmp_path / "run" / "route.geojson").read_text())["features"]
    kinds = [one["properties"]["what"] for one in features]
    assert kinds[0] == "fiber route"
    assert kinds.count("loop of slack") == len(run.loops)
    assert "95 % corridor" in kinds
    page = (tmp_path / "run" / "report.html").read_text()
    assert page.count("<svg") == 4 and "Depth is told on" in page
    assert "diagnose" not in (tmp_path / "run" / "index.html").read_text()
    again.save(tmp_path / "run")  # over itself
    csv = pd.read_csv(tmp_path / "run" / "route.csv")
    assert csv["loop"].dtype == bool


def test_on_its_pages_names_are_text(run: rf.DriveRun, tmp_path: Path) -> None:
    trust = run.facts["trust"] | {"sentence": EVIL}
    named = replace(run, facts=run.facts | {"name": EVIL, "headline": EVIL, "warnings": [EVIL], "trust": trust})
    named.save(tmp_path / "run")
    for name in ("report.html", "index.html"):
        text = (tmp_path / "run" / name).read_text()
        assert tells(text) and is_whole(text), name


def test_damaged_folder_is_one_line(run: rf.DriveRun, tmp_path: Path) -> None:
    run.save(tmp_path / "run")
    arrays = dict(np.load(tmp_path / "run" / "data.npz"))
    assert set(arrays) == set(EXPECTED)
    np.savez_compressed(tmp_path / "run" / "data.npz", **arrays | {"along": arrays["along"][:-1]})
    with pytest.raises(rf.InputError, match=r"data.npz: not the arrays of this run: .* has \d+ along an axis"):
        rf.open(tmp_path / "run")


def test_other_commands_refuse_a_drive(run: rf.DriveRun, tmp_path: Path) -> None:
    run.save(tmp_path / "run")
    with pytest.raises(rf.InputError, match="the run of a drive"):
        app(["compare", str(tmp_path / "run")], standalone_mode=False)


def test_patch_gets_coordinates(run: rf.DriveRun) -> None:
    distance = run.placed.distance[5:25]
    time = np.datetime64("2025-08-11T06:00:00", "ns") + np.arange(4) * np.timedelta64(1, "s")
    patch = dascore.Patch(np.zeros((4, 20)), coords={"time": time, "distance": distance}, dims=("time", "distance"))
    known = run.route[5:25]
    expected = np.where(known["constrained"], known["latitude"], np.nan)
    assert np.array_equal(run.to_patch(patch).get_array("latitude"), expected, equal_nan=True)


def test_map_of_the_other_end(drive: rf.Drive, run: rf.DriveRun) -> None:
    elsewhere = Anchor("far", 9999, 0.0, 0.0, 1.0, 0.1, 0.1)
    turned = rf.locate(replace(drive, vertices=drive.vertices[::-1].copy(), anchors=[elsewhere]))
    assert any("anchor far is on channel 9999, which is not in the record" in line for line in turned.warnings)
    assert turned.facts["map_reversed"] != run.facts["map_reversed"]
    both = run.arrays["heard"] & turned.arrays["heard"]
    assert np.abs(turned.arrays["route"] - run.arrays["route"])[both, :2].max() < 3.0


def test_a_drive_that_may_not_be_relied_on_is_drawn_dotted(run: rf.DriveRun) -> None:
    weak = replace(run, facts=run.facts | {"trust": run.facts["trust"] | {"grade": "weak"}})
    for figure in (channel_figure, plan_figure):
        solid = [
            sum(line.get_linestyle() == "-" and len(line.get_xdata()) > 1 for line in figure(one, 800).axes[0].lines)
            for one in (run, weak)
        ]
        assert solid[0] > solid[1], figure.__name__


def test_command_writes_a_run(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    app(["locate", str(site), "--out", str(tmp_path / "run")], standalone_mode=False)
    said = capsys.readouterr().out
    assert "gps.csv states, and taken is:" in said and "channels located along" in said
    assert (tmp_path / "run" / "report.html").is_file()
    with pytest.raises(rf.InputError, match="takes no method"):
        rf.locate(site, method="network")
