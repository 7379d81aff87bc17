"""A new survey: what is found in a folder, what is checked, and what is written."""

import json
import re
import shutil
import tomllib
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest

from roadfiber.web.site_checks import Checked, check, check_camera
from roadfiber.web.site_draft import found_in
from roadfiber.web.start_page import StartPage
from vision.contract import InputError, LocalFrame

MARKUP = "<i id='injected'>9</i>"


@pytest.fixture
def folder(hidden, tmp_path):
    """A survey's folder with its site.toml."""
    shutil.copytree(hidden.parent / "survey", tmp_path / "survey")
    return tmp_path / "survey"


def verdicts(found):
    return {one.what: one.verdict for one in found.checks}


def test_a_good_survey_passes_and_its_site_is_written_as_it_was(folder):
    draft = found_in(folder)
    told = []
    found = check(folder, draft, told.append)
    assert found.able and set(verdicts(found).values()) == {"good"}, found.checks
    assert {"start", "rate", "zone"} <= {row.what for file in found.statements for row in file.rows}
    assert told == ["Record", "Vehicles", "Anchors", "Clocks"] and len(found.tracks) == 4
    assert tomllib.loads(draft.text()) == tomllib.loads((folder / "site.toml").read_text())
    assert not list(folder.glob(".site-*"))


def test_a_camera_is_on_utc_less_its_offset_and_in_the_surveys_frame(tmp_path):
    """As `track` has it; its calibration may have been made for another frame."""
    for second in (0, 1):
        cv2.imwrite(str(tmp_path / f"20250811_06000{second}.png"), np.zeros((480, 640, 3), np.uint8))
    view = {"image_size": [640, 480], "homography": [[0, -0.1, 48], [0.1, 0, -32], [0, 0, 1]]}
    (tmp_path / "c.json").write_text(json.dumps(view | {"origin": [32.0, 34.8], "x_azimuth": 90.0}))
    start = datetime(2025, 8, 11, 6, tzinfo=UTC)
    camera = SimpleNamespace(video=tmp_path, calibration=tmp_path / "c.json", start=start, clock_offset=0.5)
    found = Checked()
    check_camera(found, camera, LocalFrame((32.0, 34.8), 90.0))
    assert [str(one)[11:23] for one in found.spans["video"]] == ["05:59:59.500", "06:00:00.500"]
    with pytest.raises(InputError, match="was made for the frame origin"):
        check_camera(found, camera, LocalFrame((32.0, 34.8), 78.0))


def test_a_folder_without_a_site_is_looked_through(folder):
    (folder / "site.toml").unlink()
    draft = found_in(folder)
    assert (draft.tracks, draft.anchors, draft.origin) == ("trajectories.csv", "anchors.csv", "")
    assert any(folder.glob(draft.das))
    found = check(folder, draft)
    assert verdicts(found) == {"Fields": "failed"} and "origin: give 2 numbers" in found.checks[0].words


@pytest.mark.parametrize(
    ("late", "what", "verdict", "said"),
    [
        (7200.0, "Overlap in time", "failed", "the vehicles end after the record: see the zones of both clocks"),
        (3.0, "Coverage and clocks", "look", r"take (2\.9|3\.0)\d s off their times"),
    ],
)
def test_clocks_that_differ_are_told(folder, late, what, verdict, said):
    tracks = pd.read_csv(folder / "trajectories.csv")
    times = pd.to_datetime(tracks["time"], utc=True, format="ISO8601") + pd.Timedelta(seconds=late)
    tracks.assign(time=times.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")).to_csv(folder / "trajectories.csv", index=False)
    one = next(one for one in check(folder, found_in(folder)).checks if one.what == what)
    assert one.verdict == verdict and re.search(said, one.words), one


def test_places_far_apart_are_told(folder):
    anchors = pd.read_csv(folder / "anchors.csv")
    anchors.assign(x=anchors["x"] + 400).to_csv(folder / "anchors.csv", index=False)
    one = next(one for one in check(folder, found_in(folder)).checks if one.what == "Anchors")
    assert one.verdict == "look" and "m from all vehicles" in one.words


def test_tracks_that_are_turned_are_told_before_a_fit(folder):
    """Every check was ticked, and `locate` blamed the anchors after the fit."""
    tracks = pd.read_csv(folder / "trajectories.csv")
    tracks.assign(x=-tracks["x"], y=-tracks["y"]).to_csv(folder / "trajectories.csv", index=False)
    one = next(one for one in check(folder, found_in(folder)).checks if one.what == "Coverage and clocks")
    assert one.verdict == "look" and "were turned about the origin by half a turn, as x_azimuth" in one.words


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"das": "gone/*.h5"}, "no file matches 'gone/*.h5'"),
        ({"azimuth": "north"}, "azimuth: 'north' is no number"),
        ({"video": "street.mp4", "start": "2025-08-11T06:00:00"}, "has no time zone"),
        ({"video": "street.mp4", "start": "noon"}, "'noon': is not a time"),
        ({"tracks": ""}, "neither [camera] nor [trajectories]"),
    ],
)
def test_what_cannot_be_is_a_line(folder, change, said):
    (one,) = check(folder, replace(found_in(folder), **change)).checks
    assert one.verdict == "failed" and said in one.words and ".site-" not in one.words


class Now:
    """A worker that answers at once."""

    def ask(self, task, folder, draft, *, then, told, failed):
        try:
            then(check(folder, draft, lambda what: told(("line", what))))
        except InputError as error:
            failed(str(error))


def test_nothing_is_written_before_it_was_checked_and_wanted(folder):
    kept = (folder / "site.toml").read_text()
    page = StartPage(folder, Now())
    page.view()
    assert page.write_button.disabled
    page.box["name"].value = MARKUP
    page.check()
    assert not page.write_button.disabled and MARKUP not in page.text.object and "injected" in page.text.object
    assert "<caption>trajectories.csv</caption>" in page.list.object
    page.write()
    assert (folder / "site.toml").read_text() == kept and "tick the box" in page.said.object
    page.box["azimuth"].value = "79"
    assert page.write_button.disabled, "what is changed is checked again"
    page.check()
    page.replace.value = True
    page.write()
    written = tomllib.loads((folder / "site.toml").read_text())
    assert (written["name"], written["frame"]["x_azimuth"]) == (MARKUP, 79.0)
    assert "roadfiber locate" in page.said.object
