"""The smooth curve that touches the circles: L-BFGS-B with angle, length and curvature terms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.anchors import Anchor
from solver.cable import Basis, axial, unit
from solver.curves import PolynomialBasis
from solver.das import DASRecord
from solver.fit.network import Polyline
from solver.geometric.circles import Circles, circles_of
from solver.matched_filter import Initialization
from solver.regularizers import Regularization, anchor_loss
from solver.response import coupling_curve
from solver.trajectory import Pass
from vision.contract import InputError

Array = NDArray[np.float64]

REACH = 25.0  # m that a node may move from its start
BELIEVED_DEPTH = 0.9  # m
SOFT = 2.0  # standard deviations beyond which a circle pulls no harder
BESIDE = 1.0  # m; standard deviation along the fiber of the channel that a vehicle is beside
ITERATIONS = 500


@dataclass(frozen=True)
class CircleFit:
    """A route seen from above.

    Parameters
    ----------
    basis, coefficients : the route is `basis.at(s) @ coefficients` [distance, 2], m
    cost : what was minimized, at its end
    residual : (|r - v| - R) / sd of each circle
    converged : by L-BFGS-B's own test
    """

    basis: Basis
    coefficients: Array
    cost: float
    residual: Array
    converged: bool

    def at(self, distance: Array) -> Array:
        """Route [distance, 2], m."""
        return self.basis.at(distance) @ self.coefficients


def fit_circles(
    circles: Circles,
    distance: Array,
    basis: Basis,
    start: Array,
    nodes: Array,
    *,
    gauge_length: float,
    regularization: Regularization | None = None,
    anchors: Sequence[Anchor] = (),
    anchor_distance: Array | None = None,
) -> CircleFit:
    """Fit a smooth route to circles with L-BFGS-B (Byrd, Lu, Nocedal and Zhu 1995); gradients by autodiff.

    minimize  sum over circles c of rho((|r(s_c) - v_c| - R_c) / sd_c) + rho((r(s_c) - v_c) . t(s_c) / 1 m)
              + angle, length and curvature of r at the nodes, and anchors (`solver.regularizers`),
    rho(u) = 2 k^2 (sqrt(1 + u^2 / k^2) - 1), k = 2: a square for good circles, |u| for mistaken ones. The second
    term, with t the direction of the route, lets it touch its circles and not slide along them.

    Parameters
    ----------
    circles : loci
    distance : of each circle's channel along the fiber [circle], m
    basis : `Polyline` for a route of points, `PolynomialBasis` or `SplineBasis`
    start : coefficients [coefficient, 2], m; they decide on which side of the lanes the route ends
    nodes : distance of the points where shape is judged [node], m, evenly spaced
    gauge_length : m
    regularization : weights of the shape terms; the defaults if not given
    anchors, anchor_distance : known points, and where along the fiber they are [anchor], m

    Raises
    ------
    InputError
        If there are fewer than two circles.

    Examples
    --------
    >>> s = np.arange(0.0, 61.0, 5.0)
    >>> lane = np.column_stack([s, np.zeros(13)])
    >>> loci = Circles(s, lane, np.full(13, 4.0), np.full(13, 0.1))
    >>> line = Polyline(s)
    >>> fit = fit_circles(loci, s, line, lane + np.array([0.0, 2.0]), s, gauge_length=10.0)
    >>> fit.at(np.array([0.0, 30.0])).round(2).tolist()
    [[0.0, 4.0], [30.0, 4.0]]
    """
    from scipy.optimize import minimize

    if len(circles) < 2:
        raise InputError("matched filter: fewer than two detections give circles; no route can be drawn")
    weights = regularization or Regularization()
    spacing = float(nodes[1] - nodes[0])
    at_circles, at_nodes = (torch.from_numpy(basis.at(place)) for place in (distance, nodes))
    slope = torch.from_numpy(basis.at(distance, 1))
    center, radius, sigma = (torch.from_numpy(values) for values in (circles.center, circles.radius, circles.sigma))

    pins = torch.from_numpy(basis.at(np.zeros(0) if anchor_distance is None else anchor_distance))
    known = torch.tensor([[a.x, a.y] for a in anchors], dtype=torch.float64).reshape(-1, 2)
    known_sigma = torch.tensor([[a.sigma_xy] for a in anchors], dtype=torch.float64).reshape(-1, 1)

    def off(coefficients: Tensor) -> Tensor:
        return ((at_circles @ coefficients - center).norm(dim=1) - radius) / sigma

    def ahead(coefficients: Tensor) -> Tensor:
        return axial(at_circles @ coefficients - center, unit(slope @ coefficients)) / BESIDE

    def cost(flat: Array) -> tuple[float, Array]:
        coefficients = torch.from_numpy(flat.reshape(start.shape)).requires_grad_()
        pull = soft(off(coefficients)).sum() + soft(ahead(coefficients)).sum()
        held = anchor_loss(pins @ coefficients, known, known_sigma)
        total = pull + held + weights.loss(at_nodes @ coefficients, spacing, gauge_length)
        (gradient,) = torch.autograd.grad(total, coefficients)
        return total.item(), gradient.numpy().ravel()

    first = start.ravel()
    bounds = list(zip(first - REACH, first + REACH, strict=True))
    options = {"maxiter": ITERATIONS, "maxfun": 3 * ITERATIONS}
    end = minimize(cost, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    coefficients = end.x.reshape(start.shape)
    residual = off(torch.from_numpy(coefficients)).numpy()
    return CircleFit(basis, coefficients, float(end.fun), residual, bool(end.success))


def soft(u: Tensor) -> Tensor:
    """Square of a residual in standard deviations that grows only linearly beyond two.

    >>> [round(value, 2) for value in soft(torch.tensor([0.1, 2.0, 100.0])).tolist()]
    [0.01, 3.31, 392.08]
    """
    return 2 * SOFT**2 * ((1 + (u / SOFT) ** 2).sqrt() - 1)


def geometric_route(
    record: DASRecord,
    passes: Sequence[Pass],
    found: Initialization,
    *,
    anchors: Sequence[Anchor] = (),
    depth: float | None = None,
    poisson_ratio: float = 0.25,
    degree: int | None = None,
    regularization: Regularization | None = None,
) -> Array:
    """The paper's first route: a curve along the circles of all passes, on the side that costs less.

    Parameters
    ----------
    record, passes : the survey
    found : what the matched filter saw of it, `solver.matched_filter.initialize(record, passes)`
    anchors : known points of the fiber; without any of them a single lane leaves both sides open
    depth : believed, m, for which the circles hold and at which the route lies; if not given, the anchors' mean, or
        0.9 without anchors
    poisson_ratio : believed, of the ground
    degree : of a polynomial route; points half a gauge length apart if not given
    regularization : weights of the shape terms; the defaults if not given

    Returns
    -------
    x, y, z of the active channels [channel, 3], m

    Raises
    ------
    InputError
        If no vehicle was seen in the active channels.
    """
    if depth is None:
        depth = float(np.mean([a.z for a in anchors])) if anchors else BELIEVED_DEPTH
    ground = {"depth": depth, "gauge_length": record.gauge_length, "poisson_ratio": poisson_ratio}
    curves = [coupling_curve(one.vehicle_class, **ground) for one in passes]
    circles = circles_of(found.detections, curves, record.channel_spacing, found.clock_ahead)
    distance = record.channel_spacing * circles.channel
    s: Array = record.channel_spacing * found.channel.astype(np.float64)
    count = max(3, round((s[-1] - s[0]) / (record.gauge_length / 2)) + 1)
    nodes: Array = np.linspace(s[0], s[-1], count, dtype=np.float64)
    basis: Basis = Polyline(nodes) if degree is None else PolynomialBasis(s[0], s[-1], degree)
    x0, slope = found.x_of_channel
    fits = []
    for side in (1, -1):
        line = np.column_stack([x0 + slope * nodes / record.channel_spacing, np.zeros(len(nodes))])
        line[:, 1] = np.median(circles.center[:, 1] + side * circles.radius)
        start = np.asarray(np.linalg.lstsq(basis.at(nodes), line, rcond=None)[0], np.float64)
        fits.append(
            fit_circles(
                circles,
                distance,
                basis,
                start,
                nodes,
                gauge_length=record.gauge_length,
                regularization=regularization,
                anchors=anchors,
                anchor_distance=record.channel_spacing * np.array([a.channel for a in anchors], np.float64),
            )
        )
    best = min(fits, key=lambda fit: fit.cost)
    return np.column_stack([best.at(s), np.full(len(s), depth)])


def polynomial_route(points: Array, distance: Array, degree: int) -> Array:
    """Least-squares polynomial of a route by its length: x, y (and z) each a polynomial of `degree`.

    Parameters
    ----------
    points : [point, axis], m
    distance : along the fiber [point], m
    degree : 1 is a straight line; must be below the number of points

    Returns
    -------
    [point, axis], m

    Raises
    ------
    InputError
        If there are not more points than the degree.

    Examples
    --------
    >>> s = np.linspace(0, 100, 51)
    >>> bent = np.column_stack([s, 4 + 1e-3 * (s - 50) ** 2])
    >>> noisy = bent + np.random.default_rng(0).normal(0, 0.2, bent.shape)
    >>> bool(np.abs(polynomial_route(noisy, s, 2) - bent).max() < 0.15)
    True
    """
    if len(points) <= degree:
        raise InputError(f"polynomial route: {len(points)} points for degree {degree}; give more points or less degree")
    matrix = PolynomialBasis(float(distance[0]), float(distance[-1]), degree).at(distance)
    return matrix @ np.linalg.lstsq(matrix, points, rcond=None)[0]
