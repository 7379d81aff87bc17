"""The operator's map of a cable: GeoJSON, KML, csv or GeoPackage -> points in order along it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.drive.path import STEP
from vision.contract import InputError, LocalFrame
from vision.contract.columns import check_meters, finite, to_frame, with_positions
from vision.contract.csv_table import read_csv
from vision.contract.geometry import SUFFIXES, Feature, read_features

Array = NDArray[np.float64]

#: Ends of two lines this near, m, are one place.
JOINED = 50.0
#: Points closer than this, m, are one.
SAME = 0.01
#: Cosine of the angle by which a path turns back, 120 degrees; at which share of its points it may if in order, and
#: along which share of its length it may lie on itself.
BACK, TURNS_BACK = -0.5, 0.1


class Line(NamedTuple):
    """A line of a map: what it is called, and its points [point, 2], m."""

    name: str
    points: Array


def read_operator_map(path: Path, frame: LocalFrame) -> Array:
    r"""Read the path of a cable.

    Parameters
    ----------
    path : GeoJSON with one LineString, or several that join end to end; KML likewise; csv with `latitude, longitude` or
        `x, y` (m), a row per point in order; GeoPackage likewise; a line that is there twice, or
        lies on another, counts once
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
        lines = [Line(path.name, csv_line(path, frame))]
    elif path.suffix.lower() in SUFFIXES:
        drawn = [one for one in read_features(path) if one.kind == "LineString"]
        names = [str(one.properties.get("name") or f"line {number}") for number, one in enumerate(drawn, 1)]
        lines = [Line(name, in_frame(one, frame, path)) for name, one in zip(names, drawn, strict=True)]
    else:
        raise InputError(f"{path}: unknown kind of map; give one of .csv, {', '.join(SUFFIXES)}")
    lines = [one._replace(points=without_repeats(one.points)) for one in lines]
    lines = [one for one in lines if len(one.points) > 1]
    if not lines:
        raise InputError(f"{path}: no line of two points or more; give the cable's path as a line")
    joined = chained(once(lines), path)
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


def once(lines: list[Line]) -> list[Line]:
    """Lines without those that lie on another.

    >>> line = np.array([[0.0, 0], [40, 0], [90, 30]])
    >>> [one.name for one in once([Line("a", line), Line("b", line[::-1]), Line("c", line[:2])])]
    ['a']
    """
    kept: list[Line] = []
    for one in sorted(lines, key=lambda line: -stepped(line.points)[0][-1]):
        if not any(lies_on(one.points, other.points) for other in kept):
            kept.append(one)
    return [one for one in lines if any(one is other for other in kept)]


def lies_on(line: Array, other: Array) -> bool:
    """Whether a line is no farther from another than points of a path are from each other."""
    from scipy.spatial import KDTree

    if (line.min(0) < other.min(0) - STEP).any() or (line.max(0) > other.max(0) + STEP).any():
        return False
    return bool(KDTree(stepped(other)[1]).query(stepped(line)[1])[0].max() < STEP)


def stepped(line: Array) -> tuple[Array, Array]:
    """Meters along a line [step] and points there [step, 2], half a `STEP` apart, its end the last."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.append(np.arange(0.0, arc[-1], STEP / 2), arc[-1])
    return at, np.stack([np.interp(at, arc, column) for column in line.T], -1)


def chained(lines: list[Line], path: Path) -> Array:
    """Lines joined end to end [point, 2], each turned as it must be.

    Raises
    ------
    InputError
        If one does not continue the others.

    >>> one, other = np.array([[0.0, 0], [10, 0]]), np.array([[30.0, 0], [12, 0]])
    >>> chained([Line("a", one), Line("b", other)], Path("a"))[:, 0].tolist()
    [0.0, 10.0, 12.0, 30.0]
    """
    whole, rest = lines[0].points, [one.points for one in lines[1:]]

    def refuse(how: str) -> InputError:
        names = ", ".join(one.name for one in lines[:5]) + (", ..." if len(lines) > 5 else "")
        return InputError(
            f"{path}: holds {len(lines)} lines that {how}: {names}; keep the one of the cable that is recorded, and "
            "draw it as one line"
        )

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
            raise refuse("cross" if any(crosses(whole, line) for line in rest) else f"are {gap:.0f} m apart")
        line = rest.pop(number)
        line = line if (at == 0) == bool(last) else line[::-1]
        before, after = (whole, line) if last else (line, whole)
        if heading(after) @ -heading(before[::-1]) < BACK:
            raise refuse("lie beside each other, or turn back where they meet")
        whole = np.concatenate([before, after])
    return without_repeats(whole)


def heading(line: Array) -> Array:
    """Direction [2] in which a line begins, over as many meters as another may be away that it joins."""
    at, points = stepped(line)
    way = points[np.searchsorted(at, min(JOINED, at[-1]))] - points[0]
    return np.asarray(way / np.hypot(*way))


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
    """Raise InputError where points jump to and fro, or the line goes one way twice: a car is beside both parts."""
    from scipy.spatial import KDTree

    step = np.diff(line, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    back = (step[1:] * step[:-1]).sum(1) < BACK
    if back.sum() > max(2, TURNS_BACK * len(line)):
        raise InputError(
            f"{path}: the line turns back at {back.sum()} of {len(line)} points; put them in order along the cable"
        )
    at, points = stepped(line)
    pairs = KDTree(points).query_pairs(STEP, output_type="ndarray")
    again = np.unique(pairs[np.abs(np.diff(at[pairs])[:, 0]) > JOINED])
    if len(again) > TURNS_BACK * len(at):
        raise InputError(
            f"{path}: the line lies on itself along {len(again) * STEP / 2:.0f} of {at[-1]:.0f} m; draw the cable once"
        )
