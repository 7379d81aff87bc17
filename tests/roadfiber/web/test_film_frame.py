"""The video in step with the record."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from roadfiber.web.film import film_of, joined
from roadfiber.web.workbench_page import Page
from vision.contract import InputError
from vision.frames import Frame

START = np.datetime64("2025-08-11T06:00:00", "ns")


class Video:
    """Ten pictures, two a second."""

    path, width, height, frame_interval = "street.mp4", 64, 48, 0.5
    index, time = np.arange(10), np.arange(10) / 2

    def frames_at(self, wanted):
        return (Frame(int(at), float(self.time[at]), np.full((48, 64, 3), 90, np.uint8)) for at in wanted)


def tracks(start=START, **changes):
    rows = pd.DataFrame(
        {
            "time": pd.to_datetime(start + np.array([3000, 3500]).astype("timedelta64[ms]"), utc=True),
            "track_id": "<b>1</b>",
            "class": "car",
            "frame": [2, 3],
            "interpolated": False,
            "box_left": 10.0,
            "box_top": 10.0,
            "box_right": 30.0,
            "box_bottom": 30.0,
        }
    )
    return rows.assign(**changes)


def test_frames_are_those_of_the_record_s_clock():
    film = joined(SimpleNamespace(start=START), Video(), tracks())
    assert film.begun == 2.0
    assert [film.place(second) for second in (2.0, 3.1, 6.4, 60.0)] == [0, 2, 9, None]
    assert film.at(2).startswith("data:image/jpeg;base64,") and film.at(2) != film.at(0), "one has a box"


def test_tracks_of_something_else_tell_no_frames():
    run = SimpleNamespace(start=START)
    assert "name no frames" in joined(run, Video(), tracks().drop(columns="frame"))
    assert "name other frames" in joined(run, Video(), tracks(frame=[70, 71]))


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ([], "has no video"),
        ([{"role": "video", "path": "gone.mp4", "sha256": "0"}], "no longer there: gone.mp4"),
    ],
)
def test_why_there_is_no_film(inputs, said, tmp_path):
    assert said in film_of(SimpleNamespace(facts={"inputs": inputs}, folder=tmp_path))


def test_another_video_of_that_name_is_not_shown(tmp_path, monkeypatch):
    for name in ("street.mp4", "trajectories.csv"):
        (tmp_path / name).write_text("")
    monkeypatch.setattr("vision.video.open_video", lambda path: SimpleNamespace(checksum="1"))
    inputs = [{"role": "video", "path": str(tmp_path / "street.mp4"), "sha256": "0"}]
    told = film_of(SimpleNamespace(facts={"inputs": inputs}, folder=tmp_path))
    assert told == "street.mp4 is another video than the one that this run was made with."


def test_the_page_of_a_run_whose_video_is_gone_says_so_and_shows_all_else(bench):
    inputs = [{"role": "video", "path": "/gone/<i>street.mp4", "sha256": "0"}]
    run = replace(bench.run, facts=bench.run.facts | {"inputs": inputs})
    page = Page(bench, film_of(run))
    assert "no longer there: &lt;i&gt;street.mp4" in page.controls.picture.object
    assert page.maps.images[2].data["image"][0].size and len(page.traces.measured.data["x"])


def test_a_video_that_goes_while_the_page_is_open_is_said(bench):
    """Each frame is decoded when it is asked for."""
    video = Video()
    page = Page(bench, joined(bench.run, video, tracks(bench.run.start)))
    page.show_frame(2.5)
    assert "data:image/jpeg" in page.controls.picture.object

    def gone(wanted):
        raise InputError("street.mp4: no such file")

    video.frames_at = gone
    page.show_frame(3.5)
    assert page.controls.picture.object == "<small>street.mp4: no such file</small>"
    page.tapped(page.maps.channels.start + 5, 1.0)
    assert page.controls.second.value == 1.0
