"""What the priors cost: closed forms of routes that bend, slope and stretch evenly, whatever the knots are."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.cable.fiber import SplineBasis
from solver.fit.numbers import Numbers
from solver.fit.parameter_prior import OWN_DEPTH, ParameterPrior
from solver.fit.prior import FREEDOM, PATCH, SHALLOW, SHALLOW_SD, Prior, anchor_rows, shape_rows
from solver.fit.state import State
from solver.load.wheel_layout import layout_of
from solver.signal_path.traffic import Vehicles
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass

LENGTH = 60.0
#: A prior that knows nothing of a route's shape, and where the fiber is so deep that the surface does not count.
NOTHING = Prior(depth=(20.0, 1e9), depth_slope=1e9, curvature=1e9, depth_curvature=1e9, stretch=1e9)
DEEP = 20.0
KNOTS = {
    "far apart": SplineBasis.even(0.0, LENGTH, 20.0),
    "close": SplineBasis.even(0.0, LENGTH, 2.5),
    "uneven": SplineBasis.of([0.0, 10.0, 11.0, 13.0, 30.0, LENGTH]),
}


def of_route(basis: SplineBasis, place: Callable[[np.ndarray], np.ndarray]) -> torch.Tensor:
    """Coefficients of a route whose coordinates [place, 3] are polynomials of the distance, at most cubic: exact."""
    s = np.linspace(0.0, basis.stop, 4 * basis.size)
    return torch.from_numpy(np.linalg.lstsq(basis.at(s), place(s), rcond=None)[0])


def places(s: np.ndarray, x: object = 0.0, y: object = 0.0, z: object = 0.0) -> np.ndarray:
    return np.column_stack([s + x, y + 0 * s, DEEP + z + 0 * s])


@pytest.mark.parametrize("basis", KNOTS.values(), ids=KNOTS)
@pytest.mark.parametrize(
    ("name", "bend", "tails"),
    [
        ("curvature", lambda s, size: {"y": size * s**2 / 2}, (FREEDOM + 2) / FREEDOM),
        ("depth_curvature", lambda s, size: {"z": size * s**2 / 2}, (FREEDOM + 1) / FREEDOM),
        ("depth_slope", lambda s, size: {"z": size * s}, (FREEDOM + 1) / FREEDOM),
        ("stretch", lambda s, size: {"x": size * s}, 1.0),
    ],
)
def test_a_route_s_shape_costs_as_one_value_in_each_patch(basis: SplineBasis, name: str, bend, tails: float) -> None:
    """Each `PATCH` of fiber costs (size / sd)^2, times what a Student t is sharper at its mode, on any knots."""
    prior = replace(NOTHING, **{name: getattr(Prior(), name)})
    size = 0.05 * getattr(prior, name)
    route = of_route(basis, lambda s: places(s, **bend(s, size)))
    cost = float((shape_rows(basis, prior, route).residual ** 2).sum())
    assert cost == pytest.approx(tails * 0.05**2 * LENGTH / PATCH, rel=0.02)


def test_a_sharp_bend_costs_by_the_logarithm_of_a_student_t() -> None:
    """100 sds of curvature cost 10 ln 2 more than 50 do, not 7,500, in each of a patch's share of places."""
    basis, prior = SplineBasis.even(0.0, LENGTH, 2 * PATCH), replace(NOTHING, curvature=1e-5)
    costs = []
    for size in (1e-3, 2e-3):
        route = of_route(basis, lambda s, size=size: places(s, y=size * s**2 / 2))
        costs.append(float((shape_rows(basis, prior, route).residual ** 2).sum()))
    count = 2 * basis.intervals + 1
    assert costs[1] - costs[0] == pytest.approx(count * (FREEDOM + 2) * np.log(4.0), rel=0.01)


def test_the_surface_pushes_and_a_fiber_as_deep_as_usual_does_not_feel_it() -> None:
    basis = KNOTS["far apart"]
    count = 2 * basis.intervals + 1

    def pushed(depth: float) -> float:
        route = of_route(basis, lambda s: places(s, z=depth - DEEP))
        return float((shape_rows(basis, NOTHING, route).residual ** 2).sum() / count) ** 0.5

    assert pushed(2 * SHALLOW) < 0.01 and pushed(0.01 * SHALLOW) > 100
    # At the least depth half of what one is short of it counts, in its standard deviations.
    assert pushed(SHALLOW) == pytest.approx(np.log(2.0), rel=1e-3)
    step = 0.1 * SHALLOW_SD
    assert pushed(SHALLOW - step) - pushed(SHALLOW + step) == pytest.approx(0.1, rel=0.02)


def test_an_anchor_counts_each_axis_by_its_own_sigma() -> None:
    basis = KNOTS["close"]
    route = of_route(basis, places)
    anchor = Anchor("pit", 31, 30.0 + 0.6, 0.8, DEEP + 0.3, 0.2, 0.1)
    none = torch.zeros(1, 0, dtype=torch.float64)
    rows = anchor_rows(basis, [anchor], torch.tensor([30.0], dtype=torch.float64), none, route)
    np.testing.assert_allclose(rows.residual, [-3.0, -4.0, -3.0], atol=1e-6)


def known_of(basis: SplineBasis, passes: Sequence[Pass]) -> ParameterPrior:
    """The prior of a survey without anchors and effects."""
    return ParameterPrior(basis, Prior(), passes, [], np.zeros(0), Numbers.joined([]))


def test_a_long_route_has_a_mean_depth_of_its_own_every_so_often() -> None:
    """Three times as long as one is meant for: three depths that are a sd off each, not one."""
    basis = SplineBasis.even(0.0, 3 * OWN_DEPTH, 20.0)
    route = of_route(basis, lambda s: places(s, z=sum(Prior().depth) - DEEP))
    cost = sum(float((one.rows.residual**2).sum()) for one in known_of(basis, []).shape(route))
    assert cost == pytest.approx(3.0, abs=0.01)


def test_each_vehicle_s_number_is_as_uncertain_as_its_kind(survey) -> None:
    """Those of the wheels are its own or its class's; a track that may be off as a whole adds that in squares."""
    one, other = survey.passes
    seen = [replace(one, wheelbase=(2.8, 0.07)), replace(other, offset=1.2)]
    known = known_of(KNOTS["close"], seen)
    sd = {name: known.sd[known.layout[name]] for name in ("along", "wheelbase", "front_share")}
    np.testing.assert_allclose(sd["along"], [0.5, (0.5**2 + 1.2**2) ** 0.5])
    assert float(sd["wheelbase"][0]) == 0.07
    assert sd["front_share"].tolist() == [layout_of(each.vehicle_class, None).front_share_sd for each in seen]


def test_a_state_one_sd_from_its_means_costs_one_for_each_number(survey) -> None:
    known = known_of(KNOTS["close"], survey.passes)
    state = State.of(known.mean, known.layout, Vehicles.of(survey.passes))
    for name in ("wheelbase", "front_share", "poisson_ratio"):
        where = known.layout[name]
        moved = known.mean.clone()
        moved[where] += torch.where(known.free, known.sd, 0.0)[where]
        cost = known.cost(state.moved(moved)) - known.cost(state)
        assert cost == pytest.approx(float(known.free[where].sum()))
