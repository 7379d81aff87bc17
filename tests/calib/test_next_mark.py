"""What the calibration page says to do next."""

import numpy as np
import pytest
from street_marks import GROUND, SIZE, marks

from calib.ground import GroundFit, fit_ground
from calib.next_mark import advice_lines, next_mark, odd_marks

FEW = GROUND[[0, 1, 2, 3, 5, 7, 9]]


@pytest.fixture(scope="module")
def fit() -> GroundFit:
    """Of a street with seven marks, none of them far off at the left, as a homography."""
    return fit_ground(marks(FEW, noise=0.4), SIZE, model="homography")


def worst_at(fit: GroundFit, pixel: tuple[float, float]) -> float:
    """Largest standard deviation of a pixel's place by the calibration, m."""
    return float(np.linalg.norm(fit.calibration.position_covariance(np.array([pixel]))[0], 2) ** 0.5)


def test_a_mark_where_it_is_told_lowers_the_error_there_as_told(fit: GroundFit) -> None:
    advice = next_mark(fit.calibration)
    assert advice is not None and advice.after < 0.85 * advice.before
    assert advice.before == pytest.approx(worst_at(fit, advice.pixel))
    low, high = FEW.min(0), FEW.max(0)
    assert (low <= [advice.x, advice.y]).all() and ([advice.x, advice.y] <= high).all()
    more = fit_ground(marks(np.vstack([FEW, [[advice.x, advice.y]]]), noise=0.4), SIZE, model="homography")
    assert worst_at(more, advice.pixel) == pytest.approx(advice.after, rel=0.25)
    assert any("Add a mark " in line and f"{advice.before:.2f} to {advice.after:.2f} m" in line
               for line in advice_lines(fit))  # fmt: skip


def test_marks_are_listed_by_their_leave_one_out_error(fit: GroundFit) -> None:
    rows = odd_marks(fit)
    assert len(rows) == len(FEW) and [off for _, off, _ in rows] == sorted((o for _, o, _ in rows), reverse=True)
    found = fit.calibration.leave_one_out_m
    assert found is not None and rows[0][1] == pytest.approx(max(one for one in found if one is not None))


def test_where_nothing_is_wrong_nothing_is_asked_for() -> None:
    """Many exact marks on a small place right before the camera."""
    ground = np.array([(x, y) for x in range(8, 20, 2) for y in range(-4, 5, 2)], float)
    fit = fit_ground(marks(ground, noise=0.02, sigma=0.05), SIZE, model="homography")
    assert next_mark(fit.calibration) is None
    assert advice_lines(fit) == [line for line in advice_lines(fit) if line.startswith(("Nothing", "Look at"))]
