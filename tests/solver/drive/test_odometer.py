"""The clock from fixes and picks at once, and the pace by which picks move with it."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

import roadfiber as rf
from solver.drive.along import QUARTZ, smoothed_along, steps_of
from solver.drive.car import Car, car_of
from solver.drive.odometer import Drove, clock_of_fixes
from solver.drive.path import path_of
from solver.drive.picks import Picks
from solver.drive.response import Clock, Legs, legs_of, responses

START = np.datetime64("2025-08-11T06:00:00", "ns")
SPACING, RATE, SIGMA = 10.0, 6.25, 2.0


def driven(seed: int) -> tuple[Car, Legs, Picks, Any]:
    """A car that stops twice on 1.5 km, its fixes with white and slow errors, and picks as fiber would give them."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 240.0, 0.05)
    speed = 12.0 * np.clip(np.abs(time[:, None] - np.array([50.0, 130.0])).min(1) / 8.0 - 0.6, 0.0, 1.0)
    place = np.cumsum(speed) * 0.05
    fixed = np.arange(1.0, time[-1])
    slow, keeps = np.zeros(len(fixed)), np.exp(-1 / 30)
    for index in range(1, len(fixed)):
        slow[index] = keeps * slow[index - 1] + np.sqrt(1 - keeps**2) * rng.normal()
    off = SIGMA * (np.sqrt(0.7) * rng.normal(size=len(fixed)) + np.sqrt(0.3) * slow)
    table = pd.DataFrame(
        {
            "time": pd.to_datetime(START + (1e9 * fixed).astype("timedelta64[ns]")).tz_localize("UTC"),
            "track_id": "car",
            "class": "car",
            "x": np.interp(fixed, time, place) + off,
            "y": SIGMA * rng.normal(size=len(fixed)),
            "sigma_x": SIGMA,
            "sigma_y": SIGMA,
        }
    )
    path, car = path_of(np.array([[0.0, 0.0], [place[-1], 0.0]])), car_of(table, START)

    class Still:
        """A record's clock and filter: no more is asked of it."""

        rate, gauge_length, whitener, time = RATE, 10.0, np.ones(1), np.arange(0.0, 240.0, 1 / RATE)

    quiet: Any = Still()
    legs = legs_of(quiet, path, car, Clock(0.0))
    channel = np.arange(20.0, place[-1] - 20.0, SPACING)
    # When the car passes each channel, and where its smoothed track is then.
    row = np.round(RATE * np.interp(channel, place + 1e-6 * time, time)).astype(np.int64)
    cell = path.first + legs.driven.position[row, 0] + rng.normal(size=len(row)) * 0.3
    pace = responses(quiet, path, car, legs).paces(legs.count)[0]
    pace = pace[np.round(path.first + channel).astype(np.int64)]
    one = np.ones((1, len(row)))
    picks = Picks(cell[None], 0.4 * one, pace[None], row[None], 10 * one, 20 * one)
    count = len(row)
    steps = steps_of(path, path.first + channel, np.zeros(count, bool), np.zeros(count), SPACING, 1.0, 8.0)
    return car, legs, picks, (path, steps)


def both(seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """What fixes and picks at once tell of the clock, and what the smoother does."""
    car, legs, picks, (path, steps) = driven(seed)
    drove = Drove(picks, legs, np.ones(picks.cell.shape), steps, 0.02, SPACING, QUARTZ, car, path, Clock(0.0))
    alone = smoothed_along(picks, legs, steps, 0.02, (car.memory, car.sigma), SPACING)
    return clock_of_fixes(drove), (alone.clock, alone.clock_sigma)


def test_fixes_and_picks_at_once_tell_more_of_the_clock() -> None:
    found = np.array([both(seed) for seed in range(12)])
    once, smoothed = found[:, 0], found[:, 1]
    error = np.sqrt((once[:, 0] ** 2).mean()), np.sqrt((smoothed[:, 0] ** 2).mean())
    assert error[0] < error[1]
    assert 0.5 < np.sqrt(((once[:, 0] / once[:, 1]) ** 2).mean()) < 1.5


def test_a_clock_that_is_off_is_told_in_full() -> None:
    """The estimate moves by as much as the clock is off: a pick moves with its pace, not with the speed at a stop."""
    car, legs, picks, (path, steps) = driven(1)
    rest = np.ones(picks.cell.shape), steps, 0.02, SPACING, QUARTZ, car, path, Clock(0.0)
    late = Picks(**vars(picks) | {"cell": picks.cell + 0.3 * picks.speed})
    first, second = (clock_of_fixes(Drove(one, legs, *rest))[0] for one in (picks, late))
    assert second - first == pytest.approx(0.3, abs=0.03)


def test_no_pick_leaves_the_clock_as_it_is() -> None:
    car, legs, picks, (path, steps) = driven(1)
    none = Picks(**vars(picks) | {"cell": np.full(picks.cell.shape, np.nan)})
    assert clock_of_fixes(
        Drove(none, legs, np.zeros(none.cell.shape), steps, 0.02, SPACING, QUARTZ, car, path, Clock(0.0))
    ) == (0.0, 2.0)


def test_pace_of_a_channel_before_a_stop_is_that_of_what_it_hears(drive: rf.Drive, run: rf.DriveRun) -> None:
    """Where the car goes slowly past a channel, the place that fits best moves by more than the car does."""
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car, clock = car_of(drive.tracks, quiet.start), run.clock_offset
    legs = legs_of(quiet, path, car, Clock(clock))
    pace = responses(quiet, path, car, legs).paces(legs.count)
    passed = legs.near & (np.abs(legs.speed) < 3.0) & (np.abs(legs.speed) > 0.5)
    slow, found = np.abs(legs.speed[passed]), np.abs(pace[legs.leg[passed], legs.cell[passed]])
    assert passed.sum() > 10
    assert np.nanmedian(found - slow) > 1.0
    fast = legs.near & (np.abs(np.gradient(legs.speed)) * legs.rate < 0.1) & (np.abs(legs.speed) > 8.0)
    off = np.abs(pace[legs.leg[fast], legs.cell[fast]]) - np.abs(legs.speed[fast])
    assert np.nanmedian(np.abs(off)) < 0.4
