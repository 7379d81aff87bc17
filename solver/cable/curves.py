"""Geometry of routes: Frenet frame, curvature, torsion, distance between two routes, a polynomial basis."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.cable.fiber import Basis
from vision.contract import InputError

Array = NDArray[np.float64]

STRAIGHT = 1e-9  # 1/m; a curve that bends less has no normal
STEP = 0.05  # m between the points that a route is compared at


@dataclass(frozen=True)
class Frenet:
    """Frame of a space curve at some of its points (Frenet 1852, Serret 1851).

    Parameters
    ----------
    tangent, normal, binormal : [point, 3], unit vectors; normal and binormal are NaN where the curve is straight
    curvature : [point], 1/m
    torsion : [point], 1/m, positive where the curve winds as a right-handed screw; NaN where it is straight
    """

    tangent: Array
    normal: Array
    binormal: Array
    curvature: Array
    torsion: Array


def frenet(first: Array, second: Array, third: Array) -> Frenet:
    """Frenet frame from the derivatives of a curve by any parameter.

    T = r' / |r'|,  B = r' x r'' / |r' x r''|,  N = B x T,
    curvature = |r' x r''| / |r'|^3,  torsion = (r' x r'') . r''' / |r' x r''|^2  (do Carmo 1976, section 1.5).

    Parameters
    ----------
    first, second, third : [point, 3], derivatives of position, m per unit of the parameter, its square, its cube

    Examples
    --------
    >>> frame = frenet(np.array([[0.0, 3.0, 4.0]]), np.array([[-3.0, 0.0, 0.0]]), np.array([[0.0, -3.0, 0.0]]))
    >>> frame.curvature.tolist(), frame.torsion.tolist(), frame.normal.tolist()
    ([0.12], [0.16], [[-1.0, 0.0, 0.0]])
    """
    speed = np.linalg.norm(first, axis=1)
    turning = np.cross(first, second)
    size = np.linalg.norm(turning, axis=1)
    curvature = size / speed**3
    size = np.where(curvature > STRAIGHT, size, np.nan)
    tangent, binormal = first / speed[:, None], turning / size[:, None]
    torsion = (turning * third).sum(1) / size**2
    return Frenet(tangent, np.cross(binormal, tangent), binormal, curvature, torsion)


def frenet_of(basis: Basis, coefficients: Array, distance: Array) -> Frenet:
    """Frenet frame of a route `basis.at(s) @ coefficients` at `distance` [point], m.

    Examples
    --------
    >>> from solver.cable.fiber import SplineBasis
    >>> arc = np.linspace(0.0, 60.0, 200)
    >>> circle = np.stack([30 * np.sin(arc / 30), -30 * np.cos(arc / 30), np.ones(200)], axis=1)
    >>> basis = SplineBasis.even(0.0, 60.0, 3.0)
    >>> frenet_of(basis, basis.interpolate(arc, circle), np.array([20.0, 40.0])).curvature.round(4).tolist()
    [0.0333, 0.0333]
    """
    first, second, third = (basis.at(distance, order) @ coefficients for order in (1, 2, 3))
    return frenet(first, second, third)


def frenet_of_points(points: Array) -> Frenet:
    """Frenet frame at the points [point, 3], m, of a route, by a quintic spline through all of them.

    The spline's parameter is the length of the chords (de Boor 2001, chapter 13). Noise of the points is amplified:
    smooth them first.

    Raises
    ------
    InputError
        If there are fewer than six points, or one twice in a row.

    Examples
    --------
    >>> angle = np.linspace(0, 6, 80)
    >>> helix = frenet_of_points(np.stack([3 * np.cos(angle), 3 * np.sin(angle), 4 * angle], axis=1))
    >>> round(float(helix.curvature[40]), 4), round(float(helix.torsion[40]), 4)
    (0.12, 0.16)
    """
    from scipy.interpolate import make_interp_spline

    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) < 6 or not (chord > 0).all():
        raise InputError("route: give at least six points, none twice in a row, for a Frenet frame")
    length = np.concatenate([[0.0], np.cumsum(chord)])
    spline = make_interp_spline(length, points, k=5)
    return frenet(*(spline(length, order) for order in (1, 2, 3)))


def resampled(route: Array, step: float) -> Array:
    """Points on a polyline [point, axis], m, at most `step` apart, its own points among them.

    >>> resampled(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.4]]), 0.5).tolist()
    [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 0.4]]
    """
    counts = np.maximum(np.ceil(np.linalg.norm(np.diff(route, axis=0), axis=1) / step - 1e-9), 1).astype(int)
    pieces = [
        begin + np.arange(count)[:, None] / count * (end - begin)
        for begin, end, count in zip(route[:-1], route[1:], counts, strict=True)
    ]
    return np.concatenate([*pieces, route[-1:]])


def directed_hausdorff(route: Array, other: Array, step: float = STEP) -> float:
    """Largest distance, m, from a point of one route to the nearest point of another.

    h(A, B) = max over a in A of min over b in B of |a - b|  (Hausdorff 1914); both routes are polylines sampled every
    `step` m, which bounds the error by half a step.

    Parameters
    ----------
    route, other : [point, 2 or 3], m
    step : m

    Raises
    ------
    InputError
        If a route has no point, or the two differ in their number of axes.

    Examples
    --------
    >>> short, long = np.array([[0.0, 1.0], [5.0, 1.0]]), np.array([[0.0, 0.0], [9.0, 0.0]])
    >>> directed_hausdorff(short, long), round(directed_hausdorff(long, short), 3)
    (1.0, 4.123)
    """
    from scipy.spatial import cKDTree

    if not len(route) or not len(other) or route.shape[1] != other.shape[1]:
        raise InputError("routes: give two with points of the same number of axes to compare")
    return float(cKDTree(resampled(other, step)).query(resampled(route, step))[0].max())


def hausdorff(route: Array, other: Array, step: float = STEP) -> float:
    """Hausdorff distance, m: the larger of the two directed ones, max(h(A, B), h(B, A)).

    It tells how far two curves are apart wherever the channels lie on them; parameters as of `directed_hausdorff`.
    A route that is longer than the other counts the part that the other lacks: cut them to the same stretch first.

    Examples
    --------
    >>> route = np.array([[0.0, 4.0, 0.9], [50.0, 4.0, 0.9], [100.0, 4.0, 0.9]])
    >>> round(hausdorff(route, route + [0.0, 0.3, 0.4]), 6)
    0.5
    """
    return max(directed_hausdorff(route, other, step), directed_hausdorff(other, route, step))


@dataclass(frozen=True)
class PolynomialBasis:
    """Legendre polynomials over a stretch of fiber: the paper's polynomial route.

    A route is `basis.at(s) @ coefficients` with coefficients [degree + 1, axis], m.

    Parameters
    ----------
    start, stop : ends of the stretch, distance along the fiber, m
    degree : 1 is a straight line

    >>> basis = PolynomialBasis(0.0, 100.0, 2)
    >>> basis.at(np.array([0.0, 50.0, 100.0])).tolist()
    [[1.0, -1.0, 1.0], [1.0, 0.0, -0.5], [1.0, 1.0, 1.0]]
    """

    start: float
    stop: float
    degree: int

    def at(self, distance: Array, derivative: int = 0) -> Array:
        """Basis matrix [distance, coefficient], or its derivative by distance."""
        per_meter = 2 / (self.stop - self.start)
        u = (np.asarray(distance, float) - self.start) * per_meter - 1
        legendre = np.polynomial.legendre
        columns = [legendre.legval(u, legendre.legder(row, derivative)) for row in np.eye(self.degree + 1)]
        return np.asarray(np.stack(columns, axis=1) * per_meter**derivative)
