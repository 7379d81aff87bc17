"""Write a simulated drive as a user would bring it, and the truth beside it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from solver.simulator.drive_record import DriveRecord, record_drive, times_of
from solver.simulator.drive_road import Ground
from solver.simulator.drive_scenario import DriveScenario
from solver.simulator.drive_traffic import car_motion, gps_fixes
from solver.simulator.survey_files import TRUTH, require_free
from solver.survey.das.prodml import write_prodml
from vision.contract import LocalFrame, writing

MAP, GPS = "operator.geojson", "gps.csv"
MINUTE = 60.0  # s of record per DAS file

SITE = """\
# one car with GPS along a fiber that an operator's map shows roughly; meters, UTC
name = {name}

[frame]
origin = [{latitude}, {longitude}]   # latitude, longitude of (0, 0)
x_azimuth = {x_azimuth}   # degrees clockwise from north

[das]
files = ["das/*.h5"]

[route]
file = "{map}"
sigma = {sigma}   # m, how far the map may be off
length_factor = [1.0, 0.02]   # meters of cable per meter of map, loops left out, and its sd

[trajectories]
files = ["{gps}"]
"""


def write_drive(scenario: DriveScenario, folder: Path, done: Callable[[DriveRecord], None] | None = None) -> Path:
    """Write site.toml, das/*.h5, gps.csv, operator.geojson and truth.json into a new folder; the path of site.toml.

    Raises
    ------
    InputError
        If there is something else at `folder`.
    """
    folder = Path(folder)
    require_free(folder)
    with writing(folder) as temporary:
        temporary.mkdir()
        car = car_motion(scenario, Ground(scenario).road)
        shape = (len(times_of(scenario, car)), len(Ground(scenario).distance))
        kept = temporary / "rate.tmp"
        drive = record_drive(scenario, np.memmap(kept, np.float32, "w+", shape=shape))
        write_record(drive, temporary / "das")
        frame = LocalFrame(scenario.origin, scenario.x_azimuth)
        write_map(drive, frame, temporary / MAP)
        write_gps(drive, frame, temporary / GPS)
        (temporary / "site.toml").write_text(site_text(scenario), encoding="utf-8")
        (temporary / TRUTH).write_text(json.dumps(truth(drive), indent=1) + "\n", encoding="utf-8")
        if done is not None:
            done(drive)
        kept.unlink()
    return folder / "site.toml"


def site_text(scenario: DriveScenario) -> str:
    """site.toml of a drive."""
    return SITE.format(
        name=json.dumps(scenario.name, ensure_ascii=False),
        latitude=scenario.origin[0],
        longitude=scenario.origin[1],
        x_azimuth=float(scenario.x_azimuth),
        map=MAP,
        gps=GPS,
        sigma=8.0,
    )


def write_record(drive: DriveRecord, folder: Path) -> None:
    """Write das/*.h5, a minute each, by the record's own clock."""
    s = drive.ground.scenario
    rows = round(MINUTE * s.sampling_rate)
    folder.mkdir()
    start = np.datetime64(s.start, "us")
    for number, first in enumerate(range(0, len(drive.rate) - 1, rows), 1):
        part = drive.rate[first : first + rows]
        write_prodml(
            folder / f"das_{number:04}.h5",
            part,
            start=start + np.timedelta64(round(1e6 * drive.time[first]), "us"),
            sampling_rate=s.sampling_rate,
            gauge_length=s.gauge_length / (1 + s.hidden("gauge_length")),
            channel_spacing=s.channel_spacing / (1 + s.hidden("channel_stretch")),
            vendor="roadfiber simulate",
            packed=False,
        )


def write_map(drive: DriveRecord, frame: LocalFrame, path: Path) -> None:
    """Write the operator's map as GeoJSON."""
    latitude, longitude = frame.to_geographic(*drive.ground.map.T)
    line = [[round(float(b), 8), round(float(a), 8)] for a, b in zip(latitude, longitude, strict=True)]
    geometry = {"type": "LineString", "coordinates": line}
    feature = {"type": "Feature", "geometry": geometry, "properties": {"what": "cable as drawn"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}), encoding="utf-8")


def write_gps(drive: DriveRecord, frame: LocalFrame, path: Path) -> None:
    """Write the car's fixes; the record's clock is `clock_offset` ahead of them."""
    import pandas as pd

    s = drive.ground.scenario
    time, place, sigma = gps_fixes(s, drive.car)
    latitude, longitude = frame.to_geographic(*place.T)
    start = np.datetime64(s.start, "ms") - np.timedelta64(round(1e3 * drive.clock_offset), "ms")
    stamps = start + (1e3 * time * (1 - s.hidden("clock_drift"))).round().astype("timedelta64[ms]")
    table = pd.DataFrame(
        {
            "time": [f"{stamp}Z" for stamp in stamps],
            "track_id": "gps",
            "class": "car",
            "latitude": latitude.round(8),
            "longitude": longitude.round(8),
            "sigma": round(sigma, 2),
        }
    )
    table.to_csv(path, index=False)


def truth(drive: DriveRecord) -> dict[str, object]:
    """Everything the files hide, JSON-ready."""
    ground, s = drive.ground, drive.ground.scenario
    distance = ground.distance
    return {
        "scenario": s.name,
        "seed": s.seed,
        "snr_db": s.drawn("snr_db"),
        "noise_sd": drive.noise_sd,
        "clock_offset": drive.clock_offset,
        "polarity": drive.polarity,
        "effects": dict(s.effects),
        "bad_channels": list(drive.bad),
        "route_xyz": ground.cable.at(distance).round(3).tolist(),
        "in_loop": ground.cable.slack(distance).tolist(),
        "loops": [
            {
                "first_channel": float((one.begin - distance[0]) / s.channel_spacing),
                "last_channel": float((one.end - distance[0]) / s.channel_spacing),
                "length": one.end - one.begin,
                "place": ground.cable.at(np.array((one.begin + one.end) / 2)).round(2).tolist(),
            }
            for one in ground.cable.loops
        ],
        "ends": [float(ground.cable.cable[0]), float(ground.cable.cable[-1])],
    }
