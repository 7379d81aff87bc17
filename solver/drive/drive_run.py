"""A located drive: what `locate` returns of a survey with `[route]`."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.drive import drive_words as words
from solver.drive.channel_fit import Fit, fit_drive
from solver.drive.drive import Drive
from solver.drive.loops import flags_of
from solver.drive.path import STEP
from solver.fit.result import Placed
from solver.run.facts import versions
from solver.run.geojson import feature, positions, route_features
from solver.run.route_table import route_table
from solver.run.strict_json import strict
from solver.run.trust import Trust
from solver.survey.anchors import Anchor
from vision.contract import LocalFrame, require_writable, writing

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FORMAT = "roadfiber drive 1"
#: CSS pixels of a figure in a notebook.
WIDTH = 960
#: Rows and columns of the picture of the record.
ROWS, COLUMNS = 600, 1000


@dataclass(frozen=True, eq=False, repr=False)
class DriveRun:
    """A located drive.

    Parameters
    ----------
    frame : the local frame of all x, y
    facts : the content of fit.json
    arrays : by name, see `solver.drive.drive_folder.EXPECTED`
    anchors : known points of the fiber
    folder : that it was opened from; None where it was not
    """

    frame: LocalFrame
    facts: dict[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    anchors: list[Anchor]
    folder: Path | None = None

    @property
    def name(self) -> str:
        """Of the survey."""
        return str(self.facts["name"])

    @property
    def headline(self) -> str:
        """Where the fiber is, in a sentence."""
        return str(self.facts["headline"])

    @property
    def trust(self) -> str:
        """Whether the route may be relied on, in a sentence that follows from all checks."""
        return str(self.facts["trust"]["sentence"])

    @property
    def warnings(self) -> list[str]:
        """What a second drive or a tap test should look at; a line each."""
        return list(self.facts["next"])

    @property
    def clock_offset(self) -> float:
        """The record's clock less the GPS's, s."""
        return float(self.facts["parameters"]["clock_offset"]["value"])

    @cached_property
    def placed(self) -> Placed:
        """The route and its covariance."""
        return Placed(**{name: self.arrays[name] for name in PLACED})

    @property
    def route(self) -> "pd.DataFrame":
        """The route [channel].

        channel, distance, x, y, z, their sigmas (m), latitude, longitude, constrained, as of every run; `loop`, whether
        the channel is of slack in a manhole; `along` the map and `sigma_along`, m; `heard`, whether it heard the car.
        """
        table = route_table(self.placed, self.frame)
        more = {name: self.arrays[name] for name in ("loop", "along", "sigma_along", "heard")}
        return table.assign(**more)

    @property
    def loops(self) -> "pd.DataFrame":
        """Loops of slack: first and last channel, length and its sigma (m), place along the map (m), x, y, lat, lon."""
        import pandas as pd

        return pd.DataFrame(self.facts["loops"], columns=LOOP)

    def plot(self, width: int = WIDTH) -> "Figure":
        """Draw the channel map: slack along the path, with its band and loops; width in CSS pixels."""
        from solver.drive.drive_figures import channel_figure

        return channel_figure(self, width)

    def to_geojson(self, path: Path | str) -> None:
        """Write the route, its 95 % corridor, loops and anchors, WGS 84; InputError where it cannot be written."""
        require_writable(Path(path))
        with writing(Path(path)) as temporary:
            temporary.write_text(json.dumps(self.features(), allow_nan=False), encoding="utf-8")

    @cached_property
    def straight(self) -> Placed:
        """The route without channels in loops: those of one manhole are one point, and have no direction."""
        kept = ~np.asarray(self.arrays["loop"], bool)
        return Placed(**{name: self.arrays[name][kept] for name in PLACED})

    def features(self) -> dict[str, Any]:
        """The content of route.geojson."""
        found = route_features(self.straight, self.frame, self.anchors, self.name)
        for one in self.facts["loops"]:
            point = positions(self.frame, np.array([[one["x"], one["y"]]]))[0]
            found["features"].append(feature("Point", point, what="loop of slack", **one))
        return found

    def to_gis(self, path: Path | str, *, crs: str | int = "EPSG:4326", ground_height: float | None = None) -> None:
        """Write the route for a GIS or CAD, with accuracy classes; as `Run.to_gis`."""
        from solver.run.gis.export import export
        from solver.run.gis.layers import Subject

        place = self.straight, self.frame, self.anchors, self.name
        export(Subject(*place, str(self.facts["trust"]["grade"]), self.trust), path, crs, ground_height)

    def to_patch(self, patch: Any) -> Any:
        """A DASCore patch of the record with the route as coordinates along its distance; as `Run.to_patch`."""
        from solver.run.gis.patch_coords import with_route

        return with_route(patch, self.route)

    def save(self, folder: Path | str) -> None:
        """Write the run folder, whole or not at all; InputError where `folder` holds something else than a run."""
        from solver.drive.drive_folder import write_drive_run

        write_drive_run(Path(folder), self)

    def __repr__(self) -> str:
        return f"<DriveRun {self.name}: {self.headline} {self.trust}>"

    def _repr_html_(self) -> str:
        from solver.drive.drive_page import drive_page
        from vision.contract.notebook import framed

        return framed(drive_page(self))


PLACED = ("channel", "distance", "route", "covariance", "constrained")
LOOP = ("first_channel", "last_channel", "length", "sigma", "along", "x", "y", "latitude", "longitude", "probability")


def locate_drive(drive: Drive) -> DriveRun:
    """Locate the fiber of a drive.

    Raises
    ------
    InputError
        As of `solver.drive.channel_fit.fit_drive`.
    """
    import time as clock

    begun = clock.perf_counter()
    fit = fit_drive(drive)
    arrays = arrays_of(drive, fit)
    constrained = arrays["constrained"]
    unheard = words.unheard_of(fit, constrained)
    factor = words.factor_of(fit, drive.length_factor)
    trust = Trust.of(words.gates_of(fit, drive.length_factor))
    facts = {
        "format": FORMAT,
        "name": drive.name,
        "headline": words.headline(fit, constrained),
        "trust": asdict(trust),
        "next": words.advice(fit, unheard),
        "clock": words.clock_words(fit),
        "converged": fit.converged,
        "iterations": fit.rounds,
        "parameters": {
            "clock_offset": number(fit.clock_offset, fit.clock_sigma, "s"),
            "length_factor": number(*factor, "1"),
            "polarity": number(fit.polarity, 0.0, "1"),
        },
        "map_reversed": fit.coarse.reversed,
        "loops": [loop_facts(drive, fit, one) for one in fit.loops],
        "unheard": [
            {"channels": [int(fit.quiet.channel[one.first]), int(fit.quiet.channel[one.last])]}
            | {"along": [one.begin, one.end], "beside_the_car": one.beside}
            for one in unheard
        ],
        "legs": fit.legs.count,
        "gps_left_out": fit.car.left_out,
        "map_length": fit.path.length,
        "active_channels": active(fit, constrained),
        "frame": {"origin": list(drive.frame.origin), "x_azimuth": drive.frame.x_azimuth},
        "start": f"{np.datetime_as_string(fit.quiet.start, unit='ms')}Z",
        "seconds_shown": float(fit.quiet.time[-1]),
        "anchors": [vars(one) for one in drive.anchors],
        "settings": {
            "gauge_length": fit.quiet.gauge_length,
            "channel_spacing": fit.quiet.channel_spacing,
            "sampling_rate": fit.quiet.rate,
            "map_sigma": drive.sigma,
            "length_factor": list(drive.length_factor),
            "depth": list(drive.ground.depth),
        },
        "inputs": [
            *({"role": "das", "path": a, "sha256": b} for a, b in zip(fit.quiet.files, fit.quiet.sha256, strict=True)),
            *(vars(one) for one in drive.sources),
        ],
        "timings": {"reading": drive.seconds, "locating": clock.perf_counter() - begun},
        "versions": versions(),
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }
    return DriveRun(drive.frame, strict(facts), arrays, list(drive.anchors))


def number(value: float, sigma: float, unit: str) -> dict[str, Any]:
    """One of `parameters` of fit.json."""
    return {"value": float(value), "sigma": float(sigma), "unit": unit, "free": True}


def active(fit: Fit, constrained: NDArray[np.bool_]) -> list[int]:
    """First and last channel that the drive decides."""
    index = np.flatnonzero(constrained)
    return [int(fit.quiet.channel[index[0]]), int(fit.quiet.channel[index[-1]])] if len(index) else []


def loop_facts(drive: Drive, fit: Fit, loop: Any) -> dict[str, Any]:
    """One of `loops` of fit.json."""
    x, y = fit.path.at(np.array(loop.place), float(np.interp(loop.place, fit.cell, fit.aside.lateral)))
    latitude, longitude = drive.frame.to_geographic(x, y)
    return {
        "first_channel": int(fit.quiet.channel[loop.first]),
        "last_channel": int(fit.quiet.channel[loop.last]),
        "length": loop.length,
        "sigma": loop.sigma,
        "along": (loop.place - fit.path.first) * STEP,
        "x": float(x),
        "y": float(y),
        "latitude": float(latitude),
        "longitude": float(longitude),
        "probability": loop.probability,
    }


def arrays_of(drive: Drive, fit: Fit) -> dict[str, NDArray[Any]]:
    """The arrays of data.npz."""
    cell, lateral = fit.cell, fit.aside.lateral
    number = np.clip(np.round(cell).astype(np.int64), 0, len(fit.path.points) - 1)
    depth, depth_sigma = drive.ground.depth
    route = np.column_stack([fit.path.at(cell, lateral), np.full(len(cell), depth)])
    along, across = fit.path.along[number], fit.path.across[number]
    covariance = np.zeros((len(cell), 3, 3))
    covariance[:, :2, :2] = (fit.sigma * STEP)[:, None, None] ** 2 * along[:, :, None] * along[:, None, :]
    covariance[:, :2, :2] += fit.aside.sigma[:, None, None] ** 2 * across[:, :, None] * across[:, None, :]
    covariance[:, 2, 2] = depth_sigma**2
    legs = fit.legs.count
    residual = np.where(fit.picks.audible[:legs], fit.along.residual[:legs], np.nan) * STEP
    near = np.flatnonzero(fit.legs.near)[:: max(1, int(fit.legs.near.sum()) // 4000)]
    order = np.maximum.accumulate(cell)
    return {
        "channel": fit.quiet.channel.astype(np.int64),
        "distance": fit.quiet.distance,
        "route": route,
        "covariance": covariance,
        "constrained": words.constrained_of(fit),
        "loop": flags_of(fit.loops, len(cell)),
        "in_loop": fit.channels.in_loop,
        "along": (cell - fit.path.first) * STEP,
        "sigma_along": fit.sigma * STEP,
        "heard": fit.audible,
        "beside": fit.beside,
        "residual": residual.astype(np.float32),
        "picture": picture(fit),
        "car_time": fit.quiet.time[near],
        "car_channel": np.interp(fit.legs.cell[near], order, fit.quiet.channel),
        "car": fit.legs.driven.position[near],
        "map": drive.vertices,
        "noise": np.nan_to_num(fit.quiet.noise),
    }


def picture(fit: Fit) -> NDArray[np.float32]:
    """The record [row, column] for the page: the loudest of each few channels and samples, noise sigmas."""
    values = fit.quiet.values
    rows = np.arange(0, values.shape[0], max(1, -(-values.shape[0] // ROWS)))
    columns = np.arange(0, values.shape[1], max(1, -(-values.shape[1] // COLUMNS)))
    found = np.empty((len(rows), len(columns)), np.float32)
    for index, row in enumerate(rows):
        stop = rows[index + 1] if index + 1 < len(rows) else values.shape[0]
        energy = np.add.reduceat((values[row:stop] ** 2).mean(0), columns)
        found[index] = np.sqrt(energy / np.diff(np.append(columns, values.shape[1])))
    return found
