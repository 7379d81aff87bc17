"""What of a drive cannot be used is one line: what, where, how to mend it."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import roadfiber as rf
from roadfiber.locate_commands import pictured
from solver.drive.car import car_of
from solver.drive.operator_map import read_operator_map
from solver.drive.path import MISTAKES, path_of
from solver.drive.response import Clock, legs_of
from solver.drive.rounds import check_found
from solver.drive.waterfall import SeenDrive
from solver.start.alignment import NotFollowingError
from vision.contract import LocalFrame

FRAME = LocalFrame((32.113, 34.804), 78.0)


def test_gps_in_local_time(drive: rf.Drive) -> None:
    moved = drive.tracks.assign(time=drive.tracks["time"] + pd.Timedelta(hours=3))
    with pytest.raises(rf.InputError, match=r"3 h apart, as where one is in local time; write both in UTC"):
        rf.locate(replace(drive, tracks=moved))


def test_drive_read_as_a_street(site: Path) -> None:
    with pytest.raises(rf.InputError, match=r"\[route\] makes it a drive; read it with roadfiber.read"):
        rf.Survey.read(site)


def test_gps_of_another_day(drive: rf.Drive) -> None:
    moved = drive.tracks.assign(time=drive.tracks["time"] + pd.Timedelta(days=40))
    with pytest.raises(rf.InputError, match="give a record of the drive"):
        rf.locate(replace(drive, tracks=moved))


def test_map_of_another_place(drive: rf.Drive) -> None:
    with pytest.raises(rf.InputError, match=r"never comes within \d+ m of the map"):
        rf.locate(replace(drive, vertices=drive.vertices + 5000.0))


@pytest.mark.parametrize("right", MISTAKES)
def test_map_that_is_mirrored_or_turned(drive: rf.Drive, right: str) -> None:
    """It leads away from the drive, and was located along the few meters where both cross."""
    turn = np.array(MISTAKES[right])
    xy = drive.tracks[["x", "y"]].to_numpy() @ turn
    for mistaken in (
        replace(drive, vertices=drive.vertices @ turn),
        replace(drive, tracks=drive.tracks.assign(x=xy[:, 0], y=xy[:, 1])),
    ):
        with pytest.raises(rf.InputError, match="100 % would be if " + re.escape(right)):
            mistaken.check_near()


def test_record_of_another_cable_and_what_was_seen(drive: rf.Drive, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    start, _ = drive.span()
    time = start + np.arange(3000) * np.timedelta64(100, "ms")
    stated = {"gauge_length": 10.0, "quantity": "strain_rate", "scale": 1.0}
    silent = rf.Drive.of(
        *(rng.normal(0, 1e-9, (3000, 150)), drive.tracks, drive.vertices),
        **{"frame": drive.frame, "time": time, "distance": 8.0 * np.arange(150), **stated},
    )
    with pytest.raises(NotFollowingError, match="does not follow this drive") as caught:
        rf.locate(silent)
    seen: Any = caught.value.seen
    title = seen.figure().axes[0].get_title(loc="left").replace("\n", " ")
    assert re.match(r"\d+ of the \d+ channels beside which the car drove hear it, \d+ % are needed", title)
    assert seen.channels == (0, 149)
    assert pictured(caught.value, tmp_path / "run") == f"; what was seen: {tmp_path / 'run-refused.png'}"
    assert (tmp_path / "run-refused.png").read_bytes().startswith(b"\x89PNG")


def test_cable_in_loops_does_not_make_a_drive_found(drive: rf.Drive, run: rf.DriveRun) -> None:
    """Twelve channels hear the car, all others are laid into loops: the car's way takes more than twelve."""
    quiet, path, clock = drive.quiet(), path_of(drive.vertices), Clock(run.clock_offset)
    cell, hears = run.arrays["along"] + path.first, run.arrays["heard"]
    hears = hears & (np.cumsum(hears) <= 12)
    one: Any = SimpleNamespace(
        legs=legs_of(quiet, path, car_of(drive.tracks, quiet.start), clock),
        along=SimpleNamespace(cell=cell),
        channels=SimpleNamespace(loop=~hears),
    )
    one.picks = SimpleNamespace(audible=np.tile(hears, (one.legs.count, 1)))
    coarse: Any = SimpleNamespace(path=path, told_apart=True, clock_offset=clock.offset, cell=cell)
    with pytest.raises(NotFollowingError, match="only 7 % of the channels beside which the car drove hear it"):
        check_found(drive, quiet, coarse, one)


def test_car_is_drawn_where_it_is_expected(drive: rf.Drive, run: rf.DriveRun) -> None:
    quiet, path = drive.quiet(), path_of(drive.vertices)
    legs = legs_of(quiet, path, car_of(drive.tracks, quiet.start), Clock(run.clock_offset))
    seen = SeenDrive.of("no channel hears it", quiet, legs, run.arrays["along"] + path.first)
    known = np.interp(seen.time, run.arrays["car_time"], run.arrays["car_channel"])
    # By a loop of slack the car goes from one sample to the next, and the clock is the run's to a fraction of one.
    around = np.stack([np.roll(known, step) for step in (-1, 0, 1)])
    assert len(seen.time) > 500 and np.abs(seen.channel - around).min(0).max() < 2.0
    axes = seen.figure().axes[0]
    assert axes.get_title(loc="left") == "no channel hears it" and len(axes.lines) == 1


def test_car_that_stays(drive: rf.Drive) -> None:
    with pytest.raises(rf.InputError, match=r"no track goes farther than .* leave \[route\] out"):
        car_of(drive.tracks.iloc[:5], drive.source.start)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.csv", "x,y\n0,0\n", "no line of two points"),
        ("a.csv", "a,b\n0,0\n", "no columns latitude, longitude or x, y"),
        ("a.csv", "x,y\n" + "".join(f"{x},0\n" for x in (0, 90, 10, 80, 20, 70, 30, 60, 40, 50)), "in order along"),
        ("a.csv", "x,y\n0,0\n900,0\n0,0\n", "lies on itself along 17.. of 1800 m; draw the cable once"),
        ("a.csv", "x,y\n32.1,34.8\n32.2,34.9\n", "hold latitude and longitude"),
        ("a.shp", "", "unknown kind of map"),
        ("a.geojson", "{", "not JSON"),
        ("a.geojson", '{"type": "Point", "coordinates": [34.8, 32.1]}', "no line of two points"),
        ("a.geojson", '{"type": "LineString", "coordinates": [[32.1, 34.8], [32.2, 34.8]]}', "swapped"),
        ("a.kml", "<kml", "not a readable KML"),
    ],
)
def test_unfit_map(tmp_path: Path, name: str, text: str, told: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(rf.InputError, match=told):
        read_operator_map(tmp_path / name, FRAME)


def lines(*parts: list[tuple[float, float]]) -> str:
    """GeoJSON of several lines, m of the frame."""
    import json

    degrees = []
    for part in parts:
        latitude, longitude = FRAME.to_geographic(*np.array(part).T)
        degrees.append(np.stack([longitude, latitude], -1).tolist())
    return json.dumps({"type": "MultiLineString", "coordinates": degrees})


def test_maps_that_cross_and_that_join(tmp_path: Path) -> None:
    path = tmp_path / "a.geojson"
    path.write_text(lines([(0, 0), (900, 0)], [(400, -300), (400, 300)]))
    with pytest.raises(rf.InputError, match="2 lines that cross"):
        read_operator_map(path, FRAME)
    path.write_text(lines([(0, 0), (900, 0)], [(0, 500), (900, 500)]))
    with pytest.raises(rf.InputError, match="2 lines that are 500 m apart"):
        read_operator_map(path, FRAME)
    path.write_text(lines([(0, 0), (900, 0)], [(0, 30), (880, 30)]))
    with pytest.raises(rf.InputError, match=r"2 lines that lie beside each other.*: line 1, line 2; keep the one"):
        read_operator_map(path, FRAME)
    path.write_text(lines([(0, 0), (900, 0), (900, 0)], [(1800, 0), (905, 0)]))
    assert read_operator_map(path, FRAME)[:, 0].round().tolist() == [0, 900, 905, 1800]


def test_a_line_that_is_there_twice_is_one(tmp_path: Path) -> None:
    """As a whole, from its other end, or in parts that another layer has as one."""
    path, line = tmp_path / "a.geojson", [(0, 0), (900, 0), (900, 700)]
    for again in ([line], [line[::-1]], [line[1:], line[:2]], [[(50, 0), (800, 0)]]):
        path.write_text(lines(*again, line))
        found = read_operator_map(path, FRAME).round()
        assert np.array_equal(found, line) or np.array_equal(found, line[::-1])


def test_kml_and_damaged_geopackage(tmp_path: Path) -> None:
    latitude, longitude = FRAME.to_geographic([0.0, 70.0], [0.0, 5.0])
    points = " ".join(f"{b:.9f},{a:.9f},0" for a, b in zip(latitude, longitude, strict=True))
    path = tmp_path / "a.kml"
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><LineString><coordinates>'
        f"{points}</coordinates></LineString></Placemark></kml>"
    )
    assert read_operator_map(path, FRAME).round(2).tolist() == [[0.0, 0.0], [70.0, 5.0]]
    (tmp_path / "a.gpkg").write_text("")
    with pytest.raises(rf.InputError, match=r"geopandas|not a readable GeoPackage"):
        read_operator_map(tmp_path / "a.gpkg", FRAME)


def test_route_without_gps(site: Path, tmp_path: Path) -> None:
    text = site.read_text().partition("[trajectories]")[0]
    (site.parent / "nogps.toml").write_text(text.replace('"das/*.h5"', '"das/das_0001.h5"'))
    with pytest.raises(rf.InputError, match=r"give one of them|without \[trajectories\]"):
        rf.read(site.parent / "nogps.toml")
