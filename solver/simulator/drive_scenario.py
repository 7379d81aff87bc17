"""What drive to simulate: one car with GPS along a fiber whose path is roughly known from an operator's map."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vision.contract import InputError, read_toml

#: The name of the built-in drive, and `base` of TOML files that change it.
DRIVE = "drive"
#: What files may say wrongly of a drive, by the name of the effect; amounts as of `solver.simulator.EFFECTS`.
TOLD_WRONGLY = ("clock_drift", "channel_stretch", "gauge_length")


@dataclass(frozen=True)
class DriveScenario:
    """A drive to simulate. Where a range (low, high) is given, the seed draws a value from it.

    Attributes
    ----------
    name : of the survey
    seed : the same seed gives the same drive, bit by bit
    length : m of road
    snr_db : 10 log10(mean signal^2 / noise variance) at the sampling rate, within 30 m of the car
    sampling_rate, gauge_length, channel_spacing : of the record; Hz, m
    lead : m of cable before and after the road, where nothing is heard
    loops_per_km : manholes with slack
    loop_channels : of slack in each
    length_error : relative, sd; cable per meter of its path
    map_shift : m, rms; how far the operator's map is off, smoothly over some hundred meters
    map_vertices : m between two points of the map
    lateral : m; distance of the fiber from the middle of the road
    depth : m
    speeds : km/h
    stops_per_km : at lights, 5 to 60 s each
    u_turns : the car turns around, drives back some hundred meters, and turns around again
    detours : stretches of 400 m where the car leaves the fiber by more than 60 m
    gps_sigma : m
    gps_outliers : share of the fixes that are 10 to 40 m off
    traffic : other vehicles per hour and direction
    clock_offset : s; the record's clock less that of the GPS
    polarity : 1, -1, or 0: either
    bad_channels : share that records nothing but loud noise, and as many that record nothing
    poisson_ratio, shear_modulus : of the ground; Pa
    origin, x_azimuth : the local frame, degrees
    start : of the record by its own clock, ISO 8601, UTC
    effects : hidden in it, by name, with their amounts: `clock_drift`, the share of the time that the GPS's clock
        loses; `channel_stretch` and `gauge_length`, by how much channel spacing and gauge length exceed what files say
    """

    name: str = DRIVE
    seed: int = 0
    length: float = 2000.0
    snr_db: float | tuple[float, float] = 10.0
    sampling_rate: float = 50.0
    gauge_length: float = 10.0
    channel_spacing: float = 8.0
    lead: tuple[float, float] = (80.0, 250.0)
    loops_per_km: float = 1.5
    loop_channels: tuple[float, float] = (10.0, 20.0)
    length_error: float = 0.01
    map_shift: tuple[float, float] = (5.0, 10.0)
    map_vertices: tuple[float, float] = (30.0, 90.0)
    lateral: tuple[float, float] = (3.5, 7.0)
    depth: tuple[float, float] = (0.6, 1.2)
    speeds: tuple[float, float] = (25.0, 65.0)
    stops_per_km: float = 1.5
    u_turns: int = 1
    detours: int = 0
    gps_sigma: tuple[float, float] = (1.0, 3.0)
    gps_outliers: float = 0.02
    traffic: float = 90.0
    clock_offset: tuple[float, float] = (-60.0, 60.0)
    polarity: int = 0
    bad_channels: float = 0.01
    poisson_ratio: float = 0.25
    shear_modulus: float = 6e7
    origin: tuple[float, float] = (32.113, 34.804)
    x_azimuth: float = 78.0
    start: str = "2025-08-11T06:00:00"
    effects: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for good, message in rules(self):
            if not good:
                raise InputError(message)

    def rng(self, what: str) -> np.random.Generator:
        """Random numbers for one purpose, so that a change of another setting does not change them."""
        return np.random.default_rng([self.seed, *what.encode()])

    def hidden(self, name: str) -> float:
        """The amount of a hidden effect; 0 where it is not hidden.

        >>> DriveScenario(effects={"clock_drift": 0.002}).hidden("clock_drift"), DriveScenario().hidden("clock_drift")
        (0.002, 0.0)
        """
        return float(self.effects.get(name, 0.0))

    def drawn(self, name: str) -> float:
        """The value of a setting that is a number, or drawn from its range."""
        low, high = np.broadcast_to(getattr(self, name), 2)
        return float(self.rng(name).uniform(low, high)) if high > low else float(low)


def rules(s: DriveScenario) -> list[tuple[bool, str]]:
    """What must hold of a drive, and the line that says so."""
    ranges = ("lead", "loop_channels", "map_shift", "map_vertices", "lateral", "depth", "speeds", "gps_sigma")
    positive = ("sampling_rate", "gauge_length", "channel_spacing", "shear_modulus")
    return [
        *((getattr(s, name) > 0, f"{name}: must be above 0") for name in positive),
        *(
            (0 <= getattr(s, name)[0] <= getattr(s, name)[1], f"{name}: give [low, high], 0 or above")
            for name in ranges
        ),
        (s.seed >= 0, "seed: must be 0 or above"),
        (s.length >= 500, "length: at least 500 m"),
        (s.speeds[0] >= 5, "speeds: at least 5 km/h"),
        (s.depth[0] > 0.2, "depth: at least 0.2 m"),
        (s.map_vertices[0] >= 2, "map_vertices: at least 2 m apart"),
        (0 <= s.gps_outliers < 0.5, "gps_outliers: 0 to 0.5"),
        (0 <= s.bad_channels < 0.2, "bad_channels: a share below 0.2"),
        (s.polarity in (-1, 0, 1), "polarity: 1, -1, or 0 for either"),
        (s.traffic >= 0 and s.loops_per_km >= 0 and s.stops_per_km >= 0, "traffic, loops, stops: 0 or above"),
        (0 < s.poisson_ratio < 0.5, "poisson_ratio: between 0 and 0.5"),
        (set(s.effects) <= set(TOLD_WRONGLY), f"effects: a drive can hide {', '.join(TOLD_WRONGLY)}, nothing else"),
        (all(abs(one) < 0.5 for one in s.effects.values()), "effects: amounts of a drive are between -0.5 and 0.5"),
    ]


def read_drive(source: str | Path, **overrides: Any) -> DriveScenario | None:
    """A drive by its built-in name or from a TOML file with `base = "drive"`; None where `source` is neither.

    >>> read_drive("drive", seed=3).seed, read_drive("street")
    (3, None)
    """
    table: dict[str, Any] = {}
    if str(source) != DRIVE:
        path = Path(source)
        if not path.is_file():
            return None
        table = read_toml(path, "a scenario in TOML")
        if table.pop("base", None) != DRIVE:
            return None
        table = {"name": path.stem, **table}
    table |= {key: value for key, value in overrides.items() if value is not None}
    known = [field.name for field in dataclasses.fields(DriveScenario)]
    for key in table:
        if key not in known:
            raise InputError(f"{source}: a drive has no setting `{key}`; known are {', '.join(known)}")
    try:
        given: dict[str, Any] = {key: tuple(one) if isinstance(one, list) else one for key, one in table.items()}
        return DriveScenario(**given)
    except (InputError, TypeError, IndexError) as error:
        raise InputError(f"{source}: {error}") from error
