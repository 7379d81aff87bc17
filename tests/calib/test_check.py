"""Known lengths against a calibration, and the check command from the outside."""

import json

import cv2
import numpy as np
import pytest
from street_marks import CAMERA, SIZE, marks
from typer.testing import CliRunner

import roadfiber.command
from calib.check import facts, words
from calib.ground import fit_ground
from calib.lengths import Lengths, predict_lengths, read_lengths
from calib.picture import GREEN, LABEL, draw_horizon, write_at, write_note
from vision.camera import Calibration
from vision.contract import InputError
from vision.lens import Lens

DASHES = np.array([[[20, -1.5], [23, -1.5]], [[30, 1.5], [36, 1.5]], [[25, -3.5], [25, 3.5]]], float)


def dashes(noise=0.0, seed=0):
    ends = CAMERA.project(np.dstack([DASHES, np.zeros((3, 2))]))
    ends = ends + noise * np.random.default_rng(seed).normal(size=ends.shape)
    length = np.linalg.norm(DASHES[:, 1] - DASHES[:, 0], axis=1)
    return Lengths(("near", "far", "across"), ends, length, np.full(3, 1e-3))


def truth():
    return Calibration(image_size=SIZE, homography=CAMERA.ground_homography())


def run(*arguments):
    return CliRunner().invoke(roadfiber.command.app, ["calibrate", "check", *map(str, arguments)])


@pytest.fixture
def street(tmp_path):
    fit_ground(marks(noise=0.5), SIZE, model="homography").calibration.write(tmp_path / "calibration.json")
    cv2.imwrite(str(tmp_path / "street.png"), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8))
    rows = [
        f"{name},{u1:.2f},{v1:.2f},{u2:.2f},{v2:.2f},{length}"
        for name, ((u1, v1), (u2, v2)), length in zip(
            *(getattr(dashes(), k) for k in ("names", "ends", "length")), strict=True
        )
    ]
    (tmp_path / "lengths.csv").write_text("name,px1,py1,px2,py2,length\n" + "\n".join(rows) + "\n")
    return tmp_path


def test_exact_lengths_come_back():
    found = predict_lengths(truth(), dashes())
    np.testing.assert_allclose(found.length, [3, 6, 7], atol=1e-6)
    assert (found.sigma > 0.01).all()


def test_the_sigma_is_that_of_many_calibrations_and_clicks():
    drawn, sigmas = [], []
    for seed in range(40):
        calibration = fit_ground(marks(noise=1.0, seed=seed), SIZE, model="homography", threshold=50).calibration
        found = predict_lengths(calibration, dashes(noise=1.0, seed=seed + 1000))
        drawn.append(found.length)
        sigmas.append(found.sigma)
    np.testing.assert_allclose(np.median(sigmas, axis=0), np.std(drawn, axis=0), rtol=0.35)


def test_a_wrong_scale_is_found_and_said():
    wide = Calibration(image_size=SIZE, homography=np.diag([1.1, 1.1, 1.0]) @ CAMERA.ground_homography())
    lengths = dashes()
    result = facts(wide, lengths, predict_lengths(wide, lengths))
    assert result["scale"] == pytest.approx(1.1, abs=1e-6) and result["scale_sigma"] < 0.05
    assert "over 3 sigmas off" in words(result)
    assert "over 3 sigmas off" not in words(facts(truth(), lengths, predict_lengths(truth(), lengths)))


def test_the_horizon_is_where_the_pinhole_has_it():
    canvas = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    assert draw_horizon(canvas, truth())
    row = np.flatnonzero(canvas[:, SIZE[0] // 2].any(axis=1))
    level = SIZE[1] / 2 - CAMERA.focal * np.tan(np.deg2rad(CAMERA.pitch))
    assert abs(row.mean() - level) < 5


def test_the_command_draws_and_says(street):
    out = street / "check.png"
    result = run(street / "calibration.json", street / "street.png", "--lengths", street / "lengths.csv", "--out", out)
    assert result.exit_code == 0, result.output
    assert "predicted m" in result.output and "scale" in result.output and "warning" not in result.output
    assert cv2.imread(str(out)).shape == (720, 1280, 3)


def test_a_lens_off_the_middle_is_told(street):
    view = Calibration.read(street / "calibration.json")
    off = view.model_copy(update={"lens": Lens(focal=(900.0, 900.0), center=(400.0, 360.0))})
    assert "principal point at 400, 360 px, 19 standard deviations" in words(facts(off, None, None))


def test_json(street):
    result = run(street / "calibration.json", street / "street.png", "--out", street / "c.png", "--json")
    found = json.loads(result.stdout)
    assert found["has_covariance"] and found["lengths"] == [] and 0.3 < found["road_share"] < 1
    assert found["camera_height_m"] == pytest.approx(7, abs=1.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,px1,py1,px2,py2\na,1,2,3,4\n", "no column length"),
        ("name,px1,py1,px2,py2,length\na,1,2,3,4,0\n", "above 0 m"),
        ("name,px1,py1,px2,py2,length\na,600,10,640,600,3\n", "above the horizon"),
        ("name,px1,py1,px2,py2,length\na,600,800,640,600,3\n", "outside the picture"),
    ],
)
def test_bad_lengths_are_one_line(street, text, message):
    (street / "bad.csv").write_text(text)
    result = run(
        street / "calibration.json", street / "street.png", "--lengths", street / "bad.csv", "--out", street / "c.png"
    )
    assert isinstance(result.exception, InputError) and message in str(result.exception)
    assert "\n" not in str(result.exception) and not (street / "c.png").exists()


def test_a_frame_of_another_size(street):
    cv2.imwrite(str(street / "small.png"), np.zeros((100, 200, 3), np.uint8))
    result = run(street / "calibration.json", street / "small.png", "--out", street / "c.png")
    assert "200 x 100 px but the calibration was made for 1280 x 720" in str(result.exception)


def test_lengths_without_a_sigma_have_two_centimeters(street, caplog):
    assert read_lengths(street / "lengths.csv").sigma.tolist() == [0.02] * 3
    assert "lengths are taken to be measured to 0.02 m" in caplog.text


@pytest.mark.parametrize("shade", [0, 128, 255])
def test_notes_and_labels_can_be_read_on_any_ground(shade):
    """Bright letters on a dark box; labels have a dark rim all around."""
    plain = np.full((60, 400, 3), shade, np.uint8)
    noted, labeled = plain.copy(), plain.copy()
    write_note(noted, "grid 10 x 2 m")
    assert (noted[0:12, 0:100].min(axis=(0, 1)) == 0).all() and noted[:30].max() > 200
    write_at(labeled, "y 8", np.array([20.0, 40.0]), GREEN, LABEL)
    letters = (np.abs(labeled.astype(int) - GREEN).sum(axis=2) < 60).astype(np.uint8)
    around = (cv2.dilate(letters, np.ones((3, 3), np.uint8)) - letters).astype(bool)
    assert letters.any() and np.median(labeled[around].max(axis=1)) < 120
