"""Noise level from quiet windows."""

import numpy as np

from solver.noise.quiet_windows import noise_level, quiet
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
