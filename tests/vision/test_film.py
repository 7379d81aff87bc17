"""The filmed street: its files agree with each other and with the vehicles' known motion."""

import cv2
import numpy as np
import pytest

from calib.control_points import read_control_points
from calib.ground import fit_ground
from tests.vision.videos import write_video
from vision.rendered import is_rendered
from vision.scene.film import CLICK, MAST, Driver, film, street_scene
from vision.scene.truth import truth_boxes
from vision.video import open_video


def driver(direction=1):
    def position(t):
        t = np.asarray(t, float)
        return np.column_stack([40 + direction * 10 * t, direction * 1.75 + 0.2 * np.sin(t)])

    def velocity(t):
        t = np.asarray(t, float)
        return np.column_stack([np.full_like(t, direction * 10.0), 0.2 * np.cos(t)])

    return Driver("car", 4.4, 1.8, position, velocity)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("film")
    scene = street_scene([driver(), driver(-1)], seed=1)
    film(scene, folder, 1.2, seed=1)
    return scene, folder


def test_the_video_has_a_frame_every_80_milliseconds(filmed):
    _, folder = filmed
    clip = open_video(folder / "street.mp4")
    assert (clip.width, clip.height) == MAST.size
    np.testing.assert_allclose(clip.time, np.arange(15) * 0.08, atol=1e-3)


def test_the_video_says_that_it_is_rendered(filmed, tmp_path):
    _, folder = filmed
    assert is_rendered(folder / "street.mp4")
    again = write_video(tmp_path / "again.mp4", [frame.image for frame in open_video(folder / "street.mp4").frames()])
    assert not is_rendered(again), "encoded anew, as a camera's video is"


def test_the_frames_show_the_vehicles_where_they_are(filmed):
    """What differs between the first and the last frame lies in the true boxes and their shadows."""
    scene, folder = filmed
    first, *_, last = (frame.image.astype(int) for frame in open_video(folder / "street.mp4").frames())
    changed = np.abs(first - last).sum(axis=2) > 90
    near = np.zeros_like(changed)
    for t in (0.0, 14 * 0.08):
        for left, top, right, bottom in truth_boxes(scene, t).boxes.round().astype(int):
            near[max(top - 6, 0) : bottom + 12, max(left - 30, 0) : right + 30] = True
    assert changed.sum() > 500 and changed[near].sum() > 0.95 * changed.sum()


def test_the_control_points_give_the_camera_back(filmed):
    _, folder = filmed
    points = read_control_points(folder / "control_points.csv")
    exact = MAST.project(np.column_stack([points.ground, np.zeros(len(points))]))
    assert 0.5 * CLICK < (points.pixels - exact).std() < 1.5 * CLICK
    fit = fit_ground(points, MAST.size)
    road = np.array([[20.0, -1.75], [40.0, 1.75], [60.0, 0.0]])
    seen = MAST.project(np.column_stack([road, np.zeros(3)]))
    assert fit.used.all() and np.abs(fit.calibration.to_ground(seen) - road).max() < 0.3
    assert cv2.imread(str(folder / "control_points.png")) is not None


def test_a_vehicle_points_where_it_drives():
    x, y, heading = driver(-1).pose(2.0)
    assert (x, y) == pytest.approx((20.0, -1.75 + 0.2 * np.sin(2.0)))
    assert np.cos(heading) == pytest.approx(-1, abs=1e-3) and np.sin(heading) == pytest.approx(
        0.02 * np.cos(2.0), abs=1e-4
    )
