"""The hidden Markov model over the channels, on likelihoods that are known."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.drive.channel_map import ChannelMap, against_traffic, kernels, map_channels
from solver.drive.likelihood import Heard
from solver.drive.loops import Loop, confirmed, loops_of, runs_of, sure
from solver.drive.path import path_of


def made(cells: np.ndarray, quiet: np.ndarray, height: float = 12.0) -> Heard:
    """Likelihoods that peak at `cells` [channel], flat where `quiet`, below 0 far away."""
    low = np.zeros(len(cells), np.int64)
    width = int(cells.max()) + 60
    away = np.arange(width)[None] - cells[:, None]
    ratio = np.where(quiet[:, None], -6.0, height - 0.5 * (away / 1.5) ** 2).clip(-6.0)
    ones = np.ones_like(ratio, dtype=np.float32)
    return Heard(low, ratio.astype(np.float32), ones, 0 * ones)


def test_straight_cable_is_followed_past_quiet_channels() -> None:
    cells = 20 + 8.0 * np.arange(40)
    quiet = np.zeros(40, bool)
    quiet[[11, 25, 26]] = True
    found = map_channels(made(cells, quiet), np.zeros(40, bool), 8.0, 1.0)
    assert np.abs(found.cell - cells).max() < 1.0
    assert not found.loop.any()
    assert found.spread[26] > found.spread[5]


def test_channels_that_tell_nothing_lie_between_those_that_do() -> None:
    """Sixty in a row of 10.4 cells each: by whole cells, each step the most probable, they would end 24 cells off."""
    cells = 20 + 10.4 * np.arange(120)
    number = np.arange(120)
    one = made(cells, np.zeros(120, bool))
    nothing = np.where(((number >= 30) & (number < 90))[:, None], 0.0, one.ratio)
    found = map_channels(replace(one, ratio=against_traffic(nothing)), np.zeros(120, bool), 10.4, 1.0)
    assert np.abs(found.likeliest - cells).max() < 5.0


def test_loop_is_told_from_quiet_channels() -> None:
    along = np.concatenate([8.0 * np.arange(20), np.full(12, 156.0), 160 + 8.0 * np.arange(20)]) + 20
    quiet = np.zeros(52, bool)
    quiet[20:32] = True
    found = map_channels(made(along, quiet), np.zeros(52, bool), 8.0, 1.0)
    assert runs_of(found.loop) == [(20, 31)]
    assert found.in_loop[20:32].min() > 0.9
    assert found.in_loop[:18].max() < 0.1
    assert np.abs(found.cell - along)[[5, 40]].max() < 1.0


def test_dead_channels_decide_nothing() -> None:
    cells = 20 + 8.0 * np.arange(30)
    dead = np.zeros(30, bool)
    dead[10:14] = True
    wrong = made(cells, np.zeros(30, bool))
    wrong.ratio[10:14] = 50.0 * (np.arange(wrong.ratio.shape[1]) == 3)
    found = map_channels(wrong, dead, 8.0, 1.0)
    assert np.abs(found.cell - cells).max() < 1.5


def test_kernels_are_probabilities() -> None:
    for one in kernels(np.array([3.7, 9.8])):
        assert one.sum(1) == pytest.approx(1.0)
    on, _, wide = kernels(np.array([9.8]))
    assert wide @ np.arange(wide.shape[1]) == pytest.approx(9.8, abs=0.1)
    assert on @ np.arange(on.shape[1]) == pytest.approx(9.8, abs=0.1)


def test_bends_let_a_cable_be_longer_than_the_map() -> None:
    straight, bent = (kernels(np.array([8.0]), np.array([bend]))[0] for bend in (0.0, 6.0))
    assert straight[0, 2] < 1e-5 < 0.02 < bent[0, 2]


def test_no_channel_alone_tells_much() -> None:
    """Six channels that hear another vehicle loudly do not outweigh forty that hear the car faintly."""
    cells = 20 + 8.0 * np.arange(40)
    both = made(cells, np.zeros(40, bool), 3.0)
    loud = made(cells + 60, np.zeros(40, bool), 40.0)
    both.ratio[10:16] = np.maximum(both.ratio[10:16], loud.ratio[10:16, : both.ratio.shape[1]])
    cut = replace(both, ratio=against_traffic(both.ratio))
    found = map_channels(cut, np.zeros(40, bool), 8.0, 1.0)
    assert np.abs(found.cell - cells).max() < 1.0


@pytest.mark.parametrize("louder", [False, True])
def test_vehicle_that_is_heard_alone_is_told_by_its_loudness(louder: bool) -> None:
    """Seventeen channels hear a vehicle 80 m ahead of the car, between quiet ones and before a loop of slack."""
    truth = np.concatenate([8.0 * np.arange(57), np.full(10, 452.0), 456 + 8.0 * np.arange(40)]) + 100
    number = np.arange(107)
    alone, quiet = (number >= 40) & (number < 57), (number >= 20) & (number < 70)
    one = made(truth - 80.0 * alone, quiet & ~alone, 8.0)
    nothing = np.where((quiet & ~alone)[:, None], 0.0, one.ratio)
    price = np.where(alone[:, None] & (one.ratio > 0), -6.0, 0.0)
    one = replace(one, ratio=against_traffic(nothing), price=louder * price)
    found = map_channels(one, np.zeros(107, bool), 8.0, 1.0)
    assert (found.other[42:55].min() > 0.9) == louder
    assert (np.abs(found.likeliest - truth)[42:55].max() < 4.0) == louder
    assert np.abs(found.likeliest - truth)[[*range(19), *range(72, 107)]].max() < 4.0


def test_vehicle_that_outruns_the_car_is_one_event() -> None:
    """Thirty channels hear a vehicle that leaves the car behind, faster by a quarter; the car is lost among it."""
    cells = 20 + 8.0 * np.arange(80)
    seen = cells.copy()
    seen[25:55] -= 2.0 * np.arange(30)
    both = made(seen, np.zeros(80, bool), 8.0)
    cut = replace(both, ratio=against_traffic(both.ratio))
    found = map_channels(cut, np.zeros(80, bool), 8.0, 1.0)
    assert found.other[38:53].min() > 0.9
    assert np.delete(found.other, np.arange(20, 58)).max() < 0.1
    assert np.abs(found.likeliest - cells).max() < 4.0
    assert not found.loop.any()


def test_path_rounds_corners_and_runs_on() -> None:
    path = path_of(np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0]]))
    assert path.length == 200.0
    cell, far = path.nearest(np.array([[50.0, 4.0], [-30.0, 0.0]]))
    assert far == pytest.approx([4.0, 0.0], abs=0.6)
    assert (cell - path.first).tolist() == [50, -30]
    assert path.turn.max() < 0.2
    turned = path.turned()
    assert turned.nearest(np.array([100.0, 90.0]))[0] - turned.first == pytest.approx(10, abs=1)


def test_only_loops_that_are_nearly_certain_are_named() -> None:
    """Ten channels in one place; the posterior has them in a loop with the probability that is given."""
    cells = np.concatenate([8.0 * np.arange(20), np.full(10, 156.0), 160 + 8.0 * np.arange(20)])
    loop = np.arange(50) // 10 == 2
    along: Any = SimpleNamespace(cell=cells, sigma=np.ones(50))
    for probability, named in ((0.8, 0), (0.95, 1)):
        inside = np.where(loop, probability, 0.0)
        found = ChannelMap(cells, np.ones(50), cells.astype(np.int64), inside, loop, np.zeros(50), 0.0)
        assert len(loops_of(found, along, 8.0, 1.0, 10.0)) == named
        assert sure(found).sum() == 10 * named


@pytest.mark.parametrize(
    ("before", "after", "heard", "named"),
    [
        (1, 1, 3, True),  # three of sixteen channels are more than chance
        (1, 1, 2, False),  # a vehicle that two channels hear is not the car
        (1, 1, 0, False),
        (6, 6, 16, True),  # quiet cable on both sides, where a loop as long overlaps with it wherever it lies
        (40, 40, 16, False),
    ],
)
def test_loops_are_named_by_how_probable_they_are_where_they_are_said(
    before: int, after: int, heard: int, named: bool
) -> None:
    """Twenty channels of slack, quiet cable before and after, then cable of which some channels hear the car."""
    audible = np.ones(200, bool)
    first, last = 100, 119
    audible[first - before + 1 : last + after] = False
    audible[last + after + heard :] = False
    found = confirmed([Loop(first, last, 500.0, 80.0, 1.0, 0.99)], audible, 4.0)
    assert len(found) == named
    assert all(0.9 < one.probability <= 0.99 for one in found)


def test_map_of_few_points_is_a_road_that_bends() -> None:
    """Chords of 50 m of a circle of 250 m are 1.25 m beside it at their middles, and 0.17 % shorter."""
    angle = np.arange(0, 1.21, 0.2)
    path = path_of(250.0 * np.stack([np.sin(angle), 1 - np.cos(angle)], -1))
    inside = path.points[path.first + 100 : path.first + 200]
    assert np.abs(np.hypot(inside[:, 0], inside[:, 1] - 250.0) - 250.0).max() < 0.1
    assert path.length == pytest.approx(300.0, abs=0.2)
    heading = np.arctan2(*path.along[path.first + 100 : path.first + 200, ::-1].T)
    middle = np.arctan2(inside[:, 0], 250.0 - inside[:, 1])
    assert np.abs(heading - middle).max() < 0.02


def test_long_straights_stay_straight_beside_a_bend() -> None:
    path = path_of(np.array([[0.0, 0.0], [1000.0, 0.0], [1900.0, 400.0]]))
    before = path.points[path.first + 20 : path.first + 930]
    assert np.abs(before[:, 1]).max() < 0.01
    corner = path_of(np.array([[0.0, 0.0], [150.0, 0.0], [150.0, 150.0]]))
    off = np.minimum(np.abs(corner.points[:, 1]), np.abs(corner.points[:, 0] - 150.0))
    assert off.max() < 3.5
