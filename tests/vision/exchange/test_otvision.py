import bz2
import json

import numpy as np
import pandas as pd
import pytest

from vision.contract import InputError, LocalFrame
from vision.exchange import read_ottrk, read_reference_points
from vision.interpolate import BOX

POINT = {"x_px": 1, "y_px": 2, "hemisphere": "N", "zone_utm": 32, "lon_utm": 5e5, "lat_utm": 5e6}


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


def test_reference_points_are_where_they_are(tmp_path):
    """UTM's easting grows by 0.9996 m per meter at the central meridian (Snyder 1987)."""
    points = {
        str(k): {
            "x_px": 10 * k,
            "y_px": 5,
            "hemisphere": "N",
            "zone_utm": 33,
            "lon_utm": 5e5 + 10 * k,
            "lat_utm": 5.6e6,
        }
        for k in range(4)
    }
    (tmp_path / "a.otrfpts").write_text(json.dumps(points))
    table = read_reference_points(tmp_path / "a.otrfpts")
    assert list(table) == ["name", "px", "py", "latitude", "longitude"]
    frame = LocalFrame((table["latitude"][0], table["longitude"][0]), 90.0)
    x, y = frame.to_local(table["latitude"], table["longitude"])
    np.testing.assert_allclose(x, np.arange(4) * 10 / 0.9996, atol=1e-4)
    np.testing.assert_allclose(y, 0, atol=1e-4)


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


@pytest.mark.parametrize(
    ("points", "complaint"),
    [
        ({}, "no reference points"),
        ([POINT], "no reference points"),
        ({"a": POINT, "b": {"x_px": 1}}, "point b: not complete"),
        ({"a": POINT | {"lon_utm": "east"}}, "give numbers"),
        ({"a": POINT | {"zone_utm": 61}}, "zone from 1 to 60"),
        ({"a": POINT | {"hemisphere": "W"}}, "N or S"),
    ],
)
def test_bad_points(tmp_path, points, complaint):
    (tmp_path / "a.otrfpts").write_text(json.dumps(points))
    with pytest.raises(InputError, match=complaint):
        read_reference_points(tmp_path / "a.otrfpts")


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_ottrk(tmp_path / "none.ottrk")
