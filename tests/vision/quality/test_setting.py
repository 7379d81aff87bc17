import bz2
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_tables import stamped, tracks, write

from vision.contract import InputError
from vision.dropped import FAR, SIGMA, join, write_dropped
from vision.exchange import write_mot
from vision.interpolate import BOX
from vision.quality import read_settings
from vision.quality.measures import measure, shared_edges
from vision.quality.setting import Picture


def test_tables_of_meters(tmp_path):
    a, b = write(stamped(tracks()), tmp_path / "a.csv"), tmp_path / "b.parquet"
    stamped(tracks(seed=1)).to_parquet(b)
    (tmp_path / "a.json").write_text(json.dumps({"frames_per_second": {"detect": 80.0, "all": 60.0}}))
    first, second = read_settings([a, b]).settings
    assert (first.name, first.unit, second.unit) == ("a", "m", "m") and first.has_boxes
    assert first.speed == {"detect": 80.0, "all": 60.0} and second.speed is None
    np.testing.assert_allclose(first.tracks["time"], tracks()["time"])


def test_interpolated_survives_a_csv(tmp_path):
    table = tracks(missed=0.2)
    (found,) = read_settings([write(table, tmp_path / "a.csv")]).settings
    assert (
        found.tracks["interpolated"].dtype == bool and found.tracks["interpolated"].sum() == table["interpolated"].sum()
    )
    assert (found.tracks.loc[found.tracks["interpolated"], "detected_class"] == "").all()


def test_one_table_in_pixels_puts_all_in_pixels(tmp_path):
    a = write(tracks(), tmp_path / "a.csv")
    write_mot(tracks(), tmp_path / "b.txt")
    first, second = read_settings([a, tmp_path / "b.txt"]).settings
    assert first.unit == second.unit == "px"
    np.testing.assert_allclose(first.tracks["y"], first.tracks[BOX[3]])
    np.testing.assert_allclose(second.tracks["time"], second.tracks["frame"] / 25, err_msg="the other table's clock")


@pytest.mark.parametrize("from_video", [True, False])
def test_frames_of_uneven_times_have_the_clock_of_the_video_or_of_the_other_table(tmp_path, from_video):
    table = tracks(metric=False)
    index = np.arange(table["frame"].max() + 1)
    time = np.cumsum(np.where(index % 7 == 3, 0.4, 0.04))
    write_mot(table, tmp_path / "b.txt")
    ours = write(table.assign(time=time[table["frame"]]), tmp_path / "a.csv")
    picture = Picture(tmp_path / "v.mp4", 4000, 4000, index, time)
    given = ([tmp_path / "b.txt"], None, None, picture) if from_video else ([ours, tmp_path / "b.txt"],)
    found = read_settings(*given).settings[-1].tracks
    np.testing.assert_allclose(found["time"], time[found["frame"]], atol=1e-9)


def as_otvision(table, path, tracked):
    """Write tracks as OTVision 0.7 does: with them, or only what was detected."""
    start, boxes = 1577836800.0, {}
    for row in table[~table["interpolated"]].itertuples():
        left, top, right, bottom = (getattr(row, name) for name in BOX)
        box = {"class": "private_van", "confidence": 0.8, "x": left, "y": top, "w": right - left, "h": bottom - top}
        when = {"occurrence": start + row.frame / 25}
        more = {"frame": row.frame + 1, "track-id": int(row.track_id), "interpolated-detection": False} | when
        boxes.setdefault(str(row.frame + 1), {"detections": []} | when)["detections"].append(
            box | more if tracked else box
        )
    entries = {"detections": [entry for frame in boxes.values() for entry in frame["detections"]]}
    facts = {"otdet_version": "1.4", "video": {"actual_fps": 25.0, "recorded_start_date": start}}
    path.write_bytes(bz2.compress(json.dumps({"metadata": facts, "data": entries if tracked else boxes}).encode()))
    return path


@pytest.mark.parametrize("suffix", ["ottrk", "otdet"])
def test_otvision_beside_a_table_of_ours(tmp_path, suffix):
    table = tracks(metric=False, missed=0.05)
    ours = write(table, tmp_path / "a.csv")
    theirs = as_otvision(table, tmp_path / f"b.{suffix}", suffix == "ottrk")
    first, second = (one.tracks for one in read_settings([ours, theirs]).settings)
    if suffix == "otdet":  # what is parked is not followed
        first = first[first["track_id"] != first["track_id"].iloc[-1]]
    assert second["track_id"].nunique() == first["track_id"].nunique() and set(second["class"]) == {"van"}
    boxes = [one[~one["interpolated"]].sort_values([*BOX, "frame"])[[*BOX, "frame"]] for one in (first, second)]
    np.testing.assert_allclose(*boxes)


def test_names(tmp_path):
    a = write(tracks(), tmp_path / "a.csv")
    assert [s.name for s in read_settings([a, a]).settings] == ["a", "a 2"]
    assert [s.name for s in read_settings([a, a], ["one", "two"]).settings] == ["one", "two"]
    with pytest.raises(InputError, match="--names: 1 different names for 2 tables"):
        read_settings([a, a], ["one", "one"])


BAD = {
    "no class": (lambda t: t.drop(columns="class"), "no column class"),
    "no frame": (lambda t: t.drop(columns=["frame", "track_id"]), "no column track_id, frame"),
    "no place": (lambda t: t.drop(columns=["x", *BOX]), "neither x, y nor box_left"),
    "no rows": (lambda t: t.iloc[:0], "no fixes"),
    "no number": (lambda t: t.assign(x=["a", *t["x"][1:]]), "row 1: x is 'a'"),
    "no time": (lambda t: t.assign(time="noon"), "'noon' is not a time"),
    "one no time": (lambda t: t.assign(time=[np.nan, *t["time"][1:]]), "row 1: time is 'nan'"),
    "still": (lambda t: t.assign(time=1.0), "time stands still"),
    "sigma": (lambda t: t.assign(sigma_x="wide"), "row 1: sigma_x is 'wide'"),
    "no sigma": (lambda t: t.assign(sigma_y=0.0), "row 1: sigma_y is 0"),
    "measured": (lambda t: t.assign(x_measured=np.nan, y_measured=0.0), "row 1: x_measured"),
    "class": (lambda t: t.assign(**{"class": None}), "row 1 names no track or class"),
    "frame": (lambda t: t.assign(frame=t["frame"] + 0.5), "not a whole number"),
    "before": (lambda t: t.assign(frame=t["frame"] - 9), "not a whole number from 0 on"),
    "flat": (lambda t: t.assign(box_right=t["box_left"]), "row 1 has a box without area"),
    "shares": (lambda t: t.assign(**(t[BOX] / 1e4)), "shares of the picture"),
    "guessed": (lambda t: t.assign(interpolated=True), "all fixes are interpolated"),
    "twice": (lambda t: pd.concat([t, t]), "is twice in frame 0"),
    "later": (lambda t: t.assign(time=t["time"] * 1.5), "same frames at other times"),
    "elsewhere": (lambda t: t.assign(frame=t["frame"] + 5000), "no frame in common"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_table_is_reported_and_the_others_are_compared(case, tmp_path):
    change, complaint = BAD[case]
    good, bad = write(tracks(), tmp_path / "good.csv"), write(change(tracks()), tmp_path / "bad.csv")
    tables = read_settings([bad, good, good])
    (line,) = tables.left_out
    assert [setting.path for setting in tables.settings] == [good, good]
    assert "bad.csv" in line and "\n" not in line and re.search(complaint, line)
    with pytest.raises(InputError, match=complaint):
        read_settings([bad] if case not in ("later", "elsewhere") else [good, bad])


def test_other_bad_input(tmp_path):
    with pytest.raises(InputError, match="no tables"):
        read_settings([])
    with pytest.raises(InputError, match="unknown kind"):
        read_settings([tmp_path / "a.xlsx"])
    with pytest.raises(InputError, match="no such file"):
        read_settings([tmp_path / "a.csv"])
    write_mot(tracks(), tmp_path / "b.txt")
    with pytest.raises(InputError, match="no clock; give --video, or its --frame-rate"):
        read_settings([tmp_path / "b.txt"])
    assert read_settings([tmp_path / "b.txt"], frame_rate=25).settings[0].tracks["time"].max() == pytest.approx(
        399 / 25
    )
    bare = write(tracks().drop(columns=BOX), tmp_path / "bare.csv")
    tables = read_settings([bare, write(tracks(metric=False), tmp_path / "px.csv")])
    assert [one.name for one in tables.settings] == [
        "px"
    ] and "no boxes, and other tables no meters" in tables.left_out[0]
    a = write(tracks(), tmp_path / "a.csv")
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(InputError, match=r"a\.json: not what"):
        read_settings([a])


def test_what_was_not_placed_is_not_a_miss(tmp_path):
    """Fixes in a track's middle and at its end that were detected and not placed on the road."""
    truth = tracks(noise=0.0)
    path, frame, first = tmp_path / "a.csv", truth["frame"], truth["track_id"] == "1"
    middle, end = first & frame.between(60, 69), first & (frame >= 150)
    table = truth.assign(interpolated=middle)[~end]
    write(table, path)
    gone = truth[middle | end].assign(cause=SIGMA)
    bare = measure(*plain(path), truth)
    write_dropped(join([gone, gone[:3].assign(track_id="", frame=7, cause=FAR)]), path)
    (setting,) = read_settings([path]).settings
    found = measure(setting, shared_edges([setting]), 10.0, truth)
    assert found.not_placed == {SIGMA: 60, FAR: 3} and found.breaks == 0 and found.missed == 0.0
    assert (bare.scores.misses, found.scores.misses, found.scores.unplaced) == (50, 0, 50) and found.scores.mota == 1
    (tmp_path / "a.csv.dropped").write_text("frame,cause\n1,fog\n")
    with pytest.raises(InputError, match=r"a\.csv\.dropped: no column track_id, class"):
        read_settings([path])
    write_dropped(None, path)
    assert read_settings([path]).settings[0].dropped is None


def plain(path):
    (setting,) = read_settings([path]).settings
    return setting, shared_edges([setting]), 10.0


def test_boxes_beyond_the_picture_are_clipped_and_counted(tmp_path):
    """A built-in detector draws boxes a few pixels beyond the border, some of them with their middle outside."""
    table = tracks(metric=False)
    table.loc[3, BOX] = [-6.0, 40.0, 4.0, 60.0]
    table.loc[5, BOX] = [620.0, 100.0, 652.0, 171.5]
    table.loc[7, BOX] = [300.0, 30.0, 340.0, 160.2]
    every = np.arange(400)
    path, picture = write(table, tmp_path / "a.csv"), Picture(tmp_path / "v.mp4", 640, 160, every, every / 25)
    (found,) = read_settings([path], picture=picture).settings
    box = found.tracks.set_index("frame").loc[lambda t: t["track_id"] == "1", BOX].to_numpy()
    assert found.clipped == 2 and len(found.tracks) == len(table)
    np.testing.assert_allclose(box[[3, 5, 7]], [[0, 40, 4, 60], [620, 100, 640, 160], [300, 30, 340, 160]])
    np.testing.assert_allclose(box[8:], table.loc[8:199, BOX])
    for other in (replace(picture, width=320), replace(picture, index=every[:399])):
        with pytest.raises(InputError, match="give the video of these tracks"):
            read_settings([path], picture=other)
