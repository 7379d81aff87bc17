"""Calibration from control points, against a pinhole camera whose truth is known."""

import numpy as np
import pytest
from street_marks import CAMERA, GROUND, SIZE, marks

from calib.control_points import ControlPoints
from calib.ground import fit_ground
from calib.homography import Scaling, apply, inverse, refine
from vision.contract import InputError, LocalFrame


def road(n=300):
    return np.random.default_rng(5).uniform([12, -4], [72, 3.5], (n, 2))


def error_on_road(calibration):
    ground = road()
    seen = CAMERA.project(np.column_stack([ground, np.zeros(len(ground))]))
    return np.linalg.norm(calibration.to_ground(seen) - ground, axis=1)


@pytest.mark.parametrize("count", [4, 5, 6, 10])
def test_exact_points_give_the_camera_back(count):
    fit = fit_ground(marks(GROUND[[0, 1, 8, 9, 4, 5, 2, 3, 6, 7]][:count]), SIZE)
    assert fit.used.all()
    assert error_on_road(fit.calibration).max() < 1e-4
    assert max(fit.calibration.residuals_px) < 1e-5


def test_an_outlier_is_left_out_and_named():
    points = marks(noise=0.4)
    pixels = points.pixels.copy()
    pixels[3] += (40, -25)
    spoiled = ControlPoints(points.names, pixels, points.ground, points.sigma)
    fit = fit_ground(spoiled, SIZE)
    assert np.flatnonzero(~fit.used).tolist() == [3]
    assert any("left out as outliers: p3" in message for message in fit.warnings)
    assert "p3" not in [point.name for point in fit.calibration.control_points]
    assert fit.residuals_px[3] > 30 and error_on_road(fit.calibration).max() < 1.0


def test_predicted_uncertainty_and_leave_one_out_errors_are_those_that_happen():
    """Over many noise draws: worst_sigma is the rms error at the worst corner, to the accuracy of a linearization."""
    corner = np.array([72.0, -5.2])
    pixel = CAMERA.project([*corner, 0.0])
    errors, sigmas = [], []
    for seed in range(150):
        fit = fit_ground(marks(noise=0.5, sigma=0.5, seed=seed), SIZE, threshold=50.0)
        errors.append(fit.calibration.to_ground(pixel)[0] - corner)
        sigmas.append(fit.worst_sigma)
    principal = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(errors).T)).max())
    assert np.median(sigmas) == pytest.approx(principal, rel=0.25)


def test_refinement_is_the_least_squares_minimum():
    points = marks(noise=1.0)
    best = refine(points, inverse(CAMERA.ground_homography()))

    def cost(homography):
        return float(((apply(homography, points.ground) - points.pixels) ** 2).sum())

    scaling = Scaling.of(points)
    h = scaling.parameters(best)
    assert cost(best) < cost(inverse(CAMERA.ground_homography()))
    for step in 1e-4 * np.vstack([np.eye(8), -np.eye(8)]):
        assert cost(scaling.homography(h + step)) > cost(best)


def test_parameter_jacobian_is_the_derivative():
    points = marks()
    scaling = Scaling.of(points)
    h = scaling.parameters(inverse(CAMERA.ground_homography()))
    numeric = np.stack(
        [
            (apply(scaling.homography(h + step), points.ground) - apply(scaling.homography(h - step), points.ground))
            / 2e-6
            for step in 1e-6 * np.eye(8)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(scaling.jacobian(h, points.ground), numeric, rtol=1e-5, atol=1e-3)


def test_a_precise_point_outweighs_vague_ones():
    points = marks(noise=2.0, sigma=2.0)
    exact = marks().pixels
    pixels, sigma = points.pixels.copy(), points.sigma.copy()
    pixels[4], sigma[4] = exact[4] + (1.5, 1.5), 0.02
    fit = fit_ground(ControlPoints(points.names, pixels, points.ground, sigma), SIZE, threshold=20.0)
    assert fit.residuals_px[4] < 0.02


def test_four_points_are_exact_and_unchecked():
    fit = fit_ground(marks(GROUND[[0, 1, 8, 9]], noise=1.0), SIZE)
    assert max(fit.calibration.residuals_px) < 1e-5 and fit.calibration.leave_one_out_m is None
    assert any("nothing checks them" in message for message in fit.warnings)


def test_a_weak_layout_is_warned_of():
    one_curb_but_one = np.array([[12, -4], [30, -3.2], [50, -4.8], [72, -4], [40, 3.5]])
    fit = fit_ground(marks(one_curb_but_one, noise=0.3), SIZE)
    assert any("layout is weak" in message for message in fit.warnings)
    assert not fit_ground(marks(noise=0.3), SIZE).warnings


def test_the_frame_is_noted_in_the_file():
    fit = fit_ground(marks(), SIZE, frame=LocalFrame((32.1, 34.8), 78.0))
    assert (fit.calibration.origin, fit.calibration.x_azimuth) == ((32.1, 34.8), 78.0)


def line(count):
    return np.column_stack([np.linspace(12, 60, count), np.linspace(-2, 3, count)])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (lambda: marks(GROUND[:3]), "3 given; a homography needs at least 4"),
        (lambda: marks(line(6)), "collinear in the image"),
        (lambda: marks(np.vstack([line(5), [[20.0, -5.0]]])), "all but one collinear"),
        (lambda: moved(0, (-5.0, 100.0)), "control point p0: outside the 1280x720 image"),
        (lambda: moved(2, (640.0, 30.0), count=5), "above the horizon"),
        (lambda: mirrored(), "mirrored; y must be to the right"),
        (lambda: shuffled(), "no homography puts most of them within"),
    ],
)
def test_unusable_points_are_one_clear_line(points, message):
    with pytest.raises(InputError, match=message) as caught:
        fit_ground(points(), SIZE)
    assert "\n" not in str(caught.value)


def moved(index, pixel, count=10):
    points = marks(GROUND[:count])
    pixels = points.pixels.copy()
    pixels[index] = pixel
    return ControlPoints(points.names, pixels, points.ground, points.sigma)


def mirrored():
    points = marks()
    return ControlPoints(points.names, points.pixels, points.ground * [1, -1], points.sigma)


def shuffled():
    points = marks()
    order = np.random.default_rng(1).permutation(len(points))
    return ControlPoints(points.names, points.pixels[order], points.ground, points.sigma)
