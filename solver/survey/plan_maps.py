"""Lanes and anchors of `[plan]` from files of a map: GeoJSON, KML, GeoPackage."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from solver.survey.plan_section import MASSES
from solver.survey.site_sections import FrameSection
from vision.contract import InputError, LocalFrame
from vision.contract.columns import to_frame
from vision.contract.geometry import Feature, read_features

Array = NDArray[np.float64]

#: m that a lane may leave its mean y by: a plan's lanes are straight.
STRAIGHT = 1.0


def with_maps(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The content of a site.toml whose plan names files for `lanes` or `anchors`, with what those hold in their place.

    Parameters
    ----------
    content : of site.toml, unchecked
    folder : that the files' names are relative to

    Raises
    ------
    InputError
        If a file cannot be used as lanes or anchors, or `[frame]` is missing or wrong.

    >>> with_maps({"plan": {"lanes": [], "length": 60.0}}, Path())
    {'plan': {'lanes': [], 'length': 60.0}}
    """
    plan = content.get("plan")
    if not isinstance(plan, dict):
        return dict(content)
    readers = {"lanes": lanes_of, "anchors": anchors_of}
    named = [name for name in readers if isinstance(plan.get(name), str)]
    if not named:
        return dict(content)
    path, length = folder / plan[named[0]], plan.get("length")
    if not isinstance(length, int | float):
        raise InputError(f"{path}: the plan has no length; add it, m")
    try:
        section = FrameSection.model_validate(content.get("frame"))
    except ValidationError as error:
        raise InputError(f"{path}: a map needs [frame] in site.toml, with origin and x_azimuth") from error
    frame = LocalFrame(section.origin, section.x_azimuth)
    read: dict[str, Any] = {name: readers[name](folder / plan[name], frame, float(length)) for name in named}
    return {**content, "plan": plan | read}


def lanes_of(path: Path, frame: LocalFrame, length: float) -> list[dict[str, Any]]:
    """Lanes of a file: lines drawn the way that vehicles go, with how many of each class as attributes.

    Parameters
    ----------
    path : lines with attributes of the names `car`, `van`, `truck`, `bus`; other lines are left out
    frame : local frame
    length : of the planned road from x = 0 on, m

    Returns
    -------
    lanes : tables as site.toml has them, in the order of the file

    Raises
    ------
    InputError
        If there is none, a number of vehicles is not whole, or a lane is not beside the planned road or not straight.
    """
    lines = [one for one in read_features(path) if one.kind == "LineString" and set(MASSES) & set(one.properties)]
    if not lines:
        raise InputError(
            f"{path}: no line that says how many vehicles go along it; give lanes as lines with one of the attributes "
            f"{', '.join(MASSES)}, drawn the way that vehicles go"
        )
    return [lane_of(line, f"{path}: lane {number}", frame, length) for number, line in enumerate(lines, 1)]


def lane_of(line: Feature, where: str, frame: LocalFrame, length: float) -> dict[str, Any]:
    """One lane of a file, in the local frame."""
    x, y = in_frame(line, frame, where)
    way = np.sign(x[-1] - x[0])
    if len(x) < 2 or (np.diff(x) * way <= 0).any():
        raise InputError(f"{where} does not run along the road; draw it the way that vehicles go, or turn x_azimuth")
    x, y = x[:: int(way)], y[:: int(way)]
    low, high = max(0.0, x[0]), min(length, x[-1])
    if low >= high:
        raise InputError(
            f"{where} lies from x {x[0]:.0f} to {x[-1]:.0f} m, beside no road of the plan (0 to {length:g} m)"
        )
    there = np.unique([low, high, *x[(x > low) & (x < high)]])
    along = np.interp(there, x, y)
    middle = float(np.trapezoid(along, there) / (high - low))
    if (bend := float(np.abs(along - middle).max())) > STRAIGHT:
        raise InputError(
            f"{where} leaves y = {middle:.1f} m by {bend:.1f} m; plan a stretch on which the road is straight, or turn "
            "x_azimuth"
        )
    vehicles = dict(vehicles_of(line, where))
    return {"y": round(middle, 3), "toward": "+x" if way > 0 else "-x", "vehicles": vehicles}


def vehicles_of(line: Feature, where: str) -> Iterator[tuple[str, int]]:
    """Classes and numbers of a lane's attributes; those left empty are none."""
    for name in MASSES:
        value = line.properties.get(name)
        if value is None or value == "":
            continue
        try:
            count = float(value)
        except (TypeError, ValueError):
            count = np.nan
        if not (count >= 0 and count.is_integer()):
            raise InputError(f"{where}: {name} is {value!r}; give a whole number of vehicles")
        yield name, int(count)


def anchors_of(path: Path, frame: LocalFrame, length: float) -> list[float]:
    """Places x of the anchors of a file, m: its points beside the planned road.

    Raises
    ------
    InputError
        If no point lies there.
    """
    points = [one for one in read_features(path) if one.kind == "Point"]
    found = [float(in_frame(one, frame, str(path))[0][0]) for one in points]
    beside = sorted(round(x, 3) for x in found if 0 <= x <= length)
    if not beside:
        raise InputError(f"{path}: no point lies beside the planned road (x from 0 to {length:g} m)")
    return beside


def in_frame(one: Feature, frame: LocalFrame, where: str) -> tuple[Array, Array]:
    """Coordinates x and y of a feature's vertices, m."""
    return to_frame(one.coordinates[:, 1], one.coordinates[:, 0], frame, Path(where))
