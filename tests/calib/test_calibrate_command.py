"""`roadfiber calibrate ground` from the outside."""

import json

import cv2
import numpy as np
import pytest
from pyproj import Transformer
from street_marks import GROUND, SIZE, marks
from typer.testing import CliRunner

from roadfiber.command import app
from vision.camera import Calibration
from vision.contract import InputError, LocalFrame

FRAME = "[frame]\norigin = [32.113, 34.804]\nx_azimuth = 78.0\n"


def run(*arguments):
    return CliRunner().invoke(app, ["calibrate", "ground", *map(str, arguments)], catch_exceptions=True)


@pytest.fixture
def points_file(tmp_path):
    points = marks(noise=0.3)
    rows = [
        f"{name},{u:.2f},{v:.2f},{x},{y}"
        for name, (u, v), (x, y) in zip(points.names, points.pixels, points.ground, strict=True)
    ]
    path = tmp_path / "points.csv"
    path.write_text("name,px,py,x,y\n" + "\n".join(rows) + "\n")
    return path


def video(path, size=SIZE):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, size)
    for shade in range(5):
        writer.write(np.full((size[1], size[0], 3), 40 + shade, np.uint8))
    writer.release()
    return path


def test_it_writes_the_calibration_and_prints_the_errors(tmp_path, points_file):
    out = tmp_path / "calibration.json"
    result = run(points_file, "--image-size", "1280x720", "--out", out)
    assert result.exit_code == 0, result.output
    assert "leave-one-out" in result.output and "p9" in result.output
    calibration = Calibration.read(out)
    assert calibration.image_size == SIZE and len(calibration.control_points) == len(GROUND)
    assert max(calibration.residuals_px) < 1.5 and len(calibration.leave_one_out_m) == len(GROUND)
    assert [path.name for path in tmp_path.glob("*.png")] == ["calibration_maps.png"]


def test_reference_points_of_otvision_need_nothing_else(tmp_path):
    points, frame = marks(noise=0.3), LocalFrame((32.113, 34.804), 78.0)
    latitude, longitude = frame.to_geographic(*points.ground.T)
    east, north = Transformer.from_crs("EPSG:4326", "EPSG:32636", always_xy=True).transform(longitude, latitude)
    utm = {"hemisphere": "N", "zone_utm": 36}
    rows = zip(*points.pixels.T, east, north, strict=True)
    content = {
        str(k): {"x_px": round(u), "y_px": round(v), **utm, "lon_utm": e, "lat_utm": n}
        for k, (u, v, e, n) in enumerate(rows, 1)
    }
    path, out = tmp_path / "street.otrfpts", tmp_path / "c.json"
    path.write_text(json.dumps(content))
    result = run(path, "--image-size", "1280x720", "--out", out, "--json")
    assert result.exit_code == 0, result.output
    facts, written = json.loads(result.stdout), Calibration.read(out)
    assert facts["rms_px"] < 1 and list(written.origin) == facts["origin"]
    assert np.hypot(*frame.to_local(*written.origin)) < 200 and written.x_azimuth == facts["x_azimuth"]


def test_json_with_a_video_and_a_frame(tmp_path, points_file):
    (tmp_path / "frame.toml").write_text(FRAME)
    movie = video(tmp_path / "street.mp4")
    out = tmp_path / "c.json"
    result = run(points_file, "--video", movie, "--out", out, "--frame", tmp_path / "frame.toml", "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["rms_px"] < 1 and all(row["used"] for row in facts["points"])
    assert Calibration.read(out).x_azimuth == 78.0
    picture = cv2.imread(str(tmp_path / "c.png"))
    assert picture.shape == (720, 1280, 3)
    assert (picture.max(axis=(0, 1)) > 150).all()  # grid and marks were drawn on the dark frame


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--video VIDEO or --image-size WxH"),
        (["--image-size", "wide"], "give WIDTHxHEIGHT"),
        (["--image-size", "1280x720", "--origin", "here"], "--origin: give LAT,LON"),
        (["--image-size", "1280x720", "--origin", "32,34"], "needs origin"),
        (["--image-size", "1280x720", "--x-azimuth", "10"], "needs origin"),
        (["--image-size", "1280x720", "--frame", "absent.toml"], "absent.toml: cannot be read (No such file"),
        (["--image-size", "1280x720", "--picture", "p.png"], "--picture: needs --video"),
        (["--image-size", "1280x720", "--threshold", "0"], "--threshold: must be above 0"),
        (["--image-size", "640x360"], "outside the 640x360 image"),
        (["--video", "absent.mp4"], "absent.mp4: no such file"),
        (["--image-size", "1280x720", "--model", "fisheye"], "--model fisheye: give one of auto, homography, camera"),
        (["--image-size", "1280x720", "--height", "7"], "--height: give VALUE,SIGMA"),
        (["--image-size", "1280x720", "--height", "7,0"], "--height: value and sigma must be above 0"),
        (["--image-size", "1280x720", "--intrinsics", "absent.json"], "absent.json: cannot be read (No such file"),
        (["--image-size", "1280x720", "--maps", "maps.txt"], "maps.txt: maps are written as"),
    ],
)
def test_bad_input_writes_nothing(tmp_path, points_file, arguments, message):
    out = tmp_path / "calibration.json"
    result = run(points_file, "--out", out, *arguments)
    assert isinstance(result.exception, InputError) and message in str(result.exception)
    assert not out.exists()


def test_no_input_is_overwritten(tmp_path, points_file):
    cv2.imwrite(str(tmp_path / "street.png"), np.zeros((720, 1280, 3), np.uint8))
    before = (tmp_path / "street.png").read_bytes()
    result = run(points_file, "--video", tmp_path / "street.png", "--out", tmp_path / "street.json")
    assert "street.png: would be overwritten, and is an input" in str(result.exception)
    assert (tmp_path / "street.png").read_bytes() == before and not (tmp_path / "street.json").exists()


@pytest.mark.parametrize("last", ["calib.maps.write_maps", "vision.camera.Calibration.write"])
def test_calibration_maps_and_picture_are_written_together_or_not_at_all(tmp_path, points_file, monkeypatch, last):
    def refuse(*given):
        raise InputError("no space left")

    monkeypatch.setattr(last, refuse)
    image = tmp_path / "street.png"
    cv2.imwrite(str(image), np.zeros((720, 1280, 3), np.uint8))
    before = sorted(tmp_path.rglob("*"))
    result = run(points_file, "--video", image, "--out", tmp_path / "c.json", "--maps", tmp_path / "maps" / "m.png")
    assert "no space left" in str(result.exception)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_video_of_another_size_is_refused(tmp_path, points_file):
    movie = video(tmp_path / "small.mp4", (320, 240))
    result = run(points_file, "--video", movie, "--image-size", "1280x720", "--out", tmp_path / "c.json")
    assert "the video is 320x240" in str(result.exception)
