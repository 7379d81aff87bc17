"""The parts of the searches for faults, on numbers written out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from noisy_trials import noisy

from solver.catalogue.trial_survey import trial_survey
from solver.criticism.left_out import JUMP, find_cycle_skips, find_faded_channels, level_around
from solver.criticism.repairs import (
    GUESSED,
    LANE,
    OFFSET,
    REACH,
    SPEEDS,
    Peak,
    correlation_with,
    lanes,
    passing_times,
    refined,
    straight,
    template,
    unexplained,
    with_pass,
)
from solver.fit.map_fit import MapFit
from solver.fit.robust import HUBER
from solver.fit.state import State

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
    found = correlation_with(values, len(shape) + 5)(shape)
    assert found.shape == (46,)
    padded = np.pad(values, ((6, 6), (0, 0)))
    expected = [(padded[at : at + 7] * shape).sum() for at in range(46)]
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_a_shape_is_found_where_it_was_put():
    values, shape = np.zeros((60, 4)), RNG.normal(size=(9, 4))
    values[23:32] += 2.5 * shape
    found = correlation_with(values, len(shape) + 5)(shape)
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


@pytest.fixture(scope="module")
def ended() -> tuple[MapFit, State]:
    """The trial survey in noise of a hundredth of its signal, with its true state."""
    return noisy(100, 9), trial_survey()[1]


def with_record(fit: MapFit, change: Any) -> MapFit:
    """The same survey with what `change` makes of its record [row, channel] and noise."""
    record = fit.problem.record.copy()
    change(record, float(fit.problem.noise[0]))
    return MapFit(replace(fit.problem, record=record))


def test_a_sound_record_has_no_jumps_and_no_silent_channels(ended: tuple[MapFit, State]) -> None:
    assert find_cycle_skips(*ended) is None and find_faded_channels(*ended) is None


def test_samples_that_jump_and_come_back_are_taken_out(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    samples = fit.problem.traffic.samples
    places = [(int(samples[at]), channel) for at, channel in ((3, 2), (9, 11), (15, 20), (22, 5), (27, 15))]

    def jump(record: np.ndarray, level: float) -> None:
        for place in places:
            record[place] += 40 * level

    found = find_cycle_skips(with_record(fit, jump), state)
    assert found is not None and (found.name, found.freedom, found.unit) == ("cycle_skips", 1, "1")
    total = int(fit.measured.sum())
    assert found.estimate == pytest.approx(5 / total) and found.sigma == pytest.approx(5**0.5 / total)
    assert found.fall == pytest.approx(5 * (2 * HUBER * JUMP - HUBER**2)) and found.detectable == 5 / total
    mended = found.mend(fit.problem).record
    assert sorted(map(tuple, np.argwhere(np.isnan(mended)).tolist())) == sorted(places)
    assert not np.isnan(fit.problem.record).any(), "the survey stays as it was"


def test_the_residual_around_a_sample_is_taken_without_it() -> None:
    alone = np.zeros((9, 9))
    alone[4, 4] = 40.0
    assert level_around(alone)[4, 4] == 1.0 and level_around(alone)[4, 5] == pytest.approx(40 / 24**0.5)
    assert level_around(np.full((9, 9), 3.0)) == pytest.approx(3.0)


def test_the_sharp_peaks_of_an_unknown_vehicle_are_no_jumps(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    rows = fit.problem.traffic.samples
    places = [(3, 2), (9, 11), (15, 20), (22, 5), (27, 15)]
    peak = np.array([[0, 7, -4, 7, 0], [5, -2, 20, -2, 4], [0, -3, 0, -4, 0], [-4, 1, -14, 2, -4], [0, -6, 3, -6, 0]])

    def pass_by(record: np.ndarray, level: float) -> None:
        for row, channel in places:
            # Rows 1 and 3 are those of the crossing; a jump would leave the others as they are.
            record[rows[row - 1 : row + 4], channel - 2 : channel + 3] += peak * level

    assert find_cycle_skips(with_record(fit, pass_by), state) is None


def test_three_jumps_are_no_fault_nor_is_what_lasts(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    rows = fit.problem.traffic.samples

    def few(record: np.ndarray, level: float) -> None:
        record[rows[[3, 9, 15]], 7] += 40 * level

    def lasting(record: np.ndarray, level: float) -> None:
        record[rows[3:9], 7] += 40 * level

    assert find_cycle_skips(with_record(fit, few), state) is None
    assert find_cycle_skips(with_record(fit, lasting), state) is None


def test_a_silent_channel_is_named_and_taken_out(ended: tuple[MapFit, State]) -> None:
    fit, state = ended

    def mute(record: np.ndarray, level: float) -> None:
        record[:, 8] *= 0.01

    found = find_faded_channels(with_record(fit, mute), state)
    assert found is not None and found.freedom == 1 and "(8)" in found.words
    assert found.estimate == found.detectable == pytest.approx(1 / 24) and found.trials == 24
    model = fit.model(state).numpy()[:, 8] / float(fit.problem.noise[8])
    assert found.fall == pytest.approx(float((model**2).sum()), rel=0.1), "all of its signal"
    mended = found.mend(fit.problem).record
    assert np.isnan(mended[:, 8]).all() and np.isfinite(np.delete(mended, 8, 1)).all()


def test_what_is_left_is_of_the_whole_record_without_spikes(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    samples = fit.problem.traffic.samples
    quiet = np.setdiff1d(np.arange(len(fit.problem.record)), samples)

    def spike(record: np.ndarray, level: float) -> None:
        record[samples[4], 3], record[samples[5], 3] = 500 * level, np.nan

    rest = unexplained(with_record(fit, spike), state)
    assert rest[samples[4], 3] == rest[samples[5], 3] == 0
    np.testing.assert_array_equal(rest[quiet], fit.problem.record[quiet])
    kept = np.ones(len(samples), bool)
    kept[[4, 5]] = False
    left = fit.problem.record[samples[kept]] - fit.model(state).numpy()[kept]
    np.testing.assert_allclose(rest[samples[kept]], left, atol=1e-12 * np.abs(left).max())


def test_a_template_is_what_a_typical_car_makes(ended: tuple[MapFit, State]) -> None:
    """In proportion to the median load, earlier in the channels that it reaches first."""
    fit, state = ended
    shape = template(fit, state, 12.0, 1, 0.0)
    assert len(shape) == 2 * int(np.ceil(REACH / 12.0 * fit.problem.sampling_rate)) + 1
    heavier = replace(state, vehicles=replace(state.vehicles, amplitude=3 * state.vehicles.amplitude))
    np.testing.assert_allclose(template(fit, heavier, 12.0, 1, 0.0), 3 * shape, rtol=1e-9)
    middle = (shape**2 * np.arange(len(shape))[:, None]).sum(0) / (shape**2).sum(0)
    assert middle[0] < middle[12] < middle[-1]
    back = template(fit, state, 12.0, -1, 0.0)
    turned = (back**2 * np.arange(len(back))[:, None]).sum(0) / (back**2).sum(0)
    assert turned[0] > turned[12] > turned[-1]
