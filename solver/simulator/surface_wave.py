"""Rayleigh waves that the vehicles radiate: far-reaching, weak, and faster than the static response."""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.buried_route import Route
from solver.simulator.effects import effect_rng
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import Vehicle

Array = NDArray[np.float64]
NEAR = 5.0  # m; nearer than this the wave is not stronger


def surface_wave(
    scenario: Scenario, route: Route, arc: Array, vehicles: tuple[Vehicle, ...], time: Array, rate: Array
) -> Array:
    """Strain rate [time, channel] of A (10 m / r)^1/2 cos(w (t - r / c)) (cos of wave and fiber)^2 from each vehicle.

    A is the scenario's share of the largest rate [time, channel] that the vehicles cause otherwise, taken in proportion
    to their weight; the vehicle's place is that at the time of emission.

    Parameters
    ----------
    arc : [channel] m along the route
    """
    points, tangents = route.position(arc), route.tangent(arc)
    largest, heaviest = np.abs(rate).max(), max(vehicle.mass for vehicle in vehicles)
    omega, speed = 2 * np.pi * scenario.effect("rayleigh_wave_frequency"), scenario.effect("rayleigh_wave_speed")
    wave = np.zeros((len(time), len(arc)))
    for vehicle in vehicles:
        first, last = vehicle.times_within(scenario.view[0] - 50, scenario.view[1] + 50, 0.05)
        rows = slice(int(np.searchsorted(time, first)), int(np.searchsorted(time, last)))
        there = vehicle.position(time[rows])
        travel = np.linalg.norm(points[:, :2] - there[:, None], axis=2) / speed
        sent = (time[rows, None] - travel).ravel()
        ray = points[:, :2] - vehicle.position(sent).reshape(*travel.shape, 2)
        r = np.maximum(np.linalg.norm(ray, axis=2), NEAR)
        along = (ray * tangents[:, :2]).sum(2) / r
        phase = effect_rng(scenario.seed, f"rayleigh_wave {vehicle.track_id}").uniform(0, 2 * np.pi)
        strength = vehicle.mass / heaviest * np.sqrt(10.0 / r) * along**2
        wave[rows] += strength * np.cos(omega * (time[rows, None] - r / speed) + phase)
    return scenario.effect("rayleigh_wave") * largest * wave
