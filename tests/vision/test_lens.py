"""The lens against OpenCV, and its derivatives against differences."""

import cv2
import numpy as np
import pytest

from vision.lens import NAMES, Lens

LENSES = {
    "none": Lens(focal=(900, 900), center=(640, 360)),
    "barrel": Lens(focal=(800, 810), center=(650, 350), distortion=(-0.28, 0.09, 1e-3, -5e-4, -0.01)),
    "pincushion": Lens(focal=(1200, 1200), center=(640, 360), distortion=(0.15, -0.02, 0, 0, 0)),
}
PIXELS = np.random.default_rng(0).uniform([0, 0], [1280, 720], (60, 2))


@pytest.fixture(params=LENSES)
def lens(request):
    return LENSES[request.param]


def test_distortion_is_opencvs(lens):
    place = np.random.default_rng(1).uniform(-0.6, 0.6, (40, 2))
    points = np.column_stack([place, np.ones(40)])
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix, np.array(lens.distortion))
    np.testing.assert_allclose(lens.distort(place * lens.focal + lens.center), theirs[:, 0], atol=1e-9)


def test_undistort_is_the_inverse(lens):
    ideal = lens.undistort(PIXELS)
    assert np.isfinite(ideal).all()
    np.testing.assert_allclose(lens.distort(ideal), PIXELS, atol=1e-6)


def test_jacobian_is_the_derivative(lens):
    step = 1e-4
    numeric = [(lens.distort(PIXELS + d) - lens.distort(PIXELS - d)) / (2 * step) for d in step * np.eye(2)]
    np.testing.assert_allclose(lens.jacobian(PIXELS), np.stack(numeric, axis=-1), atol=1e-7)


def test_sensitivity_is_the_derivative_by_the_lens(lens):
    def ideal(vector):
        return Lens.from_vector(vector).undistort(PIXELS)

    steps = 1e-5 * np.eye(len(NAMES))
    numeric = np.stack([(ideal(lens.vector + s) - ideal(lens.vector - s)) / 2e-5 for s in steps], axis=-1)
    np.testing.assert_allclose(lens.sensitivity(PIXELS), numeric, rtol=1e-3, atol=1e-2)


def test_beyond_its_reach_it_says_nothing():
    lens = Lens(focal=(500, 500), center=(640, 360), distortion=(-0.3, 0, 0, 0, 0))
    assert lens.reach == pytest.approx(np.sqrt(1 / 0.9))
    edge = 640 + 500 * lens.reach
    assert np.isfinite(lens.distort([[edge - 5, 360]])).all()
    assert np.isnan(lens.distort([[edge + 5, 360]])).all()
    farthest = 640 + 500 * lens.reach * (1 - 0.3 * lens.reach**2)
    assert np.isnan(lens.undistort([[farthest + 5, 360]])).all()
    assert np.isfinite(lens.undistort([[farthest - 5, 360]])).all()


def test_the_vector_holds_all_of_it(lens):
    again = Lens.from_vector(lens.vector)
    assert again.focal == pytest.approx(lens.focal) and again.center == lens.center
    assert again.distortion == lens.distortion
