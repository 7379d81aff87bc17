"""The rendered street agrees with its own truth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vision.contract import InputError
from vision.scene import (
    SIZES,
    Camera,
    Light,
    Scene,
    SceneVehicle,
    Street,
    constant_speed,
    control_point_card,
    control_points,
    render,
    truth_boxes,
    write_video,
)

CAMERA = Camera.looking_at((-8.0, -9.0, -7.0), (30.0, 0.0), size=(320, 180))
LARGER = CAMERA.scaled(2.0)
SHORT = Street(extent=(-20.0, 60.0))


def scene_with(*vehicles: SceneVehicle, **options) -> Scene:
    defaults = {"camera": CAMERA, "street": SHORT, "noise": 0.0, "flicker": 0.0, "light": Light(sun=0.0)}
    return Scene(**{**defaults, **options, "vehicles": vehicles})


CAMERAS = [
    CAMERA,
    Camera((0.0, -8.0, -7.0), yaw=20.0, pitch=12.0, focal=560.0),
    Camera((100.0, 6.0, -5.0), yaw=170.0, pitch=25.0, focal=300.0, size=(960, 540), roll=7.0),
]


@pytest.mark.parametrize("camera", CAMERAS)
def test_ground_homography_inverts_projection(camera):
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-150, 150, 400), rng.uniform(-40, 40, 400)])
    pixels = camera.project(np.column_stack([ground, np.zeros(400)]))
    seen = np.isfinite(pixels).all(1)
    homogeneous = np.column_stack([pixels[seen], np.ones(seen.sum())]) @ camera.ground_homography().T
    assert seen.sum() > 50
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], ground[seen], atol=1e-6)
    np.testing.assert_allclose(camera.to_ground(pixels[seen]), ground[seen], atol=1e-6)


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_is_that_of_opencv(camera):
    points = np.array([[30.0, 1.0, 0.0], [60.0, -2.0, -1.5]]) if camera.position[0] < 50 else np.array([[50.0, 3, -1]])
    turn = cv2.Rodrigues(camera.rotation)[0]
    shift = -camera.rotation @ np.array(camera.position)
    expected = cv2.projectPoints(points, turn, shift, camera.matrix, None)[0][:, 0]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


def test_camera_axes_are_those_of_the_frame():
    camera = Camera((0.0, 0.0, -5.0), yaw=0.0, pitch=0.0, focal=100.0, size=(200, 100))
    right, below = camera.project([[10.0, 1.0, -5.0], [10.0, 0.0, -4.0]]) - (100, 50)
    assert right.tolist() == [10.0, 0.0]
    assert below.tolist() == [0.0, 10.0]
    assert np.isnan(camera.project([[-10.0, 0.0, 0.0]])).all()


def test_looking_at_rolls_no_horizon_and_scales():
    twice = CAMERA.scaled(2.0)
    np.testing.assert_allclose(twice.project([[30.0, 0.0, 0.0]]), [[320.0, 180.0]], atol=1e-9)
    np.testing.assert_allclose(CAMERA.project([[30.0, 2.0, -1.0]]) * 2, twice.project([[30.0, 2.0, -1.0]]))


@pytest.mark.parametrize("cls", SIZES)
@pytest.mark.parametrize("style", [0, 1, 2])
@pytest.mark.parametrize("speed", [8.0, -8.0])
def test_truth_box_bounds_the_pixels_a_vehicle_changes(cls, style, speed):
    vehicle = SceneVehicle(cls, constant_speed(22.0, np.copysign(1.75, speed), speed), (20, 20, 230), style=style)
    scene = scene_with(vehicle)
    truth = truth_boxes(scene, 0.0)
    changed = np.abs(render(scene, 0.0).astype(int) - render(replace(scene, vehicles=()), 0.0)).max(2) > 25
    x1, y1, x2, _ = truth.boxes[0]
    rows, columns = np.nonzero(changed)
    assert truth.labels == (cls,)
    assert columns.min() >= np.floor(x1) - 1
    assert columns.max() <= np.ceil(x2)
    assert rows.min() >= np.floor(y1) - 1
    assert columns.min() <= x1 + 2.5  # and no looser than it must be
    assert columns.max() + 1 >= x2 - 2.5
    assert rows.min() <= y1 + 2.5


@pytest.mark.parametrize("cls", SIZES)
def test_box_edges_are_unbiased(cls):
    """The drawn outline lies on the truth to a quarter pixel, which is what filling polygons adds."""
    errors = []
    for x in np.arange(18.0, 30.0, 1.3):
        scene = scene_with(SceneVehicle(cls, constant_speed(x, 1.75, 8.0), (255, 255, 255)), camera=LARGER)
        difference = np.abs(render(scene, 0.0).astype(int) - render(replace(scene, vehicles=()), 0.0)).max(2)
        columns = np.flatnonzero((difference > 60).any(0))
        box = truth_boxes(scene, 0.0).boxes[0]
        errors.append([columns[0] - box[0], columns[-1] + 1 - box[2]])
    assert np.abs(np.mean(errors, axis=0)).max() < 0.6


def test_ground_point_is_under_the_middle_of_the_wheelbase():
    vehicle = SceneVehicle("bus", constant_speed(0.0, 0.0, 10.0))
    corners = vehicle.mesh.corners
    low = corners[corners[:, 2] > -0.03]  # where the tires touch
    assert abs(low[:, 0].mean()) < 0.02
    assert np.ptp(low[:, 0]) == pytest.approx(SIZES["bus"].wheelbase, abs=0.6)
    extent = np.ptp(corners, axis=0)
    np.testing.assert_allclose(extent, SIZES["bus"][:3], atol=0.06)


@pytest.mark.parametrize("near_lane_first", [True, False])
def test_nearer_vehicle_hides_the_farther(near_lane_first):
    near = SceneVehicle("truck", constant_speed(22.0, -1.75, 5.0), (240, 240, 240))
    far = SceneVehicle("car", constant_speed(26.0, 1.75, 5.0), (20, 20, 230))
    truth = truth_boxes(scene_with(*((near, far) if near_lane_first else (far, near))), 0.0)
    seen = dict(zip(truth.labels, truth.visibility, strict=True))
    assert seen["truck"] == pytest.approx(1.0, abs=0.05)
    assert seen["car"] < 0.6


def test_vehicle_at_the_border_has_a_cut_box_and_less_visibility():
    inside, cut = (truth_boxes(scene_with(SceneVehicle("bus", constant_speed(x, 1.75, 5.0))), 0.0) for x in (25.0, 6.0))
    assert cut.boxes[0, 2] == 320 or cut.boxes[0, 3] == 180
    assert 0 < cut.visibility[0] < 0.9 < inside.visibility[0]


def test_vehicle_behind_the_camera_is_not_there():
    assert len(truth_boxes(scene_with(SceneVehicle("car", constant_speed(-60.0, 1.75, 5.0))), 0.0).boxes) == 0


def test_same_seed_same_frames():
    vehicle = SceneVehicle("van", constant_speed(20.0, 1.75, 9.0))
    options = {"noise": 3.0, "flicker": 0.02, "shake": 0.5}
    first, second, other = (scene_with(vehicle, seed=seed, **options) for seed in (4, 4, 5))
    np.testing.assert_array_equal(render(first, 1.3), render(second, 1.3))
    assert (render(first, 1.3) != render(other, 1.3)).mean() > 0.5
    assert (render(first, 1.3) != render(first, 1.4)).mean() > 0.5


def test_noise_has_the_asked_spread():
    quiet, noisy = scene_with(), scene_with(noise=4.0)
    difference = render(noisy, 0.0).astype(float) - render(quiet, 0.0)
    assert difference.std() == pytest.approx(4.0, rel=0.1)


def test_sun_casts_a_shadow_on_the_far_side():
    light = Light(azimuth=-90.0, elevation=35.0, sun=1.0)  # sun on the left: shadow to the right
    scene = scene_with(SceneVehicle("truck", constant_speed(20.0, -1.75, 5.0)), light=light)
    edge = light.cast([[20.0, -0.55, -3.2]])[0]  # of the roof's right side
    np.testing.assert_allclose(edge, [20.0, -0.55 + 3.2 / np.tan(np.deg2rad(35))])
    with_truck, without = (render(s, 0.0).mean(2) for s in (scene, replace(scene, vehicles=())))
    x1, y1, x2, y2 = truth_boxes(scene, 0.0).boxes[0].round().astype(int)
    dark = with_truck < 0.8 * without
    dark[y1:y2, x1:x2] = False
    rows, columns = np.nonzero(dark)
    ground = scene.camera.to_ground(np.column_stack([columns, rows]) + 0.5)
    assert len(ground) > 100
    assert np.median(ground[:, 1]) > 0
    assert edge[1] - 0.5 < ground[:, 1].max() < edge[1] + 1.0


def test_control_points_lie_on_their_marks():
    scene = scene_with(camera=LARGER)
    points = control_points(scene)
    assert len(points) >= 8
    assert {p.name.split("_")[0] for p in points} == {"dash", "mark", "manhole"}
    for point in points:
        np.testing.assert_allclose(scene.camera.project([point.x, point.y, 0.0]), [point.px, point.py])
    assert control_point_card(scene, points).shape == (720, 1280, 3)


def test_survey_marks_are_drawn_where_they_are():
    """The saddle between the four quarters of a mark, in a picture fine enough to measure it."""
    scene = scene_with(camera=CAMERA.scaled(3.0))
    frame = cv2.GaussianBlur(cv2.cvtColor(render(scene, 0.0), cv2.COLOR_BGR2GRAY), (0, 0), 1.0)
    near = [p for p in control_points(scene, reach=24.0) if p.name.startswith("mark")]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    corners = [cv2.cornerSubPix(frame, np.float32([[p.px - 0.5, p.py - 0.5]]), (6, 3), (-1, -1), stop)[0] for p in near]
    drawn = scene.camera.to_ground(np.array(corners) + 0.5)
    assert len(near) >= 2
    np.testing.assert_allclose(drawn, [[p.x, p.y] for p in near], atol=0.03)


def test_video_has_all_frames_at_constant_rate(tmp_path):
    scene = scene_with(SceneVehicle("car", constant_speed(10.0, 1.75, 9.0)), camera=CAMERA)
    frames = write_video(scene, tmp_path / "street.mp4", fps=12.5, duration=0.8)
    video = cv2.VideoCapture(str(tmp_path / "street.mp4"))
    assert frames == 10
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    seen = []
    while (grabbed := video.read())[0]:
        seen.append(grabbed[1])
    assert len(seen) == 10
    assert np.abs(seen[4].astype(int) - render(scene, 4 / 12.5)).mean() < 6


def test_unknown_codec_is_one_clear_line_and_leaves_nothing(tmp_path, capfd):
    with pytest.raises(InputError, match="codec ABCD"):
        write_video(scene_with(), tmp_path / "street.mp4", duration=0.2, codec="ABCD")
    assert list(tmp_path.iterdir()) == []


def test_bright_light_saturates_and_does_not_wrap():
    bright = scene_with(light=Light(sun=1.0, exposure=1.6, visibility=100.0))
    usual = scene_with(light=Light(sun=1.0, exposure=1.0, visibility=100.0))
    assert (render(bright, 0.0).astype(int) >= render(usual, 0.0).astype(int) - 2).mean() > 0.999
