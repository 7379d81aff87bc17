"""How loud the car is, and what a vehicle that is louder pays."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import roadfiber as rf
from solver.drive.car import car_of
from solver.drive.likelihood import heard
from solver.drive.loudness import SCATTER, departure, loudness, usual_of
from solver.drive.path import path_of
from solver.drive.response import Clock, legs_of, responses


def test_level_follows_a_lane_and_a_slow_change_but_no_truck() -> None:
    rng = np.random.default_rng(4)
    car = np.log(6.0) + np.stack([0.2 * np.sin(np.arange(300) / 60), np.full(300, 0.3)], -1)
    loud = car + 0.2 * rng.normal(size=car.shape)
    loud[100:125, 0] += 1.5
    loud[30:60] = np.nan
    found = usual_of(loud)
    assert found.scatter == SCATTER
    assert np.abs(np.log(found.amplitude) - car).max() < 0.3
    uneven = usual_of(loud + 0.5 * rng.normal(size=car.shape))
    assert 0.45 < uneven.scatter < 0.65


def test_too_few_channels_say_nothing() -> None:
    loud = np.full((300, 2), np.nan)
    assert not usual_of(loud).amplitude.any()
    loud[:7, 0] = 1.0
    assert not usual_of(loud).amplitude.any()
    loud[:8, 0] = 1.0
    assert usual_of(loud).amplitude[:, 1] == pytest.approx(np.exp(1.0))  # as loud as on the other leg


def test_departure_is_odd_and_forgets_what_is_far() -> None:
    assert departure(0.0, 0.25) == 0.0
    assert departure(-0.4, 0.25) == -departure(0.4, 0.25)
    assert departure(0.3, 0.25) == pytest.approx(0.3, abs=0.02)
    assert abs(departure(2.0, 0.25)) < 1e-4


def test_what_is_louder_than_the_car_pays(drive: rf.Drive, run: rf.DriveRun, truth: dict[str, Any]) -> None:
    quiet, path = drive.quiet(), path_of(drive.vertices)
    car, cell = car_of(drive.tracks, quiet.start), run.arrays["along"] + path.first
    legs = legs_of(quiet, path, car, Clock(truth["clock_offset"]))
    of, polarity = responses(quiet, path, car, legs), int(run.facts["parameters"]["polarity"]["value"])
    floor, usual = loudness(quiet, of, legs, cell, polarity)
    low, number = np.round(cell).astype(np.int64) - 5, np.arange(len(cell))
    there = run.arrays["heard"] & ~np.array(truth["in_loop"])
    assert usual.amplitude[there].min() > 0.0
    best = heard(quiet, of, low, 11, polarity, floor).ratio.argmax(1)

    def paid(loud: NDArray[np.bool_]) -> NDArray[Any]:
        """Prices of channels where the car is, six times louder at some samples."""
        other = replace(quiet, values=np.where(loud, 6 * quiet.values, quiet.values).astype(np.float32))
        return heard(other, of, low, 11, polarity, floor, usual=usual).price[number, best]

    never, always = np.zeros(len(legs.leg), bool), np.ones(len(legs.leg), bool)
    assert np.median(paid(never)[there]) > -0.5 > -5.0 > np.median(paid(always)[there])
    # A vehicle that is beside the car on one leg takes nothing from what the others hear.
    ratios = np.stack([heard(quiet, of, low, 11, polarity, floor, leg).ratio.max(1) for leg in range(legs.count)])
    several = there & ((ratios > 8.0).sum(0) >= 2) & (ratios[0] > 8.0)
    assert several.sum() > 10
    assert np.median(paid(legs.leg == 0)[several]) > -1.0
    # Nothing is paid where nothing is known of the car.
    assert not heard(quiet, of, low, 11, polarity, floor).price.any()
