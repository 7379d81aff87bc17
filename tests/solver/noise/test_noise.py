"""Noise level from quiet windows."""

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from solver.noise.law import NoiseLaw
from solver.noise.quiet_windows import REACH, noise_level, quiet, whitened_noise
from solver.noise.whitening import Whitener
from solver.trajectory.vehicle_pass import Pass


def passing(rows: np.ndarray) -> Pass:
    position = np.column_stack([np.linspace(-50, 150, len(rows)), np.zeros(len(rows))])
    velocity = np.full((len(rows), 2), [10.0, 0.0])
    return Pass("1", "car", rows, position, velocity, np.full((len(rows), 2), 0.1), np.ones(len(rows), bool))


def test_quiet_follows_the_vehicle() -> None:
    route = np.column_stack([np.linspace(0, 100, 11), np.full(11, 4.0), np.full(11, 0.9)])
    one = passing(np.arange(100, 301))
    still = quiet(400, route, [one], 10.0)
    assert still[:100].all() and still[301:].all()
    nearest = 100 + np.abs(one.position[:, 0][:, None] - route[:, 0]).argmin(0)
    assert not still[nearest, np.arange(11)].any()
    assert still[100, 10] and still[300, 0]


def test_traffic_does_not_raise_the_noise_level() -> None:
    rng = np.random.default_rng(1)
    sigma = np.array([1e-9, 3e-9, 2e-9])
    rate = rng.normal(0, sigma, (4000, 3))
    still = np.ones(rate.shape, bool)
    rate[1000:1500] += 1e-6
    still[1000:1500] = False
    rate[5, 1] = np.nan
    np.testing.assert_allclose(noise_level(rate, still), sigma, rtol=0.06)


def test_without_quiet_windows_all_samples_serve() -> None:
    rate = np.random.default_rng(2).normal(0, 1e-9, (3000, 2))
    np.testing.assert_allclose(noise_level(rate, np.zeros(rate.shape, bool)), 1e-9, rtol=0.06)


def test_a_channel_without_samples_has_no_level() -> None:
    rate = np.full((50, 1), np.nan)
    assert np.isnan(noise_level(rate, np.ones(rate.shape, bool))).all()


def test_long_gauges_sense_a_vehicle_farther() -> None:
    """A vehicle just beyond the reach of a usual gauge is within that of one whose ends lie 20 m farther out."""
    route = np.array([[50.0, 1.001 * REACH, 0.9]])
    one = passing(np.arange(100, 301))
    assert quiet(400, route, [one], 10.0).all() and not quiet(400, route, [one], 50.0).all()


def test_what_counts_as_noise_is_noise_in_unit_variance_though_vehicles_and_spikes_are_beside_it() -> None:
    """Red noise: a sample whose past is a vehicle's, set to 0, would count five times as much as it should."""
    random, pole = np.random.default_rng(3), 0.9
    start = random.normal(size=(1, 40))
    record = lfilter([1.0], [1.0, -pole], (1 - pole**2) ** 0.5 * random.normal(size=(4000, 40)), 0, zi=pole * start)[0]
    still = np.arange(4000)[:, None] % 100 >= 40
    record = record + np.where(still, 0.0, 500.0)
    record[70::100, ::2] = 60.0  # a spike, not noise
    law = NoiseLaw(pole ** np.arange(32.0), np.zeros(32), np.ones(1))
    whitener = Whitener(torch.ones(40, dtype=torch.float64), np.arange(4000), np.arange(40), law)
    white, use = whitened_noise(record, np.broadcast_to(still, record.shape), whitener)
    assert 0.3 < use.mean() < 0.6
    first = use & ~np.vstack([np.zeros((1, 40), bool), use[:-1]])
    for some in (use, first):
        assert (white[some] ** 2).mean() == pytest.approx(1.0, abs=0.06)
