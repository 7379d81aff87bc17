"""Circles from widths, and the locus of one width."""

import numpy as np
import pytest

from solver.published.circles import circles_of, equal_width_locus
from solver.start.coupling_curve import coupling_curve
from solver.start.detections import Detections

CURVE = coupling_curve("car", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)


def seen(width: np.ndarray, snr_db: float = 20.0, y: float = 0.0) -> Detections:
    """Detections of one pass along +x whose responses are `width` m wide, at 1 m per channel."""
    count = len(width)
    place, zero = np.arange(float(count)), np.zeros(count)
    return Detections(zero.astype(int), place, zero + y, zero + 12.0, place, width, zero + snr_db, np.zeros((count, 3)))


def test_radii_are_the_offsets_whose_width_was_seen():
    offset = np.array([4.0, 6.0, 9.0])
    circles = circles_of([seen(CURVE.width_at(offset), y=-3.5)], [CURVE], 1.0)
    np.testing.assert_allclose(circles.radius, offset, atol=1e-6)
    np.testing.assert_array_equal(circles.center, [[0.0, -3.5], [1.0, -3.5], [2.0, -3.5]])
    assert len(circles) == 3


def test_sigma_is_that_of_the_width_through_the_inverted_curve():
    width = CURVE.width_at(np.array([7.0]))
    quiet, loud = (circles_of([seen(width, snr_db)], [CURVE], 1.0).sigma[0] for snr_db in (8.0, 40.0))
    rng = np.random.default_rng(0)
    drawn = CURVE.offset_of(width + 0.02 * width * rng.normal(size=4000))
    assert loud == pytest.approx(drawn.std(), rel=0.15)
    assert quiet > 3 * loud


def test_a_width_that_tells_nothing_is_anywhere_below_the_nearest():
    circles = circles_of([seen(np.array([0.5 * CURVE.width[0]]))], [CURVE], 1.0)
    assert circles.radius[0] == circles.sigma[0] == CURVE.nearest / 2


def test_the_clock_moves_the_centers_along():
    circles = circles_of([seen(CURVE.width_at(np.array([5.0])))], [CURVE], 1.0, lag=0.25)
    np.testing.assert_allclose(circles.center, [[3.0, 0.0]])


@pytest.mark.parametrize("kind", ["vehicle", "car"])
def test_the_locus_of_a_width_is_where_the_response_is_that_wide(kind: str):
    depth = np.array([0.4, 0.7, 1.0])
    offset = equal_width_locus(8.5, kind, depth)
    assert (np.diff(offset) < 0).all()
    for y, z in zip(offset, depth, strict=True):
        curve = coupling_curve(kind, depth=float(z), gauge_length=10.0, poisson_ratio=0.25)
        assert curve.width_at(y) == pytest.approx(8.5, abs=1e-6)
    assert np.isnan(equal_width_locus(3.0, kind, depth)).all()
