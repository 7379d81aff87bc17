"""The smoother along the channels, against the same model solved at once, and on picks of other vehicles."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from solver.drive.along import QUARTZ, SLOW, Model, Steps, smoothed_along, steps_of
from solver.drive.car import smoothed_car
from solver.drive.path import path_of
from solver.drive.picks import Picks
from solver.drive.smoother import smooth
from solver.simulator.drive_road import Ground
from solver.simulator.drive_scenario import DriveScenario
from solver.simulator.drive_traffic import car_motion, gps_fixes
from solver.trajectory.tracks import Track

CHANNELS, SPACING = 60, 8.0


def test_smoother_is_the_conditional_gaussian() -> None:
    rng = np.random.default_rng(2)
    channels, size = 4, 7
    advance, stretched, variance, wander = np.full(channels, 8.0), np.full(channels, 7.0), np.full(channels, 0.3), 0.02
    keeps, scale = rng.uniform(0.3, 0.9, (3, channels)), rng.uniform(0.5, 2.0, (3, channels))
    bent = rng.normal(size=channels)
    scale[2] = 0.0
    first = np.diag([9.0, 0.1, 0.5, 0.3, 1.0, 1.0, 1.0])
    start = np.array([3.0, 0.0, 0.2, -0.1, 0.0, 0.0, 0.0])
    # All states at once: their prior mean and covariance, then conditioned on the picks.
    means, blocks = [start], {(0, 0): first}
    for channel in range(1, channels):
        move = np.diag([1.0, 1.0, 1.0, 1.0, *keeps[:, channel]])
        move[0, 1], move[0, 6] = stretched[channel], bent[channel]
        means.append(move @ means[-1] + np.array([advance[channel], 0, 0, 0, 0, 0, 0]))
        for other in range(channel):
            blocks[channel, other] = move @ blocks[channel - 1, other]
            blocks[other, channel] = blocks[channel, other].T
        added = np.diag([variance[channel], wander, 0.0, 0.0, *(1 - keeps[:, channel] ** 2)])
        blocks[channel, channel] = move @ blocks[channel - 1, channel - 1] @ move.T + added
    prior = np.block([[blocks[one, other] for other in range(channels)] for one in range(channels)])
    picked, value, noise, speed, lever = (
        np.array([0, 2, 3]),
        np.array([2.0, 20.0, 30.0]),
        np.array([0.4, 0.2, 0.7]),
        np.array([9.0, -8.0, 5.0]),
        np.array([-4.0, 1.0, 3.0]),
    )
    rows = np.zeros((3, channels * size))
    for pick, channel in enumerate(picked):
        rows[pick, channel * size : (channel + 1) * size] = [1.0, 0.0, speed[pick], lever[pick], *scale[:, channel]]
    gain = prior @ rows.T @ np.linalg.inv(rows @ prior @ rows.T + np.diag(noise))
    mean = np.concatenate(means) + gain @ (value - rows @ np.concatenate(means))
    covariance = prior - gain @ rows @ prior
    leg, of_leg = np.array([0, 0, -1]), np.zeros(3, np.int64)
    found = smooth(
        *(advance, stretched, bent, variance, wander, keeps, scale, leg, picked, of_leg, value, noise, speed, lever),
        *(start.copy(), first.copy()),
    )
    np.testing.assert_allclose(found[0], mean.reshape(channels, size), atol=1e-9)
    diagonal = np.stack([covariance[at : at + size, at : at + size] for at in range(0, channels * size, size)])
    np.testing.assert_allclose(found[1], diagonal, atol=1e-9)


def forth_and_back(pulled: float) -> Picks:
    """Picks of a car that goes forth at 10 m/s and back at 12; on the way back a vehicle pulls some by meters."""
    cell = SPACING * np.arange(CHANNELS)
    rows = np.stack([60.0 * cell / 10, 4000 - 60.0 * cell / 12]).astype(np.int64) // 10
    picks = np.stack([cell, cell])
    picks[1, 20:32] += pulled
    speed = np.repeat([[10.0], [-12.0]], CHANNELS, axis=1)
    return Picks(picks, np.full(picks.shape, 0.6), speed, rows, np.ones(picks.shape), np.full(picks.shape, 9.0))


def test_vehicle_that_pulls_many_picks_moves_the_clock_little() -> None:
    legs = SimpleNamespace(driven=SimpleNamespace(sigma=np.full((4001, 2), 0.8)), cell=np.zeros(4001), rate=6.0)
    step = np.full(CHANNELS, SPACING)
    steps = Steps(step, step, 0 * step, np.full(CHANNELS, 0.006), np.zeros(CHANNELS))
    clean, pulled = (smoothed_along(forth_and_back(off), legs, steps, 0.02, (1.0, 1.5), SPACING) for off in (0.0, 8.0))
    assert abs(clean.clock) < 1e-6
    assert abs(pulled.clock) < 1.5 * pulled.clock_sigma
    assert pulled.error[1, 20:32].min() > 3.0
    assert np.abs(pulled.error[0]).max() < 2.0


def test_a_drift_moves_passes_apart_as_they_are_apart_in_time() -> None:
    legs = SimpleNamespace(driven=SimpleNamespace(sigma=np.full((4001, 2), 0.8)), cell=np.zeros(4001), rate=6.0)
    step = np.full(CHANNELS, SPACING)
    steps = Steps(step, step, 0 * step, np.full(CHANNELS, 0.006), np.zeros(CHANNELS))
    picks = forth_and_back(0.0)
    late = picks.row / 6.0 - 4001 / 12.0
    picks = replace(picks, cell=picks.cell + picks.speed * (0.3 + 0.05 * late))
    known, free = (smoothed_along(picks, legs, steps, 0.02, (1.0, 1.5), SPACING, one) for one in (QUARTZ, 0.1))
    assert abs(known.drift) < 3e-5 and known.drift_sigma < 2.1e-5
    assert abs(free.drift - 0.05) < 2 * free.drift_sigma < 0.03
    assert np.abs(free.residual).max() < 0.5 * np.abs(known.residual).max()


def test_far_off_fast_errors_are_let_loose() -> None:
    legs = SimpleNamespace(driven=SimpleNamespace(sigma=np.full((4001, 2), 0.8)), cell=np.zeros(4001), rate=6.0)
    step = np.full(CHANNELS, SPACING)
    model = Model.of(
        forth_and_back(0.0),
        legs,
        Steps(step, step, 0 * step, step, np.zeros(CHANNELS)),
        0.02,
        (1.0, 1.5),
        SPACING,
        QUARTZ,
    )
    mean = np.zeros((CHANNELS, 9))
    mean[30, 6] = 5.0  # the fast error of the first leg, sigmas
    loose = model.loosened(mean).loose
    assert loose[0, 30] == np.sqrt((3 + 25) / 4)
    assert np.delete(loose[0], 30).max() == loose[1].max() == 1.0


def test_heading_is_unsure_at_a_corner() -> None:
    straight = path_of(np.array([[0.0, 0.0], [300.0, 0.0]]))
    corner = path_of(np.array([[0.0, 0.0], [150.0, 0.0], [150.0, 150.0]]))
    assert straight.spread_of_heading(8.0).max() < 1e-6
    found = corner.spread_of_heading(8.0)
    assert found[corner.first + 150] > 0.45
    assert found[corner.first + 100] < 1e-3


def test_cable_beside_a_corner_of_the_map_is_shorter_or_longer() -> None:
    """As a whole, by as much as the map lies beside it for each radian; on straight streets lengths are kept."""
    path = path_of(np.array([[0.0, 0.0], [150.0, 0.0], [150.0, 150.0]]))
    cell = path.first + 50.0 + 8.0 * np.arange(25)
    nothing = np.zeros(25)
    found = steps_of(path, cell, np.zeros(25, bool), nothing, 8.0, 1.0, 8.0)
    assert found.bent.sum() == pytest.approx(np.pi / 2 * 8.0 / np.sqrt(2), rel=0.02)
    assert np.abs(found.bent[:7]).max() < 0.01 < 1.0 < found.bent[12:14].max()
    np.testing.assert_allclose(found.variance, found.variance[0])
    looped = steps_of(path, cell, np.abs(np.arange(25) - 12) < 3, nothing, 8.0, 1.0, 8.0)
    assert np.abs(looped.bent[11:15]).max() == 0.0


def test_picks_before_and_behind_a_corner_say_how_far_beside_it_the_cable_lies() -> None:
    """The map is 5 m longer than the cable at each of two corners: after the first, the second is known better."""
    legs = SimpleNamespace(driven=SimpleNamespace(sigma=np.full((4001, 2), 0.8)), cell=np.zeros(4001), rate=6.0)
    step, bent = np.full(CHANNELS, SPACING), np.zeros(CHANNELS)
    bent[[20, 30]] = 6.0
    picks = forth_and_back(0.0)
    picks.cell[:, 20:] += 5.0
    picks.cell[:, 30:] += 5.0
    picks.cell[:, 25:] = np.nan
    once = Steps(step, step, bent, np.full(CHANNELS, 0.006), np.zeros(CHANNELS))
    found = smoothed_along(picks, legs, once, 0.002, (1.0, 1.5), SPACING)
    assert found.cell[35] == pytest.approx(8.0 * 35 + 10.0, abs=1.5)
    assert found.sigma[35] < found.sigma[28] + 4.0


def test_step_is_none_with_the_probability_of_slack() -> None:
    path = path_of(np.array([[0.0, 0.0], [300.0, 0.0]]))
    slack = np.array([0.0, 0.01, 0.25, 1.0])
    found = steps_of(path, 600.0 + 8.0 * np.arange(4), np.zeros(4, bool), slack, 8.0, 1.0, 8.0)
    none = found.variance[0]
    assert found.advance.tolist() == found.stretched.tolist() == [8.0, 8.0, 6.0, 0.0]
    np.testing.assert_allclose(found.variance - none, [0.0, 0.0, 0.25 * 0.75 * 64.0, 0.0], atol=1e-9)
    assert found.askew.max() < 1e-5

    picks = forth_and_back(0.0)
    assert picks.both_ways
    picks.cell[1, 4:] = np.nan
    assert not picks.both_ways


def test_what_else_tells_the_clock_moves_a_single_pass() -> None:
    """A single pass at one speed: a later clock is a shift, and only what else tells of it says how far."""
    picks = forth_and_back(0.0)
    picks.cell[1] = np.nan
    legs = SimpleNamespace(driven=SimpleNamespace(sigma=np.full((4001, 2), 0.8)), cell=np.zeros(4001), rate=6.0)
    step = np.full(CHANNELS, SPACING)
    steps = Steps(step, step, 0 * step, np.full(CHANNELS, 0.006), np.zeros(CHANNELS))
    alone, told = (
        smoothed_along(picks, legs, steps, 0.02, (1.0, 1.5), SPACING, clock=one) for one in ((0.0, np.inf), (0.5, 0.1))
    )
    assert abs(alone.clock) < 1e-6 and alone.clock_sigma > 1.9
    assert abs(told.clock - 0.5) < 0.01 and abs(told.clock_sigma - 0.1) < 0.001
    assert np.abs(told.cell - alone.cell + 5.0).max() < 0.1


def test_slow_errors_of_a_receiver_are_as_large_as_they_are_taken() -> None:
    """What smoothing leaves of simulated receivers' errors along the road, between moments 6 to 12 s apart."""
    products = []
    for seed in range(6):
        scenario = DriveScenario(seed=seed, length=4000.0, gps_outliers=0.0)
        motion = car_motion(scenario, Ground(scenario).road)
        time, fixes, sigma = gps_fixes(scenario, motion)
        car = smoothed_car(Track("1", "car", time, fixes, np.full(fixes.shape, sigma)))
        moments = np.arange(time[0] + 5, time[-1] - 5)
        (place, heading), driven = motion.at(moments), car.at(moments)
        moves = driven.speed > 2
        off = np.where(moves, ((driven.position - place) * heading).sum(1) / sigma, 0.0)
        products += [(off[lag:] * off[:-lag])[moves[lag:] & moves[:-lag]] for lag in range(6, 13)]
    measured = np.sqrt(np.concatenate(products).mean())
    assert measured < SLOW < 1.4 * measured
