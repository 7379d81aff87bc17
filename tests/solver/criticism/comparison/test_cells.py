"""Where the nearest vehicle is, which lanes there are, and how loud the noise is."""

from types import SimpleNamespace

import numpy as np
import pytest

from solver.criticism.comparison.cells import (
    ENOUGH,
    LANE_WIDTH,
    Approach,
    approach_of,
    lanes,
    noise_of,
    on_fiber,
    rows_between,
)

RNG = np.random.default_rng(12)
TURN = np.deg2rad(30.0)
ALONG, ACROSS = np.array([np.cos(TURN), np.sin(TURN)]), np.array([-np.sin(TURN), np.cos(TURN)])


@pytest.mark.parametrize(("forth", "aside"), [(2.25, 3.0), (-4.0, -1.0), (30.0, 0.5)])
def test_the_place_along_a_straight_fiber_is_the_foot_of_the_perpendicular(forth, aside):
    """Also beyond its ends, and whatever way it runs."""
    distance = np.arange(0.0, 21.0) + 100
    route = (distance - 100)[:, None] * ALONG + [7.0, -3.0]
    position = forth * ALONG + aside * ACROSS + [7.0, -3.0]
    found = on_fiber(position[None], route, distance)
    assert found.along[0] == pytest.approx(100 + forth)
    np.testing.assert_allclose(found.offset[0], -aside * ACROSS, atol=1e-12)


def vehicle(rows: np.ndarray, x: np.ndarray, y: float, speed: float) -> SimpleNamespace:
    position = np.stack([x, np.full(len(x), y)], 1)
    return SimpleNamespace(rows=rows, position=position, velocity=np.tile([speed, 0.0], (len(x), 1)))


@pytest.fixture
def run() -> SimpleNamespace:
    """A fiber along y = 4; one vehicle goes up the channels at y = 0, another down at y = 7."""
    channel = np.arange(10, 31)
    route = np.stack([np.arange(21.0), np.full(21, 4.0), np.ones(21)], 1)
    result = SimpleNamespace(
        channel=channel, fitted_channel=channel[2:-2], distance=np.arange(21.0), route=route, samples=np.arange(50, 60)
    )
    up = vehicle(np.arange(48, 56), np.arange(8) * 2.0, 0.0, 10.0)
    down = vehicle(np.arange(53, 58), 18.0 - np.arange(5) * 3.0, 7.0, -15.0)
    return SimpleNamespace(result=result, passes=[up, down])


def test_the_nearest_vehicle_owns_a_cell(run):
    found = approach_of(run)
    fitted = np.arange(2.0, 19.0)
    for row, sample in enumerate(run.result.samples):
        gaps = []
        for one in run.passes:
            at = np.flatnonzero(one.rows == sample)
            place = one.position[at[0]] if len(at) else np.full(2, np.inf)
            gaps.append(np.hypot(fitted - place[0], 4 - place[1]))
        np.testing.assert_allclose(found.gap[row], np.minimum(*gaps))
        owner = np.where(np.isfinite(found.gap[row]), np.argmin(gaps, 0), -1)
        assert found.owner[row].tolist() == owner.tolist()
    assert np.isnan(found.ahead[found.owner < 0]).all() and (found.owner[-1] == -1).all()


def test_ahead_is_positive_where_the_vehicle_is_heading(run):
    found = approach_of(run)
    first = found.ahead[0]  # only the first vehicle, at x = 4
    np.testing.assert_allclose(first, np.arange(2.0, 19.0) - 4)
    last = found.ahead[7]  # only the second, at x = 6, which goes down
    np.testing.assert_allclose(last, 6 - np.arange(2.0, 19.0))
    assert found.forward.tolist() == [True, False]
    assert set(found.speed[~np.isnan(found.speed)].tolist()) == {10.0, 15.0}


def test_the_fiber_is_right_of_travel_for_both(run):
    """It lies at larger y: to the right of +x, which the first goes; the second goes the other way at a larger y."""
    np.testing.assert_allclose(approach_of(run).lateral, [4.0, 3.0])


def test_rows_of_a_pass_are_those_that_were_fitted(run):
    rows, inside = rows_between(run.result.samples, run.passes[0])
    assert rows.tolist() == [0, 1, 2, 3, 4, 5] and inside.tolist() == [2, 3, 4, 5, 6, 7]


def test_lanes_are_of_one_direction_and_a_width_apart():
    lateral = np.array([2.0, 2.0 + 0.9 * LANE_WIDTH, 9.0, -3.0, 2.1])
    forward = np.array([True, True, True, False, False])
    nothing = np.zeros((0, 0))
    number, names = lanes(Approach(nothing.astype(int), nothing, nothing, nothing, lateral, forward))
    assert number[0] == number[1] and len(set(number.tolist())) == 4 == len(names)
    assert names[number[2]] == "up the channels, fiber 9.0 m right"
    assert names[number[3]] == "down the channels, fiber 3.0 m left"


def test_a_vehicle_that_nobody_saw_hardly_raises_the_level():
    """It was sixteen times its share, 2.6 here."""
    residual = 1.3 * RNG.normal(size=(3000, 12))
    residual[1000:1300] += 200
    every = np.ones(residual.shape, bool)
    level, spread = noise_of(residual, every, every, None)
    assert ((level > 0.93 * 1.69) & (level < 1.2 * 1.69)).all()
    assert 1.0 <= spread < 1.6


def test_a_louder_channel_has_a_level_of_its_own_but_only_as_far_as_it_was_seen():
    residual = RNG.normal(size=(4000, 10))
    residual[:, 3] *= 1.5
    every = np.ones(residual.shape, bool)
    level, _ = noise_of(residual, every, every, None)
    assert level[3] > 1.8 and np.delete(level, 3).max() < 1.2
    seldom = every.copy()
    seldom[:, 3] = False
    seldom[:20, 3] = True
    assert noise_of(residual, every, seldom, None)[0][3] < 1.4


@pytest.mark.parametrize(("floor", "level"), [(None, 1.0), (0.8, 1.0), (1.2, 1.2)])
def test_without_quiet_cells_the_floor_of_the_fit_serves(floor, level):
    residual = np.ones((ENOUGH, 2))
    far = np.zeros(residual.shape, bool)
    found, spread = noise_of(residual, ~far, far, floor)
    assert found.tolist() == [level, level] and spread == 1.0
