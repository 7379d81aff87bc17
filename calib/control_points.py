"""Control points: marks on the road whose pixels and places are both known."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, LocalFrame
from vision.contract.columns import check_positive, finite, first_row, to_frame

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
COLUMNS = ("name", "px", "py", "x", "y")
PIXEL_SIGMA = 1.0  # px; how well a person clicks, where the file does not say


@dataclass(frozen=True)
class ControlPoints:
    """Marks on the road.

    Attributes
    ----------
    names : [point]
    pixels : [point, 2] px from the top left of the image, right and down
    ground : [point, 2] m, x and y of the local frame
    sigma : [point] px; standard deviation of each pixel coordinate
    """

    names: tuple[str, ...]
    pixels: Array
    ground: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.names)

    def select(self, keep: NDArray[np.bool_]) -> "ControlPoints":
        """Keep the points where `keep` [point] is true."""
        names = tuple(np.array(self.names)[keep].tolist())
        return ControlPoints(names, self.pixels[keep], self.ground[keep], self.sigma[keep])


def read_control_points(path: str | Path, frame: LocalFrame | None = None) -> ControlPoints:
    r"""Read control points from csv.

    Parameters
    ----------
    path : columns `name, px, py, x, y` (m) or `name, px, py, latitude, longitude` (degrees, WGS 84); optionally
        `sigma`, px, how well the mark is found in the image (1 px where it is absent); others are ignored
    frame : local frame that latitude and longitude are projected into

    Raises
    ------
    InputError
        If the file is missing, empty or lacks a column, a value is no number, a sigma is not positive, a name or a
        point is there twice, or there are latitudes and no frame.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "points.csv"
    >>> _ = path.write_text("name,px,py,x,y\ncurb,312.5,401,10,-3.5\n")
    >>> read_control_points(path).ground.tolist()
    [[10.0, -3.5]]
    """
    path = Path(path)
    table = _read_table(path)
    geographic = "latitude" in table and "x" not in table
    places = ("latitude", "longitude") if geographic else ("x", "y")
    if missing := [name for name in ("name", "px", "py", *places) if name not in table]:
        raise InputError(
            f"{path}: no column {', '.join(missing)}; control points have {', '.join(COLUMNS)} "
            "(or latitude, longitude for x, y)"
        )
    if "sigma" not in table:
        table = table.assign(sigma=PIXEL_SIGMA)
    table = finite(table, ("px", "py", *places, "sigma"), path)
    check_positive(table, ("sigma",), path, unit="px")
    if geographic and frame is None:
        raise InputError(f"{path}: latitudes need a local frame; give --frame site.toml or --origin and --x-azimuth")
    if geographic and frame is not None:
        x, y = to_frame(table["latitude"].to_numpy(), table["longitude"].to_numpy(), frame, path)
        table = table.assign(x=x, y=y)
    _refuse_repeats(table, path)
    return ControlPoints(
        tuple(table["name"].astype(str)),
        table[["px", "py"]].to_numpy(float),
        table[["x", "y"]].to_numpy(float),
        table["sigma"].to_numpy(float),
    )


def _read_table(path: Path) -> "pd.DataFrame":
    import pandas as pd

    try:
        table = pd.read_csv(path, dtype={"name": str}, skipinitialspace=True, comment="#")
    except OSError as error:
        reason = error.strerror or "cannot be read"
        raise InputError(f"{path}: {reason}; give a csv of control points ({', '.join(COLUMNS)})") from error
    except (pd.errors.EmptyDataError, pd.errors.ParserError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: no readable csv ({reason}); write {','.join(COLUMNS)}") from error
    if table.empty:
        raise InputError(f"{path}: no control points; write one row per mark: {','.join(COLUMNS)}")
    return table


def _refuse_repeats(table: "pd.DataFrame", path: Path) -> None:
    for columns, what in ((["name"], "name"), (["px", "py"], "pixel"), (["x", "y"], "place")):
        twice = table.duplicated(columns)
        if twice.any():
            row = first_row(twice)
            raise InputError(f"{path}: row {row}: its {what} is there twice; keep one")
