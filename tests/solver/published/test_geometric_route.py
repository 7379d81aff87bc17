"""The geometric route on circles made by hand, and on simulated surveys beside the truth."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import record_of

from solver.cable.curves import PolynomialBasis, hausdorff
from solver.cable.fiber import SplineBasis
from solver.published.circles import Circles
from solver.published.geometric_route import CircleFit, CircleProblem, fit_circles, geometric_route, polynomial_route
from solver.published.network import Polyline
from solver.published.regularizers import Regularization
from solver.simulator import Scenario, simulate
from solver.start.initialization import Initialization, initialize
from solver.survey.anchors import Anchor
from solver.survey.das import DASRecord
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

S = np.arange(0.0, 101.0, 2.0)
NODES = np.linspace(0.0, 100.0, 21)
BASES = {
    "points": Polyline(NODES),
    "polynomial": PolynomialBasis(0.0, 100.0, 5),
    "spline": SplineBasis.even(0, 100, 20),
}


def truth(s: np.ndarray) -> np.ndarray:
    return np.column_stack([s, 4.0 + 0.6 * np.sin(s / 25)])


def loci(rng: np.random.Generator, noise: float = 0.1, mistaken: int = 0) -> Circles:
    """Circles about two lanes, 0 and -3.5 m, some of them of another vehicle."""
    s = np.concatenate([S, S])
    center = np.column_stack([s, np.repeat([0.0, -3.5], len(S))])
    radius = np.linalg.norm(truth(s) - center, axis=1) + noise * rng.normal(size=len(s))
    radius[rng.permutation(len(s))[:mistaken]] += 5.0
    return Circles(s, center, radius, np.full(len(s), noise))


def fitted(circles: Circles, name: str, y: float, **settings) -> np.ndarray:
    basis = BASES[name]
    start = np.linalg.lstsq(basis.at(NODES), np.column_stack([NODES, np.full(21, y)]), rcond=None)[0]
    fit = fit_circles(CircleProblem(circles, circles.channel, basis, NODES, 10.0, **settings), start)
    assert fit.converged
    return fit.at(S)


@pytest.mark.parametrize("name", BASES)
def test_every_basis_finds_the_curve_in_noise(name: str):
    route = fitted(loci(np.random.default_rng(0)), name, 2.0)
    assert np.abs(route - truth(S))[:, 1].max() < 0.15


def test_mistaken_circles_hardly_pull():
    route = fitted(loci(np.random.default_rng(1), mistaken=10), "points", 2.0)
    assert np.abs(route - truth(S))[:, 1].max() < 0.25


def from_either_side(circles: Circles) -> list[CircleFit]:
    starts = [np.column_stack([NODES, np.full(21, y)]) for y in (4.0, -7.5)]
    problem = CircleProblem(circles, circles.channel, BASES["points"], NODES, 10.0)
    return [fit_circles(problem, start) for start in starts]


def test_one_lane_cannot_tell_the_side_and_two_can():
    both = loci(np.random.default_rng(2))
    right, left = from_either_side(both)
    np.testing.assert_allclose(left.at(S), right.at(S), atol=1e-2)
    half = slice(0, len(S))
    one = Circles(both.channel[half], both.center[half], both.radius[half], both.sigma[half])
    right, left = from_either_side(one)
    np.testing.assert_allclose(left.at(S), right.at(S) * [1, -1], atol=1e-2)
    assert left.cost == pytest.approx(right.cost, rel=1e-4)


def test_an_anchor_decides_the_side_and_holds_the_route():
    both = loci(np.random.default_rng(2))
    half = slice(0, len(S))
    one = Circles(both.channel[half], both.center[half], both.radius[half], both.sigma[half])
    place = truth(np.array([50.0]))[0] * [1, -1]
    anchor = Anchor("manhole", 50.0, *place, 0.9, 0.01, 0.05)
    start = np.column_stack([NODES, np.full(21, -2.0)])
    problem = CircleProblem(one, one.channel, BASES["points"], NODES, 10.0)
    fit = fit_circles(replace(problem, anchors=[anchor], anchor_distance=np.array([50.0])), start)
    assert np.linalg.norm(fit.at(np.array([50.0]))[0] - place) < 0.03
    assert np.abs(fit.at(S) - truth(S) * [1, -1])[:, 1].max() < 0.2


def test_stiffer_routes_are_straighter():
    circles = loci(np.random.default_rng(3), noise=0.4)
    bends = []
    for curvature in (0.2, 0.0005):
        route = fitted(circles, "points", 2.0, regularization=Regularization(np.inf, 0.01, curvature))
        bends.append(np.abs(np.diff(route[:, 1], 2)).sum())
    assert bends[1] < 0.2 * bends[0]


def test_one_circle_is_too_few():
    one = Circles(S[:1], truth(S[:1]), np.ones(1), np.ones(1))
    with pytest.raises(InputError, match="fewer than two"):
        fit_circles(CircleProblem(one, S[:1], BASES["points"], NODES, 10.0), truth(NODES))


Survey = tuple[DASRecord, list[Pass], Initialization, np.ndarray]


@pytest.fixture(scope="module", params=[0, 5])
def survey(request: pytest.FixtureRequest) -> Survey:
    street = simulate(Scenario(seed=request.param, passes=4, snr_db=20.0, channels=200))
    record = record_of(street)
    passes = smooth_passes(street.trajectories, record)
    return record, passes, initialize(record, passes), street.route


@pytest.mark.parametrize("degree", [None, 3])
def test_where_the_depth_is_known_the_first_route_is_within_a_meter(survey: Survey, degree: int | None):
    record, passes, found, route = survey
    true = route[found.channel]
    first = geometric_route(record, passes, found, depth=float(true[:, 2].mean()), degree=degree)
    assert first.shape == true.shape
    inner = slice(10, -10)
    assert hausdorff(first[inner, :2], true[inner, :2]) < 0.6


def test_the_depth_comes_from_the_anchors(survey: Survey):
    record, passes, found, route = survey
    at = found.channel[[10, -10]]
    anchors = [Anchor(str(number), float(number), *route[number], 0.05, 0.05) for number in at]
    first = geometric_route(record, passes, found, anchors=anchors)
    np.testing.assert_allclose(first[:, 2], route[at, 2].mean())
    assert hausdorff(first[10:-10, :2], route[found.channel][10:-10, :2]) < 0.5
    assert geometric_route(record, passes, found)[0, 2] == 0.9


def test_polynomials_of_a_route():
    cubic = np.column_stack([S, 4 + 1e-5 * (S - 40) ** 3, 0.9 + 0.001 * S])
    np.testing.assert_allclose(polynomial_route(cubic, S, 3), cubic, atol=1e-9)
    line = polynomial_route(cubic, S, 1)
    np.testing.assert_allclose(np.diff(line, 2, axis=0), 0.0, atol=1e-9)
    with pytest.raises(InputError, match="more points or less degree"):
        polynomial_route(cubic[:3], S[:3], 3)
