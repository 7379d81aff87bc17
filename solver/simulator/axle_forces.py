"""Forces of the wheels on the ground: places, sizes and times."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.effects import effect_rng
from solver.simulator.outside import load_factor, wake
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import GRAVITY, Vehicle

Array = NDArray[np.float64]


def contact(scenario: Scenario, vehicle: Vehicle, time: Array) -> tuple[Array, Array]:
    """Contact points [time, wheel, 2], m, and forces on the ground [time, wheel, 3], N, z down, at `time` [time], s."""
    if scenario.effect("point_load"):
        place, shares, ahead = vehicle.position(time)[:, None, :], np.ones(1), np.zeros(1)
    else:
        place, shares = vehicle.wheels(time)
        ahead = vehicle.wheels_ahead
    trail, pull = wake(scenario, vehicle, time)
    deceleration = vehicle.deceleration(time)[:, None] / GRAVITY
    down = shares + deceleration * _dip(shares, ahead, scenario.effect("braking_height"))
    swing = _bounce(scenario, vehicle, time) + _after_bump(scenario, vehicle, time)
    down = down * (load_factor(scenario, vehicle, time) + swing)[:, None]
    forward = deceleration - scenario.effect("grade_drag")
    heading, right = vehicle.axes(time)
    sideways = scenario.effect("camber")
    horizontal = forward[..., None] * heading[:, None, :] + sideways * right[:, None, :]
    force = np.concatenate([down[..., None] * horizontal, down[..., None]], axis=2)
    sucked = np.broadcast_to(pull[:, None] * np.array([0.0, 0.0, 1.0]), (len(time), len(pull), 3))
    return np.concatenate([place, trail], axis=1), vehicle.mass * GRAVITY * np.concatenate([force, sucked], axis=1)


def _dip(shares: Array, ahead: Array, height: float) -> Array:
    """Share of the load that each wheel gains per g of deceleration, from the pitching moment m a h."""
    lever = ahead - (shares * ahead).sum() / shares.sum()
    inertia = (shares * lever**2).sum()
    return height * shares * lever / inertia if inertia else np.zeros_like(shares)


def _bounce(scenario: Scenario, vehicle: Vehicle, time: Array) -> Array:
    amount = scenario.effect("dynamic_load")
    phase = effect_rng(scenario.seed, f"dynamic_load {vehicle.track_id}").uniform(0, 2 * np.pi)
    return amount * np.sin(2 * np.pi * scenario.effect("dynamic_load_frequency") * time + phase)


def _after_bump(scenario: Scenario, vehicle: Vehicle, time: Array) -> Array:
    """Free oscillation of a body on damped springs after the middle of its wheelbase meets the bump."""
    first, last = scenario.view
    since = time - vehicle.time_when_at(first + scenario.effect("road_bump_at") * (last - first))
    omega, damping = 2 * np.pi * scenario.effect("road_bump_frequency"), scenario.effect("road_bump_damping")
    damped = omega * np.sqrt(1 - damping**2)
    peak_at = np.arctan2(damped, damping * omega) / damped
    peak = np.exp(-damping * omega * peak_at) * np.sin(damped * peak_at)
    past = np.maximum(since, 0.0)
    return scenario.effect("road_bump") / peak * np.exp(-damping * omega * past) * np.sin(damped * past)
