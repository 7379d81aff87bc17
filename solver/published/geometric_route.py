"""The smooth curve that touches the circles: L-BFGS-B with angle, length and curvature terms."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.cable.curves import PolynomialBasis
from solver.cable.fiber import Basis, axial, unit
from solver.published.circles import Circles, circles_of
from solver.published.network import Polyline
from solver.published.regularizers import Regularization, anchor_loss
from solver.start.coupling_curve import coupling_curve
from solver.start.initialization import Initialization
from solver.survey.anchors import Anchor
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

Array = NDArray[np.float64]

REACH = 25.0  # m that a node may move from its start
ASSUMED_DEPTH = 0.9  # m
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


@dataclass(frozen=True)
class CircleProblem:
    """Circles to be touched by a smooth route.

    Parameters
    ----------
    circles : loci
    distance : of each circle's channel along the fiber [circle], m
    basis : `Polyline` for a route of points, `PolynomialBasis` or `SplineBasis`
    nodes : distance of the points where shape is judged [node], m, evenly spaced
    gauge_length : m
    regularization : weights of the shape terms
    anchors : known points
    anchor_distance : where along the fiber they are [anchor], m
    """

    circles: Circles
    distance: Array
    basis: Basis
    nodes: Array
    gauge_length: float
    regularization: Regularization = field(default_factory=Regularization)
    anchors: Sequence[Anchor] = ()
    anchor_distance: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def matrices(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Basis at the circles, its slope there, at the nodes and at the anchors."""
        basis, s = self.basis, self.distance
        values = basis.at(s), basis.at(s, 1), basis.at(self.nodes), basis.at(self.anchor_distance)
        at_circles, slope, at_nodes, at_anchors = (torch.from_numpy(value) for value in values)
        return at_circles, slope, at_nodes, at_anchors

    def off(self, coefficients: Tensor) -> Tensor:
        """(|r - v| - R) / sd [circle]."""
        center, radius, sigma = (torch.from_numpy(getattr(self.circles, n)) for n in ("center", "radius", "sigma"))
        return ((self.matrices[0] @ coefficients - center).norm(dim=1) - radius) / sigma

    def ahead(self, coefficients: Tensor) -> Tensor:
        """How far the route at a circle's channel is ahead of its vehicle, in standard deviations [circle]."""
        at_circles, slope = self.matrices[:2]
        away = at_circles @ coefficients - torch.from_numpy(self.circles.center)
        return axial(away, unit(slope @ coefficients)) / BESIDE

    def cost(self, coefficients: Tensor) -> Tensor:
        """What is minimized, see `fit_circles`."""
        known = torch.tensor([[a.x, a.y] for a in self.anchors], dtype=torch.float64).reshape(-1, 2)
        sigma = torch.tensor([[a.sigma_xy] for a in self.anchors], dtype=torch.float64).reshape(-1, 1)
        held = anchor_loss(self.matrices[3] @ coefficients, known, sigma)
        spacing = float(self.nodes[1] - self.nodes[0])
        shape = self.regularization.loss(self.matrices[2] @ coefficients, spacing, self.gauge_length)
        return soft(self.off(coefficients)).sum() + soft(self.ahead(coefficients)).sum() + held + shape


def fit_circles(problem: CircleProblem, start: Array) -> CircleFit:
    """Fit a smooth route to circles with L-BFGS-B (Byrd, Lu, Nocedal and Zhu 1995); gradients by autodiff.

    minimize  sum over circles c of rho((|r(s_c) - v_c| - R_c) / sd_c) + rho((r(s_c) - v_c) . t(s_c) / 1 m)
              + angle, length and curvature of r at the nodes, and anchors (`solver.published.regularizers`),
    rho(u) = 2 k^2 (sqrt(1 + u^2 / k^2) - 1), k = 2: a square for good circles, |u| for mistaken ones. The second
    term, with t the direction of the route, lets it touch its circles and not slide along them.

    Parameters
    ----------
    problem : circles and what a route is like
    start : coefficients [coefficient, 2], m; they decide on which side of the lanes the route ends

    Raises
    ------
    InputError
        If there are fewer than two circles.

    Examples
    --------
    >>> s = np.arange(0.0, 61.0, 5.0)
    >>> lane = np.column_stack([s, np.zeros(13)])
    >>> loci = Circles(s, lane, np.full(13, 4.0), np.full(13, 0.1))
    >>> fit = fit_circles(CircleProblem(loci, s, Polyline(s), s, 10.0), lane + np.array([0.0, 2.0]))
    >>> fit.at(np.array([0.0, 30.0])).round(2).tolist()
    [[0.0, 4.0], [30.0, 4.0]]
    """
    from scipy.optimize import minimize

    if len(problem.circles) < 2:
        raise InputError("matched filter: fewer than two detections give circles; no route can be drawn")

    def cost(flat: Array) -> tuple[float, Array]:
        coefficients = torch.from_numpy(flat.reshape(start.shape)).requires_grad_()
        total = problem.cost(coefficients)
        (gradient,) = torch.autograd.grad(total, coefficients)
        return total.item(), gradient.numpy().ravel()

    first = start.ravel()
    bounds = list(zip(first - REACH, first + REACH, strict=True))
    options = {"maxiter": ITERATIONS, "maxfun": 3 * ITERATIONS}
    end = minimize(cost, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    coefficients = end.x.reshape(start.shape)
    residual = problem.off(torch.from_numpy(coefficients)).numpy()
    return CircleFit(problem.basis, coefficients, float(end.fun), residual, bool(end.success))


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
    found : what the matched filter saw of it, `solver.start.initialization.initialize(record, passes)`
    anchors : known points of the fiber; without any of them a single lane leaves both sides open
    depth : prior mean, m, for which the circles hold and at which the route lies; if not given, the anchors' mean, or
        0.9 without anchors
    poisson_ratio : prior mean of the ground's
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
        depth = float(np.mean([a.z for a in anchors])) if anchors else ASSUMED_DEPTH
    ground = {"depth": depth, "gauge_length": record.gauge_length, "poisson_ratio": poisson_ratio}
    curves = [coupling_curve(one.vehicle_class, **ground) for one in passes]
    spacing = record.channel_spacing
    circles = circles_of(found.detections, curves, spacing, found.clock_ahead)
    s: Array = spacing * found.channel.astype(np.float64)
    nodes: Array = np.linspace(s[0], s[-1], max(3, round((s[-1] - s[0]) / (record.gauge_length / 2)) + 1))
    problem = CircleProblem(
        circles,
        spacing * circles.channel,
        Polyline(nodes) if degree is None else PolynomialBasis(float(s[0]), float(s[-1]), degree),
        nodes,
        record.gauge_length,
        regularization or Regularization(),
        anchors,
        spacing * np.array([a.channel for a in anchors], np.float64),
    )
    best = min((fit_circles(problem, start) for start in beside_lanes(problem, found, spacing)), key=attrgetter("cost"))
    return np.column_stack([best.at(s), np.full(len(s), depth)])


def beside_lanes(problem: CircleProblem, found: Initialization, spacing: float) -> list[Array]:
    """Coefficients [coefficient, 2] of the two straight routes beside the lanes, right and left, to begin from."""
    x0, slope = found.x_of_channel
    lines = []
    for side in (1, -1):
        y = np.median(problem.circles.center[:, 1] + side * problem.circles.radius)
        lines.append(np.column_stack([x0 + slope * problem.nodes / spacing, np.full(len(problem.nodes), y)]))
    matrix = problem.basis.at(problem.nodes)
    return [np.asarray(np.linalg.lstsq(matrix, line, rcond=None)[0], np.float64) for line in lines]


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
