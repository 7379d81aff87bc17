"""Locate the fiber of a drive: the facts and arrays that its run keeps."""

import time
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.drive import drive_words as words
from solver.drive.channel_fit import Fit, fit_drive
from solver.drive.drive import Drive
from solver.drive.drive_format import FORMAT
from solver.drive.drive_run import DriveRun
from solver.drive.loops import flags_of
from solver.drive.misstated import GAUGE, SPACING
from solver.drive.misstated_words import facts_of
from solver.drive.path import STEP
from solver.drive.waterfall import moments_of, picture_of, track_of
from solver.run.facts import versions
from solver.run.strict_json import strict
from solver.run.trust import Trust
from solver.trajectory.agreement import unrecorded_line


def locate_drive(drive: Drive) -> DriveRun:
    """Locate the fiber of a drive.

    Raises
    ------
    InputError
        As of `solver.drive.channel_fit.fit_drive`.
    """
    begun = time.perf_counter()
    fit = fit_drive(drive)
    arrays = arrays_of(drive, fit)
    facts: dict[str, Any] = {"format": FORMAT, "name": drive.name}
    facts |= found_facts(drive, fit, arrays["constrained"]) | given_facts(drive, fit)
    facts |= {
        "timings": {"reading": drive.seconds, "locating": time.perf_counter() - begun},
        "versions": versions(),
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }
    return DriveRun(drive.frame, strict(facts), arrays, list(drive.anchors))


def found_facts(drive: Drive, fit: Fit, constrained: NDArray[np.bool_]) -> dict[str, Any]:
    """What fit.json says of a fit."""
    unheard = words.unheard_of(fit, constrained)
    factor = words.factor_of(fit, drive.length_factor)
    recorded = int(fit.quiet.channel[0]), int(fit.quiet.channel[-1])
    anchors = [one for one in drive.anchors if recorded[0] <= one.channel <= recorded[1]]
    unused = [unrecorded_line(one, recorded) for one in drive.anchors if one not in anchors]
    return {
        "headline": words.headline(fit, constrained),
        "trust": asdict(Trust.of(words.gates_of(fit, drive.length_factor, anchors))),
        "next": [*fit.quiet.cautions, *drive.cautions, *unused, *words.advice(fit, unheard)],
        "clock": words.clock_words(fit),
        "converged": fit.converged,
        "iterations": fit.rounds,
        "parameters": {
            "clock_offset": number(fit.clock.offset, fit.clock_sigma, "s"),
            "length_factor": number(*factor, "1"),
            "polarity": number(fit.polarity, 0.0, "1"),
        },
        "misstated": facts_of(fit.misstated, fit.stated),
        "effects": list(drive.effects),
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
        "seconds_shown": float(fit.quiet.time[-1]),
    }


def given_facts(drive: Drive, fit: Fit) -> dict[str, Any]:
    """What fit.json says of what the fit was given."""
    return {
        "frame": {"origin": list(drive.frame.origin), "x_azimuth": drive.frame.x_azimuth},
        "start": f"{np.datetime_as_string(fit.quiet.start, unit='ms')}Z",
        "anchors": [vars(one) for one in drive.anchors],
        "settings": {
            "gauge_length": fit.stated[GAUGE],
            "channel_spacing": fit.stated[SPACING],
            "sampling_rate": fit.quiet.rate,
            "map_sigma": drive.sigma,
            "length_factor": list(drive.length_factor),
            "depth": list(drive.ground.depth),
        },
        "statements": [one.to_dict() for one in (*fit.quiet.statements, *drive.statements)],
        "inputs": [
            *({"role": "das", "path": a, "sha256": b} for a, b in zip(fit.quiet.files, fit.quiet.sha256, strict=True)),
            *(vars(one) for one in drive.sources),
        ],
    }


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
    route = np.column_stack([fit.path.at(cell, lateral), fit.aside.depth])
    along, across = fit.path.along[number], fit.path.across[number]
    covariance = np.zeros((len(cell), 3, 3))
    covariance[:, :2, :2] = (fit.sigma * STEP)[:, None, None] ** 2 * along[:, :, None] * along[:, None, :]
    covariance[:, :2, :2] += fit.aside.sigma[:, None, None] ** 2 * across[:, :, None] * across[:, None, :]
    covariance[:, 2, 2] = fit.aside.depth_sigma**2
    legs = fit.legs.count
    residual = np.where(fit.picks.audible[:legs], fit.along.residual[:legs], np.nan) * STEP
    car_time, car_channel = track_of(fit.quiet, fit.legs, cell)
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
        "picture": picture_of(fit.quiet),
        "car_time": car_time,
        "car_channel": car_channel,
        "car": fit.legs.driven.position[moments_of(fit.legs)],
        "map": drive.vertices,
        "noise": np.nan_to_num(fit.quiet.noise),
    }
