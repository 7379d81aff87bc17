"""Derivatives of views by their parameters are those of finite differences."""

import numpy as np
import pytest
from street_marks import GROUND, SIZE

from calib.homography import Scaling
from calib.lens_prior import weak_prior
from calib.models import CameraModel, GroundModel, HomographyModel

PRIOR = weak_prior(SIZE)
BASE = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
SEEN = Scaling.of(GROUND, GROUND @ [[3.0, 1.0], [-2.0, 40.0]])
CAMERA = np.array([0.3, -0.5, 0.2, 0.4, -0.3, 0.5, 0.02, 0.2, -0.03, 0.5, -1.0, -9.0])
ENTRIES = np.array([1.0, 0.1, 0.05, -0.2, 0.9, 0.1, 0.1, -0.05])


def differences(function, theta):
    steps = 1e-6 * np.eye(len(theta))
    return np.stack([(function(theta + step) - function(theta - step)) / 2e-6 for step in steps], -1)


@pytest.mark.parametrize(
    ("model", "theta"),
    [
        (CameraModel(PRIOR, BASE), CAMERA),
        (CameraModel(PRIOR, BASE, (8.0, 0.1)), np.concatenate([CAMERA[:6], np.zeros(3), CAMERA[9:]])),
        (HomographyModel(SEEN, None), ENTRIES),
        (HomographyModel(SEEN, PRIOR), np.concatenate([ENTRIES, CAMERA[:6]])),
    ],
    ids=["camera", "not turned, height known", "homography", "homography with a lens"],
)
def test_derivatives_are_those_of_differences(model: GroundModel, theta: np.ndarray) -> None:
    seen = np.isfinite(model.view(theta).project(GROUND)).all(1)
    assert seen.sum() > 5
    expected = differences(lambda t: model.view(t).project(GROUND), theta)[seen]
    np.testing.assert_allclose(model.slope(theta, GROUND)[seen], expected, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(model.penalty_slope(theta), differences(model.penalty, theta), atol=1e-8)
