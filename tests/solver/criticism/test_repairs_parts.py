"""The parts of the search for an unseen vehicle, on numbers written out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.catalogue.trial_survey import trial_survey
from solver.criticism.repairs import (
    GUESSED,
    LANE,
    OFFSET,
    REACH,
    SPEEDS,
    Peak,
    correlate,
    lanes,
    passing_times,
    refined,
    straight,
    with_pass,
)

RNG = np.random.default_rng(9)
RATE = 5.0


def driven(way: int, y: float, x: np.ndarray, first: int = 0) -> Any:
    position = np.column_stack([x, np.full(len(x), y)])
    return SimpleNamespace(speed=10.0 * way, position=position, rows=np.arange(first, first + len(x)))


@pytest.fixture
def problem() -> Any:
    """Channels from x = 20 to 60 m; the middle is at 40."""
    start = np.column_stack([np.linspace(20, 60, 41), np.full(41, 4.0), np.ones(41)])
    passes = [
        driven(1, 0.0, np.arange(0.0, 100.0, 2.0), 10),
        driven(1, 0.6, np.arange(0.0, 100.0, 2.0), 100),
        driven(-1, -3.5, np.arange(100.0, 0.0, -2.0), 200),
    ]
    return SimpleNamespace(start=start, passes=passes, sampling_rate=RATE)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("speed", [5.0, 18.0])
def test_an_unseen_vehicle_drives_straight_on_through_the_middle(problem, way, speed):
    one = straight(problem, speed, way, -1.5, 8.0, 200)
    time = one.rows / RATE
    np.testing.assert_allclose(one.position[:, 0], 40 + way * speed * (time - 8))
    np.testing.assert_allclose(one.position[:, 1], -1.5)
    np.testing.assert_allclose(one.velocity, np.tile([way * speed, 0.0], (len(one.rows), 1)))
    assert (np.diff(one.rows) == 1).all()
    assert (one.sigma == GUESSED).all() and one.offset == OFFSET and one.vehicle_class == "car"


def test_it_is_followed_as_far_as_it_shows_and_within_the_record(problem):
    middle = straight(problem, 10.0, 1, 0.0, 20.0, 200)
    assert np.abs(middle.position[[0, -1], 0] - 40).max() == pytest.approx(REACH)
    assert len(middle.rows) == 2 * REACH / 10.0 * RATE + 1
    late = straight(problem, 10.0, 1, 0.0, 39.0, 200)
    assert late.rows[-1] == 199 and len(late.rows) < len(middle.rows)


def test_lanes_are_where_known_vehicles_of_each_direction_drive(problem):
    assert lanes(problem) == [(1, pytest.approx(0.3)), (-1, -3.5)]
    assert lanes(SimpleNamespace(passes=[])) == []  # type: ignore[arg-type]


def test_known_vehicles_pass_the_middle_at_the_row_nearest_to_it(problem):
    """20 rows of 2 m from x = 0, 30 from x = 100."""
    assert passing_times(problem) == [(1, (10 + 20) / RATE), (1, (100 + 20) / RATE), (-1, (200 + 30) / RATE)]


def test_correlation_is_the_sum_of_products_at_every_shift():
    values, shape = RNG.normal(size=(40, 3)), RNG.normal(size=(7, 3))
    found = correlate(values, shape)
    assert found.shape == (46,)
    padded = np.pad(values, ((6, 6), (0, 0)))
    expected = [(padded[at : at + 7] * shape).sum() for at in range(46)]
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_a_shape_is_found_where_it_was_put():
    values, shape = np.zeros((60, 4)), RNG.normal(size=(9, 4))
    values[23:32] += 2.5 * shape
    found = correlate(values, shape)
    assert int(found.argmax()) == 23 + 8
    assert found.max() == pytest.approx(2.5 * (shape**2).sum())


def peak(speed: float, y: float, best: tuple[float, float]) -> Peak:
    """A match that falls off around the best speed and lane."""
    snr = 30.0 - ((speed - best[0]) / 2) ** 2 - ((y - best[1]) / 0.8) ** 2
    return Peak(snr, 1.0, 0.1, 5.0, -1, speed, y, 100)


@pytest.mark.parametrize("best", [(11.0, -3.2), (9.3, -4.0)])
def test_speed_and_lane_are_refined_between_those_searched(best):
    asked: list[tuple[float, int, float]] = []

    def match(speed: float, way: int, y: float) -> Peak:
        asked.append((speed, way, y))
        return peak(speed, y, best)

    found = refined(peak(10.0, -3.5, best), match)
    assert (found.speed, found.y) == (pytest.approx(best[0], abs=0.1), pytest.approx(best[1], abs=0.1))
    assert {way for _, way, _ in asked} == {-1}, "it keeps its direction"


def test_the_refined_vehicle_stays_in_the_lane_and_at_a_speed_that_may_be():
    found = refined(peak(SPEEDS[-1], 0.0, (90.0, 9.0)), lambda speed, way, y: peak(speed, y, (90.0, 9.0)))
    assert found.y <= LANE and found.speed <= 2 * SPEEDS[-1]
    assert found.y == pytest.approx(LANE, abs=0.05)


def test_vehicles_that_were_added_are_numbered():
    problem = trial_survey()[0].problem
    one = replace(problem.passes[0], track_id="unseen", rows=problem.passes[0].rows)
    once = with_pass(problem, one)
    twice = with_pass(once, one)
    assert [p.track_id for p in twice.passes[-2:]] == ["unseen#1", "unseen#2"]
    assert len(problem.passes) == len(twice.passes) - 2, "the survey stays as it was"
    assert twice.traffic.passes == len(twice.passes)
    np.testing.assert_array_equal(twice.traffic.samples, problem.traffic.samples)
