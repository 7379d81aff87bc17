"""The search for regions, on cells written out."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.criticism.comparison.changes import linear
from solver.criticism.comparison.region_search import AHEAD, AROUND, Search, by_pass, groups_of, in_meters
from solver.criticism.comparison.regions import UNITS, Region
from solver.criticism.comparison.windows import Window

RNG = np.random.default_rng(14)
SAMPLES, CHANNELS = 30, 12


def made_pass(name: str, vehicle_class: str = "car", speed: float = 10.0) -> Any:
    return SimpleNamespace(track_id=name, vehicle_class=vehicle_class, speed=speed)


def made_run(*passes: Any) -> Any:
    """Channels 50 to 61 of a fiber along x, two meters apart, of a route that has more."""
    channel = np.arange(48, 64)
    route = np.stack([2.0 * (channel - 48), np.zeros(16), np.zeros(16)], 1)
    result = SimpleNamespace(channel=channel, fitted_channel=np.arange(50, 62), route=route)
    return SimpleNamespace(passes=list(passes), result=result, time=0.5 * np.arange(SAMPLES))


def region(**changes: Any) -> Region:
    base = {"kind": "gain", "passes": ("a",), "every_pass": True, "channels": (50, 55), "x": (4.0, 14.0), "time": None}
    more = {"ahead": None, "amount": 0.1, "sigma": 0.01, "meters": None, "speed": None, "chi2": 40.0, "z": 6.0}
    return Region(**(base | more | changes))


@pytest.fixture
def search() -> Search:
    """Two passes: the first in the first half of the record, up the channels, the second in the rest, down them."""
    owner = np.repeat([0, 1], SAMPLES // 2)[:, None] * np.ones((1, CHANNELS), int)
    ahead = np.arange(CHANNELS) * 2.0 - np.linspace(0, 20, SAMPLES)[:, None]
    approach = SimpleNamespace(owner=owner, ahead=ahead, near=np.abs(ahead) < 12, forward=np.array([True, False]))
    there = np.ones((SAMPLES, CHANNELS), bool)
    field = RNG.normal(size=there.shape) * 10
    cells: Any = SimpleNamespace(
        approach=approach,
        there=there,
        level=np.full(CHANNELS, 1.5),
        spread=2.0,
        floor=1.5,
        gain=field,
        late=0 * field,
        place=0 * field,
        offset=np.ones(there.shape),
        changes={"gain": linear(field)},
        whiten=lambda raw, part: raw,
    )
    groups = [np.array([0, 1]), np.array([0]), np.array([1])]
    return Search(made_run(made_pass("a"), made_pass("b", "bus", -8.0)), cells, groups, 0 * field, there.copy())


def test_passes_may_fail_alike_by_direction_class_or_alone() -> None:
    cells: Any = SimpleNamespace(approach=SimpleNamespace(forward=np.array([True, True, False])))
    run = made_run(made_pass("1"), made_pass("2", "bus"), made_pass("3"))
    found = [tuple(group.tolist()) for group in groups_of(run, cells)]
    assert found == [(0, 1, 2), (0, 1), (0, 2), (0,), (1,), (2,)], "largest first, each once"


def test_of_a_single_pass_there_is_one_group() -> None:
    cells: Any = SimpleNamespace(approach=SimpleNamespace(forward=np.array([False])))
    assert [group.tolist() for group in groups_of(made_run(made_pass("1")), cells)] == [[0]]


def test_values_are_summed_by_pass_and_position_and_negatives_left_out() -> None:
    values = np.array([[1.0, 2.0, 4.0], [8.0, 16.0, 32.0]])
    at = np.array([[0, 1, 1], [1, -1, 0]])
    owner = np.array([[0, 0, 1], [1, 1, -1]])
    assert by_pass(values, at, owner, (2, 2)).tolist() == [[1.0, 2.0], [0.0, 12.0]]


def test_a_window_is_of_its_groups_cells_between_its_positions(search: Search) -> None:
    where = search.within(Window(2, 3, 5, 0.0), search.columns)
    assert where.sum() == SAMPLES // 2 * 3
    assert where[SAMPLES // 2 :, 3:6].all() and not where[: SAMPLES // 2].any()


def test_bins_of_distance_reach_as_far_as_vehicles_do(search: Search) -> None:
    ahead = search.cells.approach.ahead
    inside = (ahead >= -AROUND) & (ahead < AROUND)
    assert (search.bins[~inside] == -1).all()
    at = search.bins[inside]
    assert ((ahead[inside] >= at * AHEAD - AROUND) & (ahead[inside] < (at + 1) * AHEAD - AROUND)).all()


def test_sums_of_a_change_are_score_and_information_of_least_squares(search: Search) -> None:
    search.residual = RNG.normal(size=(SAMPLES, CHANNELS))
    score, information = search.change_sums(search.cells.gain)
    half = slice(0, SAMPLES // 2)
    field, residual = search.cells.gain[half, 4:7], search.residual[half, 4:7]
    assert score[1, 7] - score[1, 4] == pytest.approx((field * residual).sum() / 1.5)
    assert information[1, 7] - information[1, 4] == pytest.approx((field**2).sum() / 1.5)
    np.testing.assert_allclose(score[0], score[1] + score[2])


def test_a_change_is_estimated_and_taken_out_where_it_is(search: Search) -> None:
    noise = 0.1 * RNG.normal(size=(SAMPLES, CHANNELS))
    planted = np.zeros_like(noise)
    planted[: SAMPLES // 2, 4:8] = 0.3 * search.cells.gain[: SAMPLES // 2, 4:8]
    search.residual = noise + planted
    name, window = search.change() or ("", None)
    assert name == "gain" and window is not None
    assert (search.groups[window.group].tolist(), window.first, window.last) == ([0], 4, 7)
    found = search.take_change(name, window)
    column = np.where(planted != 0, search.cells.gain, 0.0)
    expected = float((column * (noise + planted)).sum() / (column**2).sum())
    assert found.amount == pytest.approx(expected) and expected == pytest.approx(0.3, abs=0.01)
    assert found.sigma == pytest.approx((1.5 / (column**2).sum()) ** 0.5)
    np.testing.assert_allclose(search.residual, noise + planted - expected * column, atol=1e-12)
    assert found.chi2 == pytest.approx(((noise + planted) ** 2).sum() - (search.residual**2).sum())
    assert (found.channels, found.x, found.passes) == ((54, 57), (12.0, 18.0), ("a",))
    assert search.change() is None, "of noise a tenth of what it counts as, nothing stands out"


def test_a_shift_along_the_fiber_needs_passes_both_ways(search: Search) -> None:
    assert search.both_ways[:, 0].tolist() == [1.0, 0.0, 0.0]
    search.cells.approach.forward[1] = True
    fresh = Search(search.run, search.cells, search.groups, search.residual, search.open)
    assert fresh.both_ways[:, 0].tolist() == [1.0, 0.0, 0.0], "or all there are"
    one = Search(search.run, search.cells, [np.array([0]), np.array([1])], search.residual, search.open)
    assert not one.both_ways.any()


def test_a_power_counts_once(search: Search) -> None:
    search.residual = np.full((SAMPLES, CHANNELS), 3.0)
    where = np.zeros((SAMPLES, CHANNELS), bool)
    where[2:6, 1:4] = True
    found = search.closed(region(), where)
    assert found.amount == 9.0 and found.chi2 == pytest.approx((9 - 1.5) * 12)
    assert found.sigma == pytest.approx(1.5 * (2 * 2.0 / 12) ** 0.5)
    assert not search.open[where].any() and search.open[~where].all()


def test_power_near_vehicles_is_found_by_channel(search: Search) -> None:
    search.residual = RNG.normal(size=(SAMPLES, CHANNELS))
    search.residual[:, 5] *= 9
    found = search.power()
    assert found is not None and (found.kind, found.channels, found.every_pass) == ("power", (55, 55), True)
    near = search.cells.approach.near[:, 5]
    assert found.amount == pytest.approx((search.residual[near, 5] ** 2).mean())
    quiet = Search(search.run, search.cells, search.groups, 0.5 * search.residual / 9, search.open)
    assert quiet.power() is None


def test_a_region_of_one_pass_has_a_time_and_of_more_none(search: Search) -> None:
    where = np.zeros((SAMPLES, CHANNELS), bool)
    where[4:9, 2:5] = search.cells.approach.near[4:9, 2:5]
    rows = np.flatnonzero(where.any(1))
    one = search.region("power", Window(1, 2, 4, 7.5), where)
    assert one.time == (0.5 * rows[0], 0.5 * rows[-1]) and one.z == 7.5
    assert (one.passes, one.every_pass) == (("a",), False)
    both = search.region("power", Window(0, 2, 4, 7.5), where)
    assert both.time is None and both.passes == ("a", "b") and both.every_pass


def test_only_the_delay_of_a_single_pass_is_a_distance() -> None:
    run = made_run(made_pass("a", speed=-12.0), made_pass("slow", speed=0.2))
    assert in_meters(region(kind="late", amount=0.1), run).meters == pytest.approx(1.2)
    assert in_meters(region(kind="late", amount=0.1, passes=("slow",)), run).meters == pytest.approx(0.1)
    assert in_meters(region(kind="late", passes=("a", "slow")), run).meters is None
    assert in_meters(region(kind="gain"), run).meters is None


def test_every_kind_has_a_unit() -> None:
    assert {kind: region(kind=kind).unit for kind in UNITS} == UNITS
