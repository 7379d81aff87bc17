"""The operator's map of a cable: GeoJSON, KML, csv or GeoPackage -> points in order along it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, LocalFrame
from vision.contract.columns import check_meters, finite, to_frame, with_positions
from vision.contract.csv_table import read_csv
from vision.contract.geometry import SUFFIXES, Feature, read_features

Array = NDArray[np.float64]

#: Ends of two lines this near, m, are one place.
JOINED = 50.0
#: Points closer than this, m, are one.
SAME = 0.01
#: A path in order turns back, by more than 120 degrees, at no more than this share of its points.
TURNS_BACK = 0.1


def read_operator_map(path: Path, frame: LocalFrame) -> Array:
    r"""Read the path of a cable.

    Parameters
    ----------
    path : GeoJSON with one LineString, or several that join end to end; KML likewise; csv with `latitude, longitude` or
        `x, y` (m), a row per point in order; GeoPackage likewise (needs roadfiber[gis])
    frame : the local frame

    Returns
    -------
    points [point, 2], m, two at least, no two neighbors at one place

    Raises
    ------
    InputError
        If the file cannot be read, holds no line or lines that do not join, or its points are not in order.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "map.csv"
    >>> _ = path.write_text("x,y\n0,0\n0,0\n60,5\n")
    >>> read_operator_map(path, LocalFrame((32.1, 34.8), 90.0)).tolist()
    [[0.0, 0.0], [60.0, 5.0]]
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        lines = [csv_line(path, frame)]
    elif path.suffix.lower() in SUFFIXES:
        lines = [in_frame(one, frame, path) for one in read_features(path) if one.kind == "LineString"]
    else:
        raise InputError(f"{path}: unknown kind of map; give one of .csv, {', '.join(SUFFIXES)}")
    lines = [one for one in map(without_repeats, lines) if len(one) > 1]
    if not lines:
        raise InputError(f"{path}: no line of two points or more; give the cable's path as a line")
    joined = chained(lines, path)
    check_order(joined, path)
    return joined


def csv_line(path: Path, frame: LocalFrame) -> Array:
    """Points of a csv file, m."""
    table = with_positions(read_csv(path, ()))
    if "latitude" in table and "longitude" in table:
        table = finite(table, ("latitude", "longitude"), path)
        x, y = to_frame(table["latitude"].to_numpy(), table["longitude"].to_numpy(), frame, path)
        return np.stack([x, y], -1)
    if not {"x", "y"} <= set(table):
        raise InputError(f"{path}: no columns latitude, longitude or x, y; a map has one row per point, in order")
    table = finite(table, ("x", "y"), path)
    check_meters(table, frame, path)
    return table[["x", "y"]].to_numpy(float)


def in_frame(line: Feature, frame: LocalFrame, path: Path) -> Array:
    """Points of a line [point, 2], m."""
    return np.stack(to_frame(line.coordinates[:, 1], line.coordinates[:, 0], frame, path), -1)


def without_repeats(line: Array) -> Array:
    """A line without points that repeat their neighbor."""
    if len(line) < 2:
        return line
    return line[np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > SAME])]


def chained(lines: list[Array], path: Path) -> Array:
    """Lines joined end to end, each turned as it must be.

    Raises
    ------
    InputError
        If one does not join the others.

    >>> one, other = np.array([[0.0, 0], [10, 0]]), np.array([[30.0, 0], [12, 0]])
    >>> chained([one, other], Path("a"))[:, 0].tolist()
    [0.0, 10.0, 12.0, 30.0]
    """
    whole, rest = lines[0], lines[1:]
    while rest:
        ends = [(whole[-1], 1), (whole[0], 0)]
        near = [
            (float(np.hypot(*(line[at] - end))), number, at, last)
            for end, last in ends
            for number, line in enumerate(rest)
            for at in (0, -1)
        ]
        gap, number, at, last = min(near)
        if gap > JOINED:
            how = "cross" if any(crosses(whole, line) for line in rest) else f"are {gap:.0f} m apart"
            raise InputError(f"{path}: holds {len(lines)} lines that {how}; keep the one of the cable that is recorded")
        line = rest.pop(number)
        line = line if (at == 0) == bool(last) else line[::-1]
        whole = np.concatenate([whole, line] if last else [line, whole])
    return without_repeats(whole)


def crosses(one: Array, other: Array) -> bool:
    """Whether two lines cross.

    >>> crosses(np.array([[0.0, 0], [2, 2]]), np.array([[0.0, 2], [2, 0]]))
    True
    """
    a, b = one[:-1, None], one[1:, None]
    c, d = other[None, :-1], other[None, 1:]

    def side(p: Array, q: Array, r: Array) -> Array:
        found: Array = (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (
            r[..., 0] - p[..., 0]
        )
        return found

    return bool(((side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)).any())


def check_order(line: Array, path: Path) -> None:
    """Raise InputError where points jump to and fro."""
    step = np.diff(line, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    back = (step[1:] * step[:-1]).sum(1) < -0.5
    if back.sum() > max(2, TURNS_BACK * len(line)):
        raise InputError(
            f"{path}: the line turns back at {back.sum()} of {len(line)} points; put them in order along the cable"
        )
