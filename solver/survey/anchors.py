"""Anchors: fiber points known from a manhole or a tap test."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from solver.survey.limits import VEHICLE_REACH
from vision.contract import InputError, LocalFrame
from vision.contract.columns import (
    check_meters,
    check_names,
    check_positive,
    finite,
    first_row,
    to_frame,
    with_positions,
)
from vision.contract.csv_table import read_csv
from vision.contract.geometry import SUFFIXES, read_features
from vision.contract.statements import Statement, Statements
from vision.contract.table import PLACES, decimals_of, with_rounding

if TYPE_CHECKING:
    import pandas as pd

#: Anchors farther than this from some channels, in meters of fiber, say nothing about them.
ANCHOR_REACH = 50.0
COLUMNS = ("name", "channel", "x", "y", "z", "sigma_xy", "sigma_z")
METERS = {f"{name}_m": name for name in COLUMNS[4:]}  # as an exported map names them


@dataclass(frozen=True)
class Anchor:
    """A point of the fiber whose channel and place are known.

    Parameters
    ----------
    name : of the manhole or tap
    channel : its channel, as the DAS file counts (a fraction is a place between two channels)
    x, y, z : m, local frame
    sigma_xy, sigma_z : standard deviation of each horizontal coordinate and of the depth, m
    """

    name: str
    channel: float
    x: float
    y: float
    z: float
    sigma_xy: float
    sigma_z: float


def within_reach(anchors: Sequence[Anchor], channels: tuple[int, int], spacing: float) -> list[Anchor]:
    """Anchors on channels from a first to a last one, or so little beyond that they say something about these.

    >>> near, far = Anchor("a", 140, 0, 0, 1, 0.1, 0.1), Anchor("b", 160, 0, 0, 1, 0.1, 0.1)
    >>> [one.name for one in within_reach([near, far], (0, 100), 1.0)]
    ['a']
    """
    first, last = (end + way * ANCHOR_REACH / spacing for end, way in zip(channels, (-1, 1), strict=True))
    return [one for one in anchors if first <= one.channel <= last]


def read_anchors(path: Path, frame: LocalFrame) -> list[Anchor]:
    r"""Read anchors from csv, or from the points of a GeoJSON, KML or GeoPackage file.

    Parameters
    ----------
    path : columns `name, channel, x, y, z, sigma_xy, sigma_z`, or `latitude, longitude` (or `lat, lon`) in place
        of x, y; points have the same as attributes but for x and y, z too: the depth below the road, m (or z_m,
        sigma_xy_m, sigma_z_m, as an exported map has them)
    frame : local frame that latitude and longitude are projected into

    Returns
    -------
    anchors sorted by channel

    Raises
    ------
    InputError
        If the file is missing, empty or lacks a column, a value is not a number, a sigma is not positive, a name or a
        channel occurs twice, a depth is not valid, or latitude and longitude are out of range or swapped.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "anchors.csv"
    >>> _ = path.write_text("name,channel,x,y,z,sigma_xy,sigma_z\nwest,84,12.48,4.75,0.96,0.05,0.05\n")
    >>> read_anchors(path, LocalFrame((32.1, 34.8), 78.0))[0].channel
    84.0
    """
    return stated_anchors(path, frame)[0]


def stated_anchors(path: Path, frame: LocalFrame) -> tuple[list[Anchor], tuple[Statements, ...]]:
    """Read anchors, as `read_anchors` does, and what of the file must be told; nothing where all is well."""
    import pandas as pd

    text = path.suffix.lower() not in SUFFIXES
    table = read_csv(path, ["name"]) if text else point_table(path)
    anchors, told = anchors_of(table, frame, path), list[Statement]()
    if not text:
        return anchors, ()
    degrees = None if "x" in with_positions(table) else frame
    for names, sigma, where in ((PLACES, "sigma_xy", degrees), (("z",), "sigma_z", None)):
        known = pd.DataFrame(map(vars, anchors))
        known, found = with_rounding(known, where, decimals_of(path, names) or 0, [sigma], "anchors")
        anchors = [
            Anchor(**vars(one) | {sigma: float(value)}) for one, value in zip(anchors, known[sigma], strict=True)
        ]
        told += found
    return anchors, (Statements(path.name, tuple(told)),) * bool(told)


def point_table(path: Path) -> "pd.DataFrame":
    """Points with attributes as an anchors table in latitude and longitude."""
    import pandas as pd

    points = [
        (one.coordinates[0], {METERS.get(name, name): value for name, value in one.properties.items()})
        for one in read_features(path)
        if one.kind == "Point"
    ]
    found = [(place, known) for place, known in points if {"channel", "sigma_xy"} <= set(known)]
    if not found:
        raise InputError(
            f"{path}: no point with the attributes channel and sigma_xy; an anchor has name, channel, z (depth below "
            "the road, m), sigma_xy and sigma_z"
        )
    names = [name for name in COLUMNS if name not in ("x", "y")]
    rows = [{name: known[name] for name in names if name in known} for _, known in found]
    places = {
        "latitude": [place[1] for place, _ in found],
        "longitude": [place[0] for place, _ in found],
    }
    return pd.DataFrame(rows).assign(**places)


def anchors_of(table: "pd.DataFrame", frame: LocalFrame, path: Path = Path("anchors")) -> list[Anchor]:
    """Anchors from a table in memory: columns, result and errors as in `read_anchors`; `path` names it in errors.

    >>> import pandas as pd
    >>> row = {"name": "west", "channel": 84, "x": 12.48, "y": 4.75, "z": 0.96, "sigma_xy": 0.05, "sigma_z": 0.05}
    >>> anchors_of(pd.DataFrame([row]), LocalFrame((32.1, 34.8), 78.0))[0].x
    12.48
    """
    table = with_positions(table)
    geographic = "latitude" in table and "x" not in table
    names = tuple({"x": "latitude", "y": "longitude"}.get(name, name) if geographic else name for name in COLUMNS)
    if missing := [name for name in names if name not in table]:
        raise InputError(f"{path}: no column {', '.join(missing)}; an anchors table has {', '.join(COLUMNS)}")
    if table.empty:
        raise InputError(f"{path}: no anchors; write one row per anchor or leave [anchors] out of site.toml")
    table = finite(table.assign(name=table["name"].map(str)), names[1:], path)
    check_names(table, ("name",), path)
    check_positive(table, ("sigma_xy", "sigma_z"), path)
    if (wrong := (table["z"] <= 0) | (table["z"] > VEHICLE_REACH)).any():
        row = first_row(wrong)
        raise InputError(
            f"{path}: row {row}: z is {table['z'].iloc[row - 1]:g}; z points down: give the depth below the road, m, "
            f"above 0 and at most {VEHICLE_REACH:g}"
        )
    for name in ("name", "channel"):
        if table[name].duplicated().any():
            row = first_row(table[name].duplicated())
            raise InputError(f"{path}: row {row}: {name} {table[name].iloc[row - 1]} is there twice; keep one")
    if geographic:
        x, y = to_frame(table["latitude"].to_numpy(), table["longitude"].to_numpy(), frame, path)
        table = table.assign(x=x, y=y)
    else:  # a single anchor may lie at the frame's degrees by chance
        check_meters(table, frame if len(table) > 1 else None, path)
    ordered = table.sort_values("channel")
    return [Anchor(str(row[0]), *map(float, row[1:])) for row in ordered[list(COLUMNS)].itertuples(index=False)]
