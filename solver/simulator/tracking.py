"""How the trajectories depart from where the vehicles were: noise, and hidden errors."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.effects import effect_rng
from solver.simulator.outside import misplaced
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import Vehicle

Array = NDArray[np.float64]


def reported(scenario: Scenario, vehicle: Vehicle, time: Array, rng: np.random.Generator) -> Array:
    """Fixes [fix, 2], m, of a vehicle at `time` [fix], s, as the table reports them."""
    told = _mistaken(scenario, vehicle, time) + scenario.fix_sigma * fix_noise(scenario, rng, len(time))
    for name in ("track_wander", "track_jitter"):
        sd = scenario.track_wander if name == "track_wander" else scenario.effect(name)
        duration = scenario.track_wander_time if name == "track_wander" else scenario.effect("track_jitter_time")
        slow = effect_rng(scenario.seed, f"{name} {vehicle.track_id}")
        told = told + sd * np.stack([wander(slow, time, duration), wander(slow, time, duration)], axis=1)
    return told


def _mistaken(scenario: Scenario, vehicle: Vehicle, time: Array) -> Array:
    """Position in a table with the scenario's errors; adding the effect's amount corrects it."""
    x, y = vehicle.position(time).T
    middle, half = sum(scenario.view) / 2, (scenario.view[1] - scenario.view[0]) / 2
    y = y - scenario.effect("track_bend") * ((x - middle) / half) ** 2
    angle = np.radians(scenario.effect("track_rotation"))
    across = sum(scenario.lanes) / 2
    dx, dy = (x - middle) / (1 + scenario.effect("track_scale")), (y - across) / (1 + scenario.effect("track_scale"))
    x = middle + np.cos(angle) * dx + np.sin(angle) * dy
    y = across - np.sin(angle) * dx + np.cos(angle) * dy
    x = x - scenario.effect("track_offset_along") * bool(scenario.effect("track_offset"))
    x = x - vehicle.direction * scenario.effect("track_bias")
    return np.stack([x, y - scenario.effect("track_offset") - misplaced(scenario, vehicle)], axis=1)


def stamps(scenario: Scenario, time: Array) -> Array:
    """Reading of the trajectories' clock, s, at `time` [fix], s."""
    return time * (1.0 - scenario.effect("clock_drift")) - scenario.effect("clock_offset")


def fix_noise(scenario: Scenario, rng: np.random.Generator, count: int) -> Array:
    """Noise [fix, 2] of sd 1: white, or correlated as by a tracker: the mean of three fixes (lag one 2/3, lag three 0).

    >>> import numpy as np
    >>> n = fix_noise(Scenario(track_noise="camera"), np.random.default_rng(0), 20_000)[:, 0]
    >>> [round(float(np.corrcoef(n[k:], n[:-k])[0, 1]), 1) for k in (1, 2, 3)]
    [0.7, 0.3, 0.0]
    """
    if scenario.track_noise == "white":
        return rng.normal(size=(count, 2))
    white = rng.normal(size=(count + 2, 2))
    return (white[:-2] + white[1:-1] + white[2:]) / np.sqrt(3.0)


def wander(rng: np.random.Generator, time: Array, duration: float) -> Array:
    """Slow error [fix] of sd 1: an Ornstein-Uhlenbeck process of correlation time `duration`, s, passed twice.

    Two passes, with half the time each, make it differentiable.
    """
    step = duration / 50
    grid = np.arange(time[0] - 6 * duration, time[-1] + 2 * step, step)
    decay = np.exp(-step / (duration / 2))
    from scipy.signal import lfilter

    # Variance of white noise through two equal one-pole filters: (1 + a^2) / (1 - a^2)^3.
    scale = np.sqrt((1 - decay**2) ** 3 / (1 + decay**2))
    process = scale * lfilter([1.0], [1.0, -2 * decay, decay**2], rng.normal(size=len(grid)))
    return np.interp(time, grid, process)
