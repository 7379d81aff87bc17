"""What the user of a survey has besides the fiber's record: sample times, trajectories, anchors."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.simulator.scenario import Scenario
from solver.simulator.street import MARGIN
from solver.simulator.tracking import reported, stamps
from solver.simulator.vehicle import Vehicle
from vision.contract import InputError, LocalFrame

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
MILLIMETER = 1e-3  # a sigma is never 0 in a file
BESIDE = 12.0  # m from the nearest lane up to which a camera sees: beyond stand houses


def sample_times(scenario: Scenario, vehicles: tuple[Vehicle, ...]) -> Array:
    """Sample times [time], s: from 0 until a quiet time after the last vehicle has left the view."""
    last = max(vehicle.times_within(*scenario.view, 0.05)[1] for vehicle in vehicles)
    return np.arange(int((last + MARGIN) * scenario.sampling_rate)) / scenario.sampling_rate


def active_channels(route: Array, view: tuple[float, float], lanes: tuple[float, float]) -> tuple[int, int]:
    """First and last channel of `route` [channel, 3], m, in view, by a road with such lanes."""
    beside = (route[:, 1] >= min(lanes) - BESIDE) & (route[:, 1] <= max(lanes) + BESIDE)
    inside = np.flatnonzero(beside & (route[:, 0] >= view[0]) & (route[:, 0] <= view[1]))
    if not len(inside):
        raise InputError(f"route: no channel lies within the view, x from {view[0]:g} to {view[1]:g} m")
    return int(inside[0]), int(inside[-1])


def in_view(scenario: Scenario, vehicles: tuple[Vehicle, ...], time: Array) -> NDArray[np.intp]:
    """Rows of `time` when a vehicle is in view, pass after pass: together the maps of all passes."""
    spans = (vehicle.times_within(*scenario.view, 0.05) for vehicle in vehicles)
    return np.concatenate([np.flatnonzero((time >= first) & (time <= last)) for first, last in spans])


def watch(scenario: Scenario, vehicles: tuple[Vehicle, ...], rng: np.random.Generator) -> "pd.DataFrame":
    """Trajectory table of the vehicles while in view, with the camera's (or the GPS receiver's) noise."""
    import pandas as pd

    table = pd.concat([_fixes(scenario, vehicle, rng) for vehicle in vehicles], ignore_index=True)
    if not scenario.gps:
        return table
    frame = LocalFrame(scenario.origin, scenario.x_azimuth)
    latitude, longitude = frame.to_geographic(table["x"].to_numpy(), table["y"].to_numpy())
    head = table[["time", "track_id", "class"]].assign(latitude=latitude, longitude=longitude, sigma=table["sigma_x"])
    return head.join(table.drop(columns=["time", "track_id", "class", "x", "y", "sigma_x", "sigma_y"]))


def _fixes(scenario: Scenario, vehicle: Vehicle, rng: np.random.Generator) -> "pd.DataFrame":
    import pandas as pd

    first, last = vehicle.times_within(*scenario.view, 0.01)
    frames = np.arange(np.ceil(first * scenario.frame_rate), np.floor(last * scenario.frame_rate) + 1)
    time = frames / scenario.frame_rate
    seen = reported(scenario, vehicle, time, rng)
    stamp = np.round(stamps(scenario, time) * 1e9).astype("timedelta64[ns]")
    unknown = bool(scenario.effect("wheel_layout") or scenario.effect("point_load"))
    sigma = max(scenario.fix_sigma, MILLIMETER)
    columns = {
        "time": pd.DatetimeIndex(np.datetime64(scenario.start, "ns") + stamp, tz="UTC"),
        "track_id": vehicle.track_id,
        "class": "vehicle" if unknown else vehicle.vehicle_class,
        "x": seen[:, 0],
        "y": seen[:, 1],
        "sigma_x": sigma,
        "sigma_y": sigma,
    }
    size = {} if unknown else {"length": vehicle.length, "width": vehicle.width}
    return pd.DataFrame(columns | size)


def dig(scenario: Scenario, route: Array, active: tuple[int, int], rng: np.random.Generator) -> "pd.DataFrame":
    """Anchor table: a manhole an eighth of the view from either end, surveyed with the scenario's noise."""
    import pandas as pd

    first, last = active
    channel = np.array([first + (last - first) // 8, last - (last - first) // 8])
    place = route[channel] + scenario.anchor_sigma * rng.normal(size=(2, 3))
    sigma = max(scenario.anchor_sigma, MILLIMETER)
    return pd.DataFrame(
        {
            "name": ["manhole_1", "manhole_2"],
            "channel": channel,
            "x": place[:, 0],
            "y": place[:, 1],
            "z": np.maximum(place[:, 2], MILLIMETER),
            "sigma_xy": sigma,
            "sigma_z": sigma,
        }
    )
