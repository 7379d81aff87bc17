"""The picture of a street without its traffic."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from vision.camera import Calibration
from vision.contract import InputError
from vision.street_picture import StreetPicture

#: From 10 px a meter, looking straight down.
VIEW = Calibration(image_size=(160, 96), homography=np.diag([0.1, 0.1, 1.0]), model="homography")


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A gray street of 20 s on which one bright vehicle drives, and its calibration."""
    video, calibration = tmp_path / "street.mp4", tmp_path / "calibration.json"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"mp4v"), 5.0, (160, 96))
    for number in range(100):
        frame = np.full((96, 160, 3), 90, np.uint8)
        frame[40:60, number : number + 20] = 250
        writer.write(frame)
    writer.release()
    VIEW.write(calibration)
    return video, calibration


def test_traffic_vanishes_and_places_are_the_calibrations(files) -> None:
    picture = StreetPicture.of_video(*files)
    image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (96, 160) and np.abs(image.astype(float) - 90).max() < 25
    np.testing.assert_allclose(picture.to_image([[3.0, 4.0]]), [[30.0, 40.0]])
    assert picture.size == (160, 96)


def test_it_is_read_back_or_left_out_where_it_is_damaged(files, tmp_path: Path) -> None:
    picture = StreetPicture.of_video(*files)
    jpeg, text = tmp_path / "street.jpg", tmp_path / "again.json"
    assert StreetPicture.read(jpeg, text) is None
    jpeg.write_bytes(picture.jpeg)
    text.write_text(picture.text)
    again = StreetPicture.read(jpeg, text)
    assert again is not None and again.jpeg == picture.jpeg and again.size == (160, 96)
    for content, facts in ((b"<svg onload=alert(1)>", picture.text), (picture.jpeg, '{"homography": 1}')):
        jpeg.write_bytes(content)
        text.write_text(facts)
        assert StreetPicture.read(jpeg, text) is None


def test_a_video_of_another_size_is_a_line(files, tmp_path: Path) -> None:
    video, calibration = files
    VIEW.model_copy(update={"image_size": (640, 360)}).write(calibration)
    with pytest.raises(InputError, match="160 x 96 px but the calibration was made for 640 x 360 px"):
        StreetPicture.of_video(video, calibration)
    with pytest.raises(InputError, match="not a video"):
        (tmp_path / "no.mp4").write_text("no")
        StreetPicture.of_video(tmp_path / "no.mp4", calibration)
