import numpy as np
import pytest

from solver.start.coupling_curve import CouplingCurve, coupling_curve
from solver.start.detections import Detections
from solver.start.initialization import curves_by_depth
from solver.start.lateral import Widths, binned_widths, cheapest_path, locate_sides, relative_scale_error
from solver.start.wavelets import SCALES, bank, best_scale

BINS = 9
CHANNEL = 5.0 + 10.0 * np.arange(BINS)


def curves(*classes: str) -> list[dict[float, CouplingCurve]]:
    return [curves_by_depth(kind, 0.9, 10.0, 0.25) for kind in classes]


def widths_of(
    y: float | np.ndarray, lanes: list[float], kinds: list[str], error: float = 0.0, depth: float = 0.9
) -> Widths:
    """Widths that passes in `lanes` would show of a fiber at y."""
    rng = np.random.default_rng(0)
    lane = np.repeat(np.array(lanes)[:, None], BINS, axis=1)
    width = np.array(
        [
            coupling_curve(kind, depth=depth, gauge_length=10.0, poisson_ratio=0.25).width_at(y - row)
            for kind, row in zip(kinds, lane, strict=True)
        ]
    )
    width = np.broadcast_to(width, lane.shape) * (1 + error * rng.normal(size=lane.shape))
    return Widths(CHANNEL, lane, width, 0.05 * width)


@pytest.mark.parametrize("y", [-9.0, -7.5, 4.0, 5.0, 8.0])
def test_two_lanes_tell_the_side(y: float):
    kinds = ["car", "van", "car", "bus"]
    sides = locate_sides(widths_of(y, [0.0, -3.5, 0.2, -3.4], kinds, 0.02), curves(*kinds), 1.0)
    assert np.abs(sides.y - y).max() < 1.0
    assert sides.evidence > 3
    # The lanes' middle is at -1.6 to -1.7 m.
    assert (sides.mirror < -1.6).all() if y > 0 else (sides.mirror > -1.8).all()


def test_one_lane_cannot_tell_the_side():
    sides = locate_sides(widths_of(5.0, [0.0, 0.0], ["car", "car"]), curves("car", "car"), 1.0)
    np.testing.assert_allclose(np.abs(sides.y), 5.0, atol=0.5)
    np.testing.assert_allclose(sides.mirror, -sides.y, atol=0.2)
    assert sides.evidence < 0.2


@pytest.mark.parametrize("depth", [0.675, 1.125])
def test_a_depth_other_than_the_prior_mean_does_no_harm(depth: float):
    kinds = ["car"] * 6
    sides = locate_sides(widths_of(4.5, [0.0, -3.5, 0.1, -3.4, 0.0, -3.6], kinds, 0.01, depth), curves(*kinds), 1.0)
    assert np.abs(sides.y - 4.5).max() < 0.7
    assert sides.depth_factor == pytest.approx(depth / 0.9)


def test_a_fiber_that_crosses_the_road_is_followed():
    kinds = ["car", "van"] * 3
    y = np.array([5.0, 5.0, 5.0, 4.5, -1.7, -7.5, -8.5, -8.5, -8.5])
    sides = locate_sides(widths_of(y, [0.0, -3.5, 0.1, -3.4, 0.0, -3.6], kinds, 0.01), curves(*kinds), 1.0)
    assert np.abs(sides.y - y)[[0, 1, 2, 6, 7, 8]].max() < 1.5


def test_passes_not_seen_in_a_bin_cost_nothing():
    kinds = ["car", "car", "car", "car"]
    widths = widths_of(5.0, [0.0, -3.5, 0.0, -3.5], kinds, 0.01)
    for name in ("lane", "width", "sigma"):
        getattr(widths, name).setflags(write=True)
        getattr(widths, name)[:2, :4] = np.nan
        getattr(widths, name)[:, 6] = np.nan
    assert np.abs(locate_sides(widths, curves(*kinds), 1.0).y - 5.0).max() < 1.0


def test_cheapest_path_is_the_best_of_all_paths():
    rng = np.random.default_rng(2)
    cost, price = rng.uniform(size=(4, 5)), 0.3
    every = np.stack(np.meshgrid(*[np.arange(5)] * 4, indexing="ij"), -1).reshape(-1, 4)
    totals = cost[np.arange(4), every].sum(1) + price * np.abs(np.diff(every, axis=1)).sum(1)
    path, total = cheapest_path(cost, price)
    assert total == pytest.approx(totals.min())
    np.testing.assert_array_equal(path, every[totals.argmin()])


def test_scale_error_is_the_one_that_noise_makes():
    rng = np.random.default_rng(3)
    wavelets = bank(SCALES)
    shape = 20.0 * bank([8.0])[:, 0]
    pad = (len(wavelets) - len(shape)) // 2
    noisy = np.pad(shape, pad) + rng.normal(size=(400, len(wavelets)))
    spread = np.log(best_scale(noisy @ wavelets, SCALES)).std()
    assert spread == pytest.approx(relative_scale_error() / 20.0, rel=0.15)


def test_widths_of_stacked_profiles():
    wavelets = bank(SCALES)
    pad = (len(wavelets) - len(bank([9.0]))) // 2
    profile = np.pad(bank([9.0])[:, 0], pad) @ wavelets
    count = 6
    none = np.zeros(count)
    seen = Detections(
        none.astype(int), none, none - 3.5, none, np.arange(count) * 4.0, none, none + 40, np.tile(profile, (count, 1))
    )
    widths = binned_widths(np.array([-0.5, 9.5, 20.5, 29.5]), [seen], SCALES, 1.021)
    np.testing.assert_allclose(widths.width[0, :2], 9.0 * 1.021, rtol=0.01)
    assert np.isnan(widths.width[0, 2])
    np.testing.assert_allclose(widths.lane[0, :2], -3.5)
