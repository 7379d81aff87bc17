"""Control points: marks on the road whose pixels and places are both known."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.point_tables import COLUMNS, read_table, with_meters
from vision.contract import InputError, LocalFrame, writing
from vision.contract.columns import check_positive, finite, first_row

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
PIXEL_SIGMA = 1.0  # px; accuracy of a click, if the file does not say


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
    """

    names: tuple[str, ...]
    pixels: Array
    ground: Array
    sigma: Array
    sigma_xy: Array

    def __len__(self) -> int:
        return len(self.names)

    def select(self, keep: NDArray[np.bool_]) -> "ControlPoints":
        """Keep the points where `keep` [point] is true."""
        names = tuple(np.array(self.names)[keep].tolist())
        return ControlPoints(names, self.pixels[keep], self.ground[keep], self.sigma[keep], self.sigma_xy[keep])

    def without(self, index: int) -> "ControlPoints":
        """Leave out one point."""
        return self.select(np.arange(len(self)) != index)


def control_points(names: tuple[str, ...], pixels: Array, ground: Array, sigma: float = PIXEL_SIGMA) -> ControlPoints:
    """Control points with the same `sigma`, px, at places without error.

    >>> control_points(("curb",), np.array([[312.5, 401.0]]), np.array([[10.0, -3.5]])).sigma.tolist()
    [1.0]
    """
    return ControlPoints(names, pixels, ground, np.full(len(names), sigma), np.zeros(len(names)))


def read_control_points(path: str | Path, frame: LocalFrame | None = None, crs: str | None = None) -> ControlPoints:
    r"""Read control points from csv, json or OTVision's .otrfpts.

    Parameters
    ----------
    path : columns `name, px, py` and `x, y` (m), or `latitude, longitude` (degrees, WGS 84), or `easting, northing`
        (m) with `zone` (UTM, as 32N) or `crs`; optionally `sigma`, px, accuracy of the mark in the image (1 px if
        absent), and `sigma_xy`, m, accuracy of its measured place (0 if absent); other columns are ignored
    frame : local frame that geographic and projected coordinates are turned into
    crs : coordinate reference system of easting and northing without a zone, as EPSG:25832

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
    table = with_meters(table, frame, crs, path)
    absent = {name: value for name, value in (("sigma", PIXEL_SIGMA), ("sigma_xy", 0.0)) if name not in table}
    table = table.assign(**absent)
    table = finite(table, ("px", "py", "sigma", "sigma_xy"), path)
    check_positive(table, ("sigma",), path, unit="px")
    _refuse_negative(table, path)
    _refuse_repeats(table, path)
    return ControlPoints(
        tuple(table["name"].astype(str)),
        table[["px", "py"]].to_numpy(float),
        table[["x", "y"]].to_numpy(float),
        table["sigma"].to_numpy(float),
        table["sigma_xy"].to_numpy(float),
    )


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
