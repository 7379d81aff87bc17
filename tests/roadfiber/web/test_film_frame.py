"""The video in step with the record."""

import base64
import hashlib
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest

from roadfiber.web.film import film_of, joined
from roadfiber.web.workbench_page import Page
from solver.run.report.misfit import rows_of
from vision.contract import InputError, write_trajectories
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


RATE, SCALE, MARGIN, SIZE = 5.0, 3.0, 30, (400, 120)  # frames a second, px per meter, px


def pixel(place):
    """Where a place of the road is in the pictures of `filmed`."""
    return MARGIN + SCALE * (place[0] + 20), 60 + SCALE * place[1]


def filmed(folder, run, one):
    """Write a video of one vehicle, white on gray, and its tracks; the inputs that a run tells of them."""
    times = run.time[rows_of(run.result, one)]
    position = one.position[np.isin(one.rows, run.result.samples)]
    begun, video = times[0] + 0.37, folder / "street.mp4"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"mp4v"), RATE, SIZE)
    rows = []
    for frame in range(int((times[-1] - begun) * RATE)):
        second = begun + frame / RATE
        place = np.array([np.interp(second, times, position[:, axis]) for axis in (0, 1)])
        x, y = np.round(pixel(place)).astype(int)
        picture = np.full((*SIZE[::-1], 3), 90, np.uint8)
        picture[y - 6 : y + 6, x - 8 : x + 8] = 255
        writer.write(picture)
        box = {"box_left": x - 9, "box_top": y - 7, "box_right": x + 9, "box_bottom": y + 7}
        time = pd.Timestamp(run.start, tz="UTC") + pd.Timedelta(seconds=second)
        row = {"time": time, "track_id": "1", "class": "car", "x": place[0], "y": place[1], "sigma_x": 0.1}
        rows.append(row | {"sigma_y": 0.1, "frame": frame, "interpolated": False} | box)
    writer.release()
    write_trajectories(pd.DataFrame(rows), folder / "trajectories.csv")
    checksum = hashlib.sha256(video.read_bytes()).hexdigest()
    parts = (("video", video, checksum), ("trajectories", folder / "trajectories.csv", ""))
    return [{"role": role, "path": str(path), "sha256": sha} for role, path, sha in parts]


def shown_place(page):
    """x along the road of the white vehicle in the picture on the page."""
    content = page.controls.picture.object.partition("base64,")[2].partition("'")[0]
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_GRAYSCALE)
    columns = np.nonzero(picture > 225)[1] * SIZE[0] / picture.shape[1]
    return (float(np.median(columns)) - MARGIN) / SCALE - 20


def test_picture_box_and_mark_on_the_map_are_of_one_moment(bench, tmp_path):
    run, one = bench.run, bench.run.passes[0]
    inputs = filmed(tmp_path, run, one)
    page = Page(bench, film_of(replace(run, facts=run.facts | {"inputs": inputs})))
    page.controls.passes.value = 0
    seconds = run.time[rows_of(run.result, one)] - page.maps.maps.start
    step = abs(one.speed) / RATE
    for second in np.linspace(seconds[0] + 1, seconds[-1] - 1, 6):
        page.controls.second.value = float(second)
        (marked,) = page.map.vehicle.data["x"]
        # The nearest frame and the nearest sample are up to half a step of theirs away.
        assert shown_place(page) == pytest.approx(marked, abs=step + 1.0), second
        assert page.traces.now.location == second


def test_a_vehicle_is_marked_hollow_where_nobody_saw_it_and_not_at_all_beyond(bench):
    page, one = Page(bench, "no film"), bench.run.passes[0]
    page.controls.passes.value = 0
    seconds = bench.run.time[rows_of(bench.run.result, one)] - page.maps.maps.start
    in_view = one.in_view[np.isin(one.rows, bench.run.result.samples)]
    assert in_view.any() and not in_view.all()
    for seen in (True, False):
        page.controls.second.value = float(seconds[np.flatnonzero(in_view == seen)[0]])
        assert page.map.vehicle.data["fill"] == [float(seen)]
    page.at(page.controls.channel.value, float(seconds[-1] + 2))
    assert page.map.vehicle.data["x"] == []
