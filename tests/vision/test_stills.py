"""Folders of pictures as videos: their order, their times, and what is refused."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import roadfiber.command
from calib.options import read_frame
from tests.vision.graphs import write_bright_spot_detector
from tests.vision.videos import numbered_images
from vision.contract.errors import InputError
from vision.still_times import TAKEN, exif_times, name_times
from vision.video import open_video

COUNT, SIZE = 12, (64, 48)


def stills(folder, names, images=None):
    folder.mkdir(exist_ok=True)
    for name, image in zip(names, numbered_images(len(names), SIZE) if images is None else images, strict=True):
        assert cv2.imwrite(str(folder / name), image)
    return folder


@pytest.fixture
def numbered(tmp_path):
    return stills(tmp_path / "stills", [f"frame{number}.png" for number in range(COUNT)])


def test_pictures_come_in_the_order_of_their_numbers_at_the_rate_given(numbered):
    (numbered / "notes.txt").write_text("no picture")
    video = open_video(numbered, rate=5.0)
    assert (len(video), video.width, video.height, video.created) == (COUNT, *SIZE, None)
    np.testing.assert_allclose(video.time, np.arange(COUNT) / 5)
    assert [round(frame.image.mean() / 4) for frame in video.frames(every=2)] == list(range(0, COUNT, 2))


def test_without_times_a_rate_is_asked_for(numbered):
    with pytest.raises(InputError, match=r"12 pictures times that increase.*--frame-rate"):
        open_video(numbered)


@pytest.mark.parametrize(
    ("names", "created"),
    [
        ([f"cam2_20250811_0600{k:02d}.{25 * k:03d}.jpg" for k in range(4)], None),
        ([f"2025-08-11T08-00-{k:02d}+0200_{7 - k}.jpg" for k in range(4)], "2025-08-11T06:00:00"),
        ([f"{1754892000 + k}.jpg" for k in range(4)], "2025-08-11T06:00:00"),
    ],
)
def test_names_tell_times(tmp_path, names, created):
    video = open_video(stills(tmp_path / "s", names))
    assert np.diff(video.time) == pytest.approx(1.025 if "cam2" in names[0] else 1.0)
    assert video.time[0] == 0 and (
        video.created is None if created is None else video.created == np.datetime64(created)
    )


@pytest.mark.parametrize("name", ["IMG_0001", "20251399_060000", "v20250811", "99999999999999"])
def test_names_that_tell_none(name):
    assert name_times([Path(f"{name}.jpg")]) is None


def write_exif(path, moment, fraction="", zone=""):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({TAKEN: moment, **({0x9291: fraction} if fraction else {}), 0x9011: zone})
    Image.new("RGB", SIZE, (40, 40, 40)).save(path, exif=exif)


def test_exif_data_tell_times_and_the_zone(tmp_path):
    for k in range(4):
        write_exif(tmp_path / f"{k}.jpg", "2025:08:11 08:00:00", f"{k * 25:02d}", "+02:00")
    video = open_video(tmp_path)
    np.testing.assert_allclose(video.time, 0.25 * np.arange(4))
    assert video.created == np.datetime64("2025-08-11T06:00:00")


def test_exif_data_of_whole_seconds_are_not_times_of_a_burst(tmp_path):
    for k in range(4):
        write_exif(tmp_path / f"{k}.jpg", "2025:08:11 08:00:00")
    assert exif_times(sorted(tmp_path.iterdir())) is not None
    with pytest.raises(InputError, match="--frame-rate"):
        open_video(tmp_path)


def test_damaged_and_foreign_pictures(numbered, caplog):
    (numbered / "frame4.png").write_bytes(b"junk")
    video = open_video(numbered, rate=5.0)
    assert [frame.index for frame in video.frames()] == [k for k in range(COUNT) if k != 4]
    assert "1 pictures are damaged" in caplog.text
    cv2.imwrite(str(numbered / "frame7.png"), np.zeros((48, 80, 3), np.uint8))
    with pytest.raises(InputError, match=r"frame7\.png: is 80 x 48 px, but the first .* 64 x 48"):
        list(video.frames())


@pytest.mark.parametrize("content", [{}, {"a.txt": b"text"}, {"a.png": b"junk"}])
def test_folders_without_pictures(content, tmp_path):
    for name, data in content.items():
        (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=r"holds no pictures|not a picture that can be read"):
        open_video(tmp_path)


def test_another_picture_is_another_video(numbered):
    before, again = (open_video(numbered, rate=rate).checksum for rate in (5.0, 6.0))
    cv2.imwrite(str(numbered / "frame3.png"), np.zeros((48, 64, 3), np.uint8))
    assert before == again != open_video(numbered, rate=5.0).checksum


def test_calibration_takes_the_middle_picture(numbered):
    assert round(read_frame(numbered).mean() / 4) == 6
    with pytest.raises(InputError, match="--frame-rate"):
        read_frame(numbered, time=1.0)


def test_track_follows_a_car_through_stills(tmp_path, monkeypatch, capsys):
    images = []
    for frame in range(COUNT):
        image = np.full((120, 160, 3), 40, np.uint8)
        images.append(cv2.rectangle(image, (10 + 4 * frame, 50), (50 + 4 * frame, 80), (220, 220, 220), -1))
    folder = stills(tmp_path / "street", [f"20250811_0600{k:02d}.png" for k in range(COUNT)], images)
    model = write_bright_spot_detector(tmp_path / "spot.onnx", (160, 120))
    monkeypatch.chdir(tmp_path)
    arguments = [
        "roadfiber",
        "-q",
        "track",
        folder,
        "--detector",
        model,
        "--json",
        "--draw",
        "d.mp4",
        "--cache",
        "kept",
    ]
    found = []
    for rate in ((), ("--frame-rate", "4"), ("--frame-rate", "0")):
        monkeypatch.setattr(sys, "argv", [str(part) for part in (*arguments, *rate)])
        with pytest.raises(SystemExit) as end:
            roadfiber.command.main()
        out, err = capsys.readouterr()
        found.append(json.loads(out) if not end.value.code else err)
    assert found[0]["tracks"] == 1 and found[0]["median_track_seconds"] == 11
    assert found[1]["median_track_seconds"] == 2.75 and found[1]["frames_detected_before"] == COUNT
    assert len(open_video(tmp_path / "d.mp4")) == COUNT
    assert "--frame-rate 0: must be above 0" in found[2]
