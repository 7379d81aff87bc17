"""Control points: marks on the road whose pixels and places are both known."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.point_tables import COLUMNS, PLACES, place_columns, read_table, with_meters
from vision.contract import InputError, LocalFrame, writing
from vision.contract.columns import check_positive, finite, first_row

if TYPE_CHECKING:
    import pandas as pd

log = logging.getLogger("roadfiber.calibrate")

Array = NDArray[np.float64]
PIXEL_SIGMA = 1.0  # px; accuracy of a click, if the file does not say
# m; accuracy of a place, if the file does not say: measured on the road in meters, and read from a map, an aerial
# picture or a receiver. Errors of up to .05 and .3 m then leave 95 % of positions inside their 95 % ellipse, and places
# known better cost little (`benchmarks/calibration.py places`).
PLACE_SIGMA, MAP_SIGMA = 0.05, 0.3
# Where x and y of a file may point, seen from above; the first are those of the local frame.
AXES = ("ahead,right", "ahead,left", "right,ahead", "east,north")


@dataclass(frozen=True)
class ControlPoints:
    """Marks on the road.

    Attributes
    ----------
    names : [point]
    pixels : [point, 2] px from the top left of the image, right and down
    ground : [point, 2] m, x and y of the local frame
    sigma : [point] px; standard deviation of each pixel coordinate
    sigma_xy : [point] m; standard deviation of each ground coordinate
    z : [point] m, below the road: negative above it; None where all are on the road, as fits want them (`on_road`)
    """

    names: tuple[str, ...]
    pixels: Array
    ground: Array
    sigma: Array
    sigma_xy: Array
    z: Array | None = None

    def __len__(self) -> int:
        return len(self.names)

    def select(self, keep: NDArray[np.bool_]) -> "ControlPoints":
        """Keep the points where `keep` [point] is true."""
        names = tuple(np.array(self.names)[keep].tolist())
        z = None if self.z is None else self.z[keep]
        return ControlPoints(names, self.pixels[keep], self.ground[keep], self.sigma[keep], self.sigma_xy[keep], z)

    def without(self, index: int) -> "ControlPoints":
        """Leave out one point."""
        return self.select(np.arange(len(self)) != index)


def control_points(names: tuple[str, ...], pixels: Array, ground: Array, sigma: float = PIXEL_SIGMA) -> ControlPoints:
    """Control points with the same `sigma`, px, at places without error.

    >>> control_points(("curb",), np.array([[312.5, 401.0]]), np.array([[10.0, -3.5]])).sigma.tolist()
    [1.0]
    """
    return ControlPoints(names, pixels, ground, np.full(len(names), sigma), np.zeros(len(names)))


def read_control_points(
    path: str | Path, frame: LocalFrame | None = None, crs: str | None = None, axes: str = AXES[0]
) -> ControlPoints:
    r"""Read control points from csv, json or OTVision's .otrfpts.

    Parameters
    ----------
    path : columns `name, px, py` and `x, y` (m), or `latitude, longitude` (degrees, WGS 84), or `easting, northing`
        (m) with `zone` (UTM, as 32N) or `crs`; optionally `sigma`, px, accuracy of the mark in the image (1 px if
        absent), and `sigma_xy`, m, accuracy of its measured place (if absent, 0.05 for x and y, else 0.3, which is
        told), and `z`, m, below the road: -0.15 for the top of a curb (0 if absent); other columns are told and ignored
    frame : local frame that geographic and projected coordinates are turned into
    crs : coordinate reference system of easting and northing without a zone, as EPSG:25832
    axes : one of `AXES`: where x and y point

    Raises
    ------
    InputError
        If the file is missing, empty or lacks a column, a value is not a number, a sigma is not positive, a name or a
        point occurs twice, coordinates look swapped, or there are latitudes and no frame.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "points.csv"
    >>> _ = path.write_text("name,px,py,x,y\ncurb,312.5,401,10,-3.5\n")
    >>> read_control_points(path).ground.tolist()
    [[10.0, -3.5]]
    """
    path = Path(path)
    table = read_table(path)
    if missing := [name for name in COLUMNS[:3] if name not in table]:
        raise InputError(f"{path}: no column {', '.join(missing)}; control points have {', '.join(COLUMNS)}")
    places = place_columns(table, path)
    used = {*COLUMNS[:3], *places, "sigma", "sigma_xy", "z", *(("zone",) if places == PLACES[2] else ())}
    if unused := [str(name) for name in table if name not in used]:
        log.warning("%s: not used: column %s (heights are read from z, m, down from the road)", path, ", ".join(unused))
    usual = PLACE_SIGMA if places == PLACES[0] else MAP_SIGMA
    table = with_axes(with_meters(table, frame, crs, path), axes, places == PLACES[0], frame)
    defaults = {"sigma": PIXEL_SIGMA, "sigma_xy": usual, "z": 0.0}
    absent = {name: value for name, value in defaults.items() if name not in table}
    told = {"sigma": f"sigma = {PIXEL_SIGMA:g} px of the marks", "sigma_xy": f"sigma_xy = {usual:g} m of the places"}
    if assumed := [words for name, words in told.items() if name in absent]:
        log.warning("%s: does not say how accurate it is; assumed: %s", path, ", ".join(assumed))
    table = table.assign(**absent)
    table = finite(table, ("px", "py", "sigma", "sigma_xy", "z"), path)
    check_positive(table, ("sigma",), path, unit="px")
    _refuse_negative(table, path)
    _refuse_repeats(table, path)
    if table["z"].any() and (table["z"] >= 0).all():
        raise InputError(
            f"{path}: row {first_row(table['z'] > 0)}: z is {table['z'].max():g}, below the road; z points down from "
            "it: give -0.15 for the top of a curb 15 cm high"
        )
    return ControlPoints(
        tuple(table["name"].astype(str)),
        table[["px", "py"]].to_numpy(float),
        table[["x", "y"]].to_numpy(float),
        table["sigma"].to_numpy(float),
        table["sigma_xy"].to_numpy(float),
        table["z"].to_numpy(float) if table["z"].any() else None,
    )


def with_axes(table: "pd.DataFrame", axes: str, meters: bool, frame: LocalFrame | None) -> "pd.DataFrame":
    """Turn x and y [point] that point elsewhere into those of the local frame: x ahead, y to the right of it.

    Parameters
    ----------
    axes : one of `AXES`
    meters : whether x and y are as given, rather than latitudes and the like
    frame : local frame, for x to the east and y to the north

    >>> import pandas as pd
    >>> with_axes(pd.DataFrame({"x": [3.5], "y": [20.0]}), "right,ahead", True, None).to_numpy().tolist()
    [[20.0, 3.5]]
    """
    if axes not in AXES:
        raise InputError(f"--axes {axes}: give one of {' or '.join(AXES)}")
    if axes == AXES[0]:
        return table
    if not meters:
        raise InputError(f"--axes {axes}: is for x and y in meters; latitudes and eastings need none")
    if axes == "east,north" and frame is None:
        raise InputError("--axes east,north: needs the local frame; give --frame site.toml or --origin and --x-azimuth")
    x, y = table["x"], table["y"]
    if axes == "ahead,left":
        return table.assign(y=-y)
    turn = np.deg2rad(frame.x_azimuth) if axes == "east,north" and frame else 0.0
    return table.assign(x=x * np.sin(turn) + y * np.cos(turn), y=x * np.cos(turn) - y * np.sin(turn))


def write_control_points(points: ControlPoints, path: str | Path) -> None:
    """Write the csv that `read_control_points` reads, in meters, whole or not at all."""
    import pandas as pd

    table = pd.DataFrame(
        {
            "name": points.names,
            "px": points.pixels[:, 0],
            "py": points.pixels[:, 1],
            "x": points.ground[:, 0],
            "y": points.ground[:, 1],
            "sigma": points.sigma,
            "sigma_xy": points.sigma_xy,
        }
    )
    with writing(path) as temporary:
        table.to_csv(temporary, index=False, float_format="%.10g")


def _refuse_negative(table: "pd.DataFrame", path: Path) -> None:
    negative = table["sigma_xy"] < 0
    if negative.any():
        row = first_row(negative)
        raise InputError(f"{path}: row {row}: sigma_xy is {table['sigma_xy'].iloc[row - 1]:g}; give 0 m or more")


def _refuse_repeats(table: "pd.DataFrame", path: Path) -> None:
    for columns, what in ((["name"], "name"), (["px", "py"], "pixel"), (["x", "y"], "place")):
        twice = table.duplicated(columns)
        if twice.any():
            row = first_row(twice)
            raise InputError(f"{path}: row {row}: its {what} is there twice; keep one")
