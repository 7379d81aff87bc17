import bz2
import json

import pandas as pd
import pytest

from vision.contract import InputError
from vision.exchange import read_ottrk
from vision.interpolate import BOX


def entry(frame=1, track=1, when="2020-01-01 00:00:00.050000", **more):
    box = {"x": 150.0, "y": 136.0, "w": 76.0, "h": 46.0}
    name = {"class": "Car", "confidence": 0.84, "frame": frame, "occurrence": when, "track-id": track}
    return name | box | {"interpolated-detection": False, "first": frame == 1, "finished": False} | more


def write(path, entries, version="1.0", packed=True):
    text = json.dumps({"metadata": {"otdet_version": version}, "data": {"detections": entries}}).encode()
    path.write_bytes(bz2.compress(text) if packed else text)
    return path


@pytest.mark.parametrize("packed", [True, False])
def test_old_tracks_have_centers_and_dates(tmp_path, packed):
    rows = [entry(2, 7, "2020-01-01 00:00:00.100000", **{"interpolated-detection": True}), entry(1, 7)]
    table = read_ottrk(write(tmp_path / "a.ottrk", rows, packed=packed))
    assert table[BOX].iloc[0].tolist() == [112.0, 113.0, 188.0, 159.0]
    assert table["time"].tolist() == [pd.Timestamp(f"2020-01-01T00:00:00.{s}Z") for s in ("05", "1")]
    assert table["track_id"].tolist() == ["7", "7"] and table["frame"].tolist() == [0, 1]
    assert table["interpolated"].tolist() == [False, True] and table["detected_class"].tolist() == ["car", ""]


def test_new_tracks_have_corners_and_seconds(tmp_path):
    table = read_ottrk(write(tmp_path / "a.ottrk", [entry(when="1577836800.05")], version="1.2"))
    assert table[BOX].iloc[0].tolist() == [150.0, 136.0, 226.0, 182.0]
    assert table["time"].iloc[0] == pd.Timestamp("2020-01-01T00:00:00.05Z")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "not .ottrk tracks"),
        ("{}", "no tracks of OTVision"),
        ('{"metadata": {}, "data": {"detections": []}}', "must be tracked first"),
        ('{"metadata": {}, "data": {"detections": [{"class": "car"}]}}', "no tracks of OTVision"),
    ],
)
def test_bad_tracks(tmp_path, text, complaint):
    (tmp_path / "a.ottrk").write_text(text)
    with pytest.raises(InputError, match=complaint) as error:
        read_ottrk(tmp_path / "a.ottrk")
    assert "\n" not in str(error.value)


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_ottrk(tmp_path / "none.ottrk")
