"""The mark to add next does what is promised of it."""

import numpy as np
import pytest
from street_marks import SIZE, marks

from calib.ground import fit_ground
from calib.next_mark import ENOUGH, next_mark


@pytest.fixture(scope="module")
def right_half():
    """Marks without those that are farthest to the left of the picture."""
    points = marks(noise=0.2)
    keep = np.ones(len(points), bool)
    keep[np.argsort(points.pixels[:, 0])[:2]] = False
    return points.select(keep)


@pytest.mark.parametrize("model", ["homography", "camera"])
def test_the_error_falls_at_least_to_what_was_promised(right_half, model):
    fit = fit_ground(right_half, SIZE, model=model)
    found = next_mark(fit.calibration)
    assert found is not None and found.before - found.after > ENOUGH
    place = fit.calibration.to_ground(found.pixel[None])
    more = type(right_half)(
        (*right_half.names, "new"), np.vstack([right_half.pixels, found.pixel]), np.vstack([right_half.ground, place]),
        np.append(right_half.sigma, 1.0), np.append(right_half.sigma_xy, 0.0),
    )  # fmt: skip
    again = fit_ground(more, SIZE, model=model).calibration
    covariance = again.position_covariance(found.pixel[None])[0]
    assert 0.5 * found.after < np.sqrt(np.linalg.norm(covariance, ord=2)) < 1.02 * found.after < found.before
    assert found.sentence.startswith(f"A mark {found.where}") and f"{found.before:.2f} m" in found.sentence


def test_nothing_is_asked_of_a_calibration_without_uncertainty(right_half):
    calibration = fit_ground(right_half, SIZE, model="homography").calibration
    assert next_mark(calibration.model_copy(update={"covariance": None})) is None


def test_enough_is_said(right_half):
    calibration = fit_ground(right_half, SIZE, model="homography").calibration
    small = calibration.model_copy(update={"covariance": 1e-12 * calibration.covariance})
    assert next_mark(small).sentence.startswith("The marks suffice")
