"""Files of the forms that OTVision 0.7 writes (`OttrkBuilder`, `OtdetBuilder`) and those that older ones did."""

import bz2
import json

import pandas as pd
import pytest

from vision.contract import InputError
from vision.exchange import read_otdet, read_ottrk
from vision.interpolate import BOX

START = 1577836800.0  # 2020-01-01
BOXED = {"class": "Car", "confidence": 0.84, "x": 150.0, "y": 136.0, "w": 76.0, "h": 46.0}


def entry(frame=1, track=1, when=START + 0.05, **more):
    rest = {"interpolated-detection": False, "first": frame == 1, "finished": False, "input_file_path": "a.mp4"}
    return BOXED | {"frame": frame, "occurrence": when, "track-id": track} | rest | more


def metadata(version="1.4", normalized=False, **video):
    """As `OtdetMetadataBuilder` makes it."""
    video = {"filename": "a", "filetype": ".mp4", "width": 800, "height": 600, "actual_fps": 20.0} | video
    model = {"name": "YOLOv8", "weights": "yolov8s.pt", "classes": {"2": "car"}}
    return {
        "otdet_version": version,
        "video": video,
        "detection": {"otvision_version": "v0.7.2", "model": model, "normalized_bbox": normalized},
        "ottrk_version": "1.1",
        "tracking": {"tracker": {"name": "IOU"}},
    }


def write(path, data, facts=None, packed=True):
    content = {"metadata": metadata() if facts is None else facts, "data": data}
    text = json.dumps(content).encode()
    path.write_bytes(bz2.compress(text) if packed else text)
    return path


def tracks(path, entries, facts=None, packed=True):
    return read_ottrk(write(path / "a.ottrk", {"detections": entries}, facts, packed))


@pytest.mark.parametrize("packed", [True, False])
def test_old_tracks_have_centers_and_dates(tmp_path, packed):
    first, second = (f"2020-01-01 00:00:00.{part}" for part in ("050000", "100000"))
    rows = [entry(2, 7, second, **{"interpolated-detection": True}), entry(1, 7, first)]
    table = tracks(tmp_path, rows, metadata("1.0"), packed)
    assert table[BOX].iloc[0].tolist() == [112.0, 113.0, 188.0, 159.0]
    assert table["time"].tolist() == [pd.Timestamp(f"2020-01-01T00:00:00.{s}Z") for s in ("05", "1")]
    assert table["track_id"].tolist() == ["7", "7"] and table["frame"].tolist() == [0, 1]
    assert table["interpolated"].tolist() == [False, True] and table["detected_class"].tolist() == ["car", ""]


@pytest.mark.parametrize("version", ["1.2", "1.4", "2.0", "2", None, "ignored"])
@pytest.mark.parametrize("kind", [float, str])
def test_new_tracks_have_corners_and_seconds(tmp_path, version, kind):
    table = tracks(tmp_path, [entry(when=kind(START + 0.05))], metadata(version))
    assert table[BOX].iloc[0].tolist() == [150.0, 136.0, 226.0, 182.0]
    assert table["time"].iloc[0] == pd.Timestamp("2020-01-01T00:00:00.05Z")


@pytest.mark.parametrize("began", [START, "2020-01-01 00:00:00.000000"])
def test_frames_count_from_the_start_of_the_video(tmp_path, began):
    """OTVision numbers a file's frames from the first that has a track."""
    rows = [entry(1, when=START + 100 * 0.05), entry(2, when=START + 101 * 0.05)]
    assert tracks(tmp_path, rows, metadata(recorded_start_date=began))["frame"].tolist() == [100, 101]
    whole = [entry(1, when=START), entry(102, when=START + 101 * 0.05)]
    assert tracks(tmp_path, whole, metadata(recorded_start_date=began))["frame"].tolist() == [0, 101]


def test_normalized_boxes_are_shares_of_the_picture(tmp_path):
    row = entry(x=0.25, y=0.5, w=0.1, h=0.2)
    assert tracks(tmp_path, [row], metadata(normalized=True))[BOX].iloc[0].tolist() == [200.0, 300.0, 280.0, 420.0]


def test_detections(tmp_path):
    data = {str(number): {"detections": [], "occurrence": START + (number - 1) / 20} for number in range(1, 13)}
    data["10"]["detections"] = [BOXED | {"x": 10.0, "class": "truck"}]
    data["2"]["detections"] = [BOXED, BOXED | {"x": 400.0}]
    table = read_otdet(write(tmp_path / "a.otdet", data))
    assert table["frame"].tolist() == [1, 1, 9] and table["class"].tolist() == ["car", "car", "truck"]
    assert table["box_left"].tolist() == [150.0, 400.0, 10.0] and table["confidence"].tolist() == [0.84] * 3
    assert table["time"].iloc[2] == pd.Timestamp("2020-01-01T00:00:00.45Z")


EMPTY = {"1": {"detections": [], "occurrence": START}}


@pytest.mark.parametrize(
    ("read", "data", "complaint"),
    [
        (read_ottrk, {"detections": []}, "must be tracked first"),
        (read_ottrk, {"detections": [{"class": "car"}]}, "no tracks of OTVision"),
        (read_ottrk, {"detections": [entry(when=None)]}, "no tracks of OTVision"),
        (read_ottrk, EMPTY, "name it .otdet"),
        (read_otdet, EMPTY, "no detections"),
        (read_otdet, {"detections": [entry()]}, "no detections of OTVision"),
    ],
)
def test_bad_content(tmp_path, read, data, complaint):
    with pytest.raises(InputError, match=complaint) as error:
        read(write(tmp_path / "a.json", data))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"metadata": {}, "data": []}', "BZh9"])
def test_other_files(tmp_path, text):
    (tmp_path / "a.ottrk").write_text(text)
    with pytest.raises(InputError, match=r"not \.ottrk or \.otdet") as error:
        read_ottrk(tmp_path / "a.ottrk")
    assert "\n" not in str(error.value)


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_ottrk(tmp_path / "none.ottrk")
