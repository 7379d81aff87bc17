"""The vehicles of a planned survey: which, how fast, when, and where a camera would see them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.plan_section import LaneSection, PlanSection

Array = NDArray[np.float64]

#: s between two vehicles: none is near while another is.
HEADWAY = 20.0
#: m; how far beyond the camera's view a vehicle is followed, as `smooth_passes` does.
BEYOND = 40.0
#: How drivers depart from a steady drive: share of the speed, and period, s; sideways m, and wavelength, m.
SURGE, PERIOD, WEAVE, WAVE = 0.02, 15.0, 0.05, 120.0
EPOCH = np.datetime64("2000-01-01T00:00:00", "ns")


@dataclass(frozen=True)
class Drive:
    """One vehicle of a plan.

    Parameters
    ----------
    vehicle_class : of `MASSES`
    lane : that it drives in
    speed : m/s
    """

    vehicle_class: str
    lane: LaneSection
    speed: float


def drives(plan: PlanSection) -> list[Drive]:
    """The vehicles of a plan; the speeds of each lane are spread evenly over those that it names.

    >>> lane = LaneSection(y=0.0, toward="+x", vehicles={"car": 2, "bus": 1})
    >>> plan = PlanSection(length=60, offset=4, snr_db=15, speeds=(36, 72), lanes=[lane])
    >>> [(one.vehicle_class, one.speed) for one in drives(plan)]
    [('car', 11.666666666666666), ('bus', 15.0), ('car', 18.333333333333332)]
    """
    found = []
    for lane in plan.lanes:
        # Classes by turns, so that none gets the slow or the fast ones alone.
        left, order = {name: count for name, count in lane.vehicles.items() if count}, []
        while left:
            order += list(left)
            left = {name: count - 1 for name, count in left.items() if count > 1}
        low, high = plan.speeds
        for number, name in enumerate(order):
            share = (number + 0.5) / len(order)
            found.append(Drive(name, lane, (low + share * (high - low)) / 3.6))
    return found


def times(plan: PlanSection, made: list[Drive]) -> Iterator[tuple[float, float]]:
    """When each vehicle enters and leaves the camera's view, s."""
    now = 0.0
    for one in made:
        begin = now + HEADWAY + BEYOND / one.speed
        now = begin + (plan.length + BEYOND) / one.speed
        yield begin, begin + plan.length / one.speed


def fixes(plan: PlanSection, number: int, drive: Drive, when: tuple[float, float]) -> Any:
    """Trajectory table of one drive: nearly steady, as drivers are, with noise as large as the plan says."""
    import pandas as pd

    rng = np.random.default_rng(number)
    time = np.arange(np.ceil(when[0] * plan.frame_rate), np.floor(when[1] * plan.frame_rate) + 1) / plan.frame_rate
    since, phase = time - when[0], rng.uniform(0, 2 * np.pi, 2)
    way = drive.speed * (since + SURGE * PERIOD / (2 * np.pi) * np.sin(2 * np.pi * since / PERIOD + phase[0]))
    x = way if drive.lane.direction > 0 else plan.length - way
    y = drive.lane.y + WEAVE * np.sin(2 * np.pi * x / WAVE + phase[1])
    noise = plan.fix_sigma * rng.normal(size=(2, len(time)))
    stamps = EPOCH + np.round(time * 1e9).astype("timedelta64[ns]")
    columns: dict[str, Any] = {
        "time": pd.DatetimeIndex(stamps, tz="UTC"),
        "track_id": str(number),
        "class": drive.vehicle_class,
    }
    columns |= {"x": x + noise[0], "y": y + noise[1], "sigma_x": plan.fix_sigma, "sigma_y": plan.fix_sigma}
    return pd.DataFrame(columns)
