import json

import numpy as np
import pytest
from pydantic import ValidationError

from vision.camera import Calibration
from vision.contract.errors import InputError
from vision.contract.frame import LocalFrame
from vision.lens import Lens


def look(position, target, focal=900.0, size=(960, 540)):
    """Homography and 3 x 4 matrix of a camera at `position` (z down, so negative z) looking at `target`."""
    forward = np.subtract(target, position, dtype=float)
    forward /= np.linalg.norm(forward)
    right = np.cross([0, 0, 1.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    intrinsic = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    matrix = intrinsic @ np.column_stack([rotation, -rotation @ np.asarray(position, float)])
    return np.linalg.inv(matrix[:, [0, 1, 3]]), matrix


@pytest.fixture(params=[((0, 12, -7), (15, -2, 0)), ((-30, 5, -10), (10, 0, 0)), ((40, -8, -5), (10, 1, 0))])
def view(request):
    homography, matrix = look(*request.param)
    return (
        Calibration(image_size=(960, 540), homography=-3.7 * homography),
        matrix,
        np.array(request.param[0]),
    )


def test_ground_and_image_are_inverse(view):
    calibration, _, _ = view
    pixels = np.random.default_rng(0).uniform([0, 300], [960, 540], (50, 2))
    np.testing.assert_allclose(calibration.to_image(calibration.to_ground(pixels)), pixels, atol=1e-6)


def test_jacobian_is_the_derivative(view):
    calibration, _, _ = view
    pixels = np.random.default_rng(1).uniform([0, 300], [960, 540], (50, 2))
    step = 1e-4
    numeric = np.stack(
        [
            (calibration.to_ground(pixels + d) - calibration.to_ground(pixels - d)) / (2 * step)
            for d in step * np.eye(2)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(calibration.jacobian(pixels), numeric, rtol=1e-5, atol=1e-7)


def test_nothing_above_the_horizon():
    homography, matrix = look((-30, 5, -10), (10, 0, 0))
    calibration = Calibration(image_size=(960, 540), homography=homography)
    horizon = matrix[1, 0] / matrix[2, 0]  # vanishing point of +x
    above, below = [[480.0, horizon - 20]], [[480.0, horizon + 20]]
    assert np.isnan(calibration.to_ground(above)).all() and np.isnan(calibration.jacobian(above)).all()
    assert np.isfinite(calibration.to_ground(below)).all() and np.isfinite(calibration.jacobian(below)).all()
    assert np.isnan(calibration.to_image([[-60.0, 5.0]])).all(), "behind the camera"


def test_pinhole_is_the_camera_the_homography_came_from(view):
    calibration, matrix, position = view
    pinhole = calibration.pinhole()
    assert pinhole.focal == pytest.approx(900, rel=1e-6)
    np.testing.assert_allclose(pinhole.position, position, atol=1e-5)
    points = np.random.default_rng(2).uniform([0, -4, -3], [20, 4, 0], (20, 3))
    image = points @ matrix[:, :3].T + matrix[:, 3]
    np.testing.assert_allclose(pinhole.project(points), image[:, :2] / image[:, 2:], atol=1e-5)


def test_pinhole_of_an_imperfect_homography_keeps_the_road_where_the_homography_puts_it(view):
    calibration, _, position = view
    skewed = Calibration(image_size=(960, 540), homography=calibration.homography @ np.diag([1.02, 1.0, 1.0]))
    pixels = np.random.default_rng(4).uniform([100, 320], [860, 540], (20, 2))
    ground = np.column_stack([skewed.to_ground(pixels), np.zeros(20)])
    pinhole = skewed.pinhole()
    np.testing.assert_allclose(pinhole.project(ground), pixels, atol=1e-6)
    assert np.linalg.norm(pinhole.position - position) < 2.0


def test_a_view_without_perspective_has_no_pinhole():
    down = Calibration(image_size=(640, 480), homography=[[0, -0.1, 48], [0.1, 0, -32], [0, 0, 1]])
    assert down.pinhole() is None


def test_mirrored_ground_is_refused():
    homography, _ = look((-30, 5, -10), (10, 0, 0))
    with pytest.raises(ValidationError, match="from below"):
        Calibration(image_size=(960, 540), homography=np.diag([1.0, -1, 1]) @ homography)


def test_round_trip(view, tmp_path):
    calibration = view[0].model_copy(update={"origin": (32.0, 34.8), "x_azimuth": 41.5})
    calibration.write(tmp_path / "cal.json")
    again = Calibration.read(tmp_path / "cal.json")
    np.testing.assert_allclose(again.homography, calibration.homography, rtol=1e-12)
    assert (again.origin, again.x_azimuth, again.image_size) == ((32.0, 34.8), 41.5, (960, 540))


def test_another_frame_than_the_surveys_is_refused(view):
    calibration = view[0].model_copy(update={"origin": (32.0, 34.8), "x_azimuth": 359.95})
    calibration.require_frame(LocalFrame((32.0000003, 34.8), 0.0), "c.json")  # rounded
    view[0].require_frame(LocalFrame((32.1, 34.8), 0.0), "c.json")  # does not say
    for other in (LocalFrame((32.0001, 34.8), 0.0), LocalFrame((32.0, 34.8), 78.0)):
        with pytest.raises(InputError, match=r"c\.json: was made for the frame origin = \[32\.0, 34\.8\]"):
            calibration.require_frame(other, "c.json")


GOOD = {"image_size": [640, 480], "homography": [[0, -0.1, 48], [0.1, 0, -32], [0, 0, 1]]}


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("{", "invalid JSON"),
        (json.dumps(GOOD | {"glass": 1}), "glass extra inputs"),
        (json.dumps({"image_size": [640, 480]}), "homography field required"),
        (json.dumps(GOOD | {"homography": [[1, 2], [3, 4]]}), "three rows"),
        (json.dumps(GOOD | {"homography": [[1, 2, 3], [2, 4, 6], [0, 0, 1]]}), "singular"),
        (json.dumps(GOOD | {"image_size": [0, 480]}), "positive"),
        (
            json.dumps(GOOD | {"control_points": [{"u": 1, "v": 2, "x": 3}]}),
            r"control_points\.0\.y field required",
        ),
        (json.dumps(GOOD | {"covariance": [[1.0]]}), "covariance must have 9 rows"),
        (json.dumps(GOOD | {"covariance": [[1.0, 2.0], [2.0, 1.0]]}), "no correlation above 1"),
        (json.dumps(GOOD | {"lens": {"focal": [0, 1], "center": [1, 2]}}), "must be two positive numbers"),
    ],
)
def test_bad_files_are_one_line(content, complaint, tmp_path):
    path = tmp_path / "cal.json"
    path.write_text(content)
    with pytest.raises(InputError, match=complaint) as error:
        Calibration.read(path)
    assert "\n" not in str(error.value) and "cal.json" in str(error.value)


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        Calibration.read(tmp_path / "no.json")
    (tmp_path / "b.json").write_bytes(b"\xff\x81")
    with pytest.raises(InputError, match="line 1 is not UTF-8"):
        Calibration.read(tmp_path / "b.json")


def test_wrong_size_names_both():
    with pytest.raises(InputError, match=r"1920 x 1080 px.*640 x 480 px"):
        Calibration(**GOOD).require_size(1920, 1080, "street.mp4")


LENS = Lens(focal=(700, 700), center=(485, 262), distortion=(-0.25, 0.07, 0, 0, 0))


@pytest.fixture
def bent(view):
    """A calibration whose picture is distorted; in ideal pixels it is the view with another focal length."""
    return Calibration(image_size=(960, 540), homography=view[0].homography, lens=LENS)


def test_distorted_ground_and_image_are_inverse(bent):
    pixels = np.random.default_rng(0).uniform([100, 320], [860, 540], (50, 2))
    ground = bent.to_ground(pixels)
    assert np.isfinite(ground).all()
    np.testing.assert_allclose(bent.to_image(ground), pixels, atol=1e-5)
    straight = Calibration(image_size=(960, 540), homography=bent.homography)
    assert np.linalg.norm(straight.to_image(ground) - pixels, axis=1).max() > 10


def test_distorted_jacobian_is_the_derivative(bent):
    pixels = np.random.default_rng(1).uniform([100, 330], [860, 540], (50, 2))
    step = 1e-3
    numeric = [(bent.to_ground(pixels + d) - bent.to_ground(pixels - d)) / (2 * step) for d in step * np.eye(2)]
    np.testing.assert_allclose(bent.jacobian(pixels), np.stack(numeric, axis=-1), rtol=1e-4, atol=1e-6)
    assert np.isnan(bent.jacobian([[480.0, 2.0]])).all() == np.isnan(bent.to_ground([[480.0, 2.0]])).all()


def test_a_distorted_pinhole_sees_the_road_where_the_calibration_does(bent):
    pixels = np.random.default_rng(4).uniform([200, 350], [760, 540], (20, 2))
    ground = np.column_stack([bent.to_ground(pixels), np.zeros(20)])
    np.testing.assert_allclose(bent.pinhole().project(ground), pixels, atol=1e-5)
    assert bent.pinhole().project(ground[:, None]).shape == (20, 1, 2)


def random_covariance(size, scale, rng):
    root = rng.normal(size=(size, size)) * scale[:, None]
    return root @ root.T


@pytest.mark.parametrize("lens", [None, LENS])
def test_position_covariance_is_that_of_perturbed_calibrations(view, lens):
    """Against positions of calibrations drawn from the covariance, through the file."""
    rng = np.random.default_rng(3)
    plain = Calibration(image_size=(960, 540), homography=view[0].homography, lens=lens)
    sizes = [np.abs(plain.homography.ravel()) * 2e-4 + 1e-9]
    if lens is not None:
        sizes.append(np.array([2e-4, 2e-4, 0.1, 0.1, 1e-3, 1e-3, 1e-5, 1e-5, 1e-4]))
    covariance = random_covariance(sum(map(len, sizes)), np.concatenate(sizes), rng)
    known = Calibration(image_size=(960, 540), homography=plain.homography, lens=lens, covariance=covariance)
    pixels = np.array([[300.0, 500], [600, 480], [480, 530]])
    root = np.linalg.cholesky(known.covariance + 1e-18 * np.diag(np.diagonal(known.covariance)))
    drawn = []
    for _ in range(1500):
        change = root @ rng.normal(size=len(root))
        moved = None if lens is None else Lens.from_vector(lens.vector + change[9:])
        homography = plain.homography + change[:9].reshape(3, 3)
        drawn.append(Calibration(image_size=(960, 540), homography=homography, lens=moved).to_ground(pixels))
    empirical = np.stack([np.cov(place.T) for place in np.swapaxes(drawn, 0, 1)])
    predicted = known.position_covariance(pixels)
    for ours, theirs in zip(predicted, empirical, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=0.12 * np.trace(theirs))


def test_no_covariance_means_none_and_the_sky_has_no_answer(view):
    covariance = view[0].position_covariance([[480, 530], [480, -2000]])
    np.testing.assert_array_equal(covariance[0], 0)
    assert np.isnan(covariance[1]).all()


def test_covariance_follows_the_scale_of_the_homography(view):
    size, homography = (960, 540), view[0].homography
    covariance = random_covariance(9, np.abs(homography.ravel()) * 1e-4, np.random.default_rng(0))
    one = Calibration(image_size=size, homography=homography, covariance=covariance)
    other = Calibration(image_size=size, homography=-4 * homography, covariance=16 * covariance)
    np.testing.assert_allclose(one.position_covariance([[480, 530]]), other.position_covariance([[480, 530]]))


def test_the_file_has_a_matrix_row_on_a_line_and_keeps_what_is_unknown(tmp_path):
    calibration = Calibration(**GOOD, covariance=np.eye(9).tolist(), leave_one_out_m=(0.5, None))
    calibration.write(tmp_path / "cal.json")
    assert "    [0.0, -0.1, 48.0]," in (tmp_path / "cal.json").read_text().splitlines()
    again = Calibration.read(tmp_path / "cal.json")
    assert again.leave_one_out_m == (0.5, None)
    np.testing.assert_array_equal(again.covariance, calibration.covariance)
