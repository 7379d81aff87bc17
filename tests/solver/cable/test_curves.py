"""Frenet frames of curves known in closed form, and distances between routes known by construction."""

import numpy as np
import pytest

from solver.cable.curves import (
    PolynomialBasis,
    directed_hausdorff,
    frenet,
    frenet_of,
    frenet_of_points,
    hausdorff,
    resampled,
)
from solver.cable.fiber import SplineBasis
from vision.contract import InputError


def helix(angle: np.ndarray, radius: float, rise: float) -> np.ndarray:
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), rise * angle], axis=1)


@pytest.mark.parametrize(("radius", "rise"), [(3.0, 4.0), (30.0, 2.0), (8.0, -5.0)])
def test_a_helix_has_the_curvature_and_torsion_of_the_textbook(radius: float, rise: float):
    frame = frenet_of_points(helix(np.linspace(0, 5, 120), radius, rise))
    square = radius**2 + rise**2
    inner = slice(10, -10)
    np.testing.assert_allclose(frame.curvature[inner], radius / square, rtol=1e-4)
    np.testing.assert_allclose(frame.torsion[inner], rise / square, rtol=2e-3)


def test_the_frame_is_orthonormal_and_right_handed():
    frame = frenet_of_points(helix(np.linspace(0, 5, 60), 6.0, 1.5))
    axes = np.stack([frame.tangent, frame.normal, frame.binormal], axis=1)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (60, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)


def test_the_frame_does_not_depend_on_the_parameter():
    rng = np.random.default_rng(0)
    first, second, third = rng.normal(size=(3, 7, 3))
    # r(u(t)) with u = 2 t + t^2 / 2 at t = 0: chain rule by hand.
    again = frenet(2 * first, 4 * second + first, 8 * third + 6 * second)
    frame = frenet(first, second, third)
    for name in ("tangent", "normal", "binormal", "curvature", "torsion"):
        np.testing.assert_allclose(getattr(again, name), getattr(frame, name), rtol=1e-9)


def test_a_straight_route_has_no_normal():
    points = np.linspace([0.0, 4.0, 0.9], [90.0, 4.0, 0.9], 30)
    frame = frenet_of(
        SplineBasis.even(0.0, 90.0, 10.0),
        SplineBasis.even(0.0, 90.0, 10.0).interpolate(points[:, 0], points),
        points[:, 0],
    )
    assert np.isnan(frame.normal).all() and np.isnan(frame.torsion).all()
    assert frame.curvature.max() < 1e-9


def test_spline_and_points_of_the_same_route_agree():
    s = np.linspace(0, 100, 101)
    points = np.stack([s, 4 + 0.5 * np.sin(s / 15), 0.9 + 0.1 * np.cos(s / 20)], axis=1)
    basis = SplineBasis.even(0.0, 100.0, 2.0)
    of_spline = frenet_of(basis, basis.interpolate(s, points), s).curvature
    of_points = frenet_of_points(points).curvature
    np.testing.assert_allclose(of_spline[10:-10], of_points[10:-10], atol=2e-5)


@pytest.mark.parametrize("points", [np.zeros((5, 3)), np.repeat(np.eye(3), 4, axis=0)])
def test_too_few_or_repeated_points_are_refused(points: np.ndarray):
    with pytest.raises(InputError, match="at least six points"):
        frenet_of_points(points)


def test_hausdorff_of_parallel_and_of_bent_routes():
    straight = np.array([[0.0, 0.0], [100.0, 0.0]])
    bump = np.array([[0.0, 0.0], [50.0, 0.8], [100.0, 0.0]])
    assert hausdorff(straight, bump) == pytest.approx(0.8, abs=1e-3)
    assert hausdorff(straight, straight + np.array([0.0, 0.35])) == pytest.approx(0.35)
    assert hausdorff(bump, straight) == hausdorff(straight, bump)


def test_hausdorff_agrees_with_scipy_on_points():
    from scipy.spatial.distance import directed_hausdorff as reference

    rng = np.random.default_rng(1)
    one, other = rng.normal(size=(2, 12, 3)).cumsum(1)
    points = [resampled(route, 0.05) for route in (one, other)]
    assert directed_hausdorff(one, other) == pytest.approx(reference(*points)[0])
    assert directed_hausdorff(other, one) == pytest.approx(reference(*points[::-1])[0])


def test_sliding_along_itself_is_not_an_error_of_the_curve():
    s = np.linspace(0, 100, 101)
    route = np.stack([s, np.zeros(101), np.ones(101)], axis=1)
    assert directed_hausdorff(route[10:60] + np.array([0.3, 0.0, 0.0]), route) < 1e-6


def test_routes_that_cannot_be_compared_are_refused():
    with pytest.raises(InputError, match="same number of axes"):
        hausdorff(np.zeros((3, 2)), np.zeros((3, 3)))


def test_polynomials_and_their_derivatives():
    basis = PolynomialBasis(10.0, 60.0, 4)
    s, step = np.linspace(12, 58, 9), 1e-4
    for order in (0, 1, 2):
        numeric = (basis.at(s + step, order) - basis.at(s - step, order)) / (2 * step)
        np.testing.assert_allclose(basis.at(s, order + 1), numeric, atol=1e-7)
    cubic = 0.01 * (s - 20) ** 3 - s
    coefficients = np.linalg.lstsq(basis.at(s), cubic, rcond=None)[0]
    np.testing.assert_allclose(basis.at(s) @ coefficients, cubic, rtol=1e-9)
