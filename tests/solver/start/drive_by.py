"""Vehicles that drive by a straight fiber at constant speed, heard through the signal path."""

from collections.abc import Sequence

import numpy as np
import torch

from solver.cable.fiber import Fiber
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import Traffic, Vehicles
from solver.survey.das import DASRecord
from solver.trajectory.vehicle_pass import Pass

VIEW = (0.0, 60.0)
MARGIN = 30.0  # m that vehicles are followed beyond the view
SPACING = 1.021
DEPTH = 0.9
LANES = (0.0, -3.5)
TWO_LANES = (("car", 12.0, 0.0), ("van", -10.0, -3.5), ("car", 15.0, 0.2), ("bus", -13.0, -3.4))


def drive(name: str, kind: str, speed: float, y: float, begin: float, rate: float) -> Pass:
    """One pass; it is beside the middle of the view `begin` seconds after the record's start."""
    reach = (VIEW[1] - VIEW[0]) / 2 + MARGIN
    half = reach / abs(speed)
    rows = np.arange(int(np.ceil((begin - half) * rate)), int((begin + half) * rate) + 1)
    x = np.mean(VIEW) + speed * (rows / rate - begin)
    count = len(rows)
    position = np.column_stack([x, np.full(count, y)])
    in_view = (x >= VIEW[0]) & (x <= VIEW[1])
    return Pass(name, kind, rows, position, np.tile([speed, 0.0], (count, 1)), np.full((count, 2), 0.05), in_view)


def a_street(
    y: float | np.ndarray = 4.5,
    vehicles: Sequence[tuple[str, float, float]] = TWO_LANES,
    *,
    headway: float = 16.0,
    rate: float = 5.0,
    reverse: bool = False,
    noise: float = 0.1,
    channels: int = 90,
    seed: int = 0,
) -> tuple[DASRecord, list[Pass], np.ndarray]:
    """A record of passes at (class, speed, lane), with the route [channel, 3] of its fiber.

    The fiber runs along the road at lateral position `y` (a number, or one per channel counted along +x); channel 0 is
    at x = -15 m, or the last one where the fiber runs in `reverse`. `noise` is relative to the rms of the signal.
    """
    passes = [
        drive(str(number), kind, speed, lane, 10.0 + headway * number, rate)
        for number, (kind, speed, lane) in enumerate(vehicles)
    ]
    along = -15.0 + SPACING * np.arange(channels)
    route = np.column_stack([along, np.broadcast_to(y, channels), np.full(channels, DEPTH)])
    if reverse:
        route = route[::-1].copy()
    tangent = np.tile([-1.0 if reverse else 1.0, 0.0, 0.0], (channels, 1))
    points = [torch.from_numpy(route + side * 5.0 * tangent) for side in (1, -1)]
    slope = torch.from_numpy(tangent)
    traffic, cars = Traffic.of(passes), Vehicles.of(passes)
    weight = {"car": 1.0, "van": 1.5, "bus": 8.0, "vehicle": 1.0}
    cars.amplitude = torch.tensor([1e-5 * weight[one.vehicle_class] for one in passes], dtype=torch.float64)
    fiber = Fiber(points[0], points[1], slope, slope)
    rate_map = SignalPath(traffic, 10.0).strain_rate(fiber, cars, torch.tensor(0.25, dtype=torch.float64)).numpy()
    strain_rate = np.zeros((int(traffic.samples[-1]) + round(5 * rate), channels))
    strain_rate[traffic.samples] = rate_map
    level = noise * np.sqrt((rate_map**2).mean())
    strain_rate += level * np.random.default_rng(seed).normal(size=strain_rate.shape)
    return record_of(strain_rate, rate), passes, route


def record_of(strain_rate: np.ndarray, rate: float = 5.0, first: int = 0) -> DASRecord:
    """A record of a strain rate [time, channel]."""
    number = np.arange(first, first + strain_rate.shape[1])
    return DASRecord(
        strain_rate=strain_rate,
        time=np.arange(len(strain_rate)) / rate,
        start=np.datetime64("2025-08-11T06:00:00", "ns"),
        distance=SPACING * number,
        channel=number,
        gauge_length=10.0,
        channel_spacing=SPACING,
        sampling_rate=rate,
        gaps=(),
        provenance={},
    )
