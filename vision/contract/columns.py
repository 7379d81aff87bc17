"""Checks of table columns, shared by the trajectory table and the anchors; each failure is one clear line."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.frame import LocalFrame
from vision.contract.text import LONGEST, is_name

if TYPE_CHECKING:
    import pandas as pd

# Beyond this the plane of the local frame no longer follows the ground, and such a distance is a mistake anyway.
REACH_OF_FRAME = 100e3
# No survey is surer, m; squares of less are lost beside those of other sigmas.
SUREST = 1e-6
# Points all closer to the origin than this are within 11 km if in degrees, and within a hand's breadth if in meters.
DEGREES_OFF = 0.1
# Other names of columns, as receivers and web maps write them.
ALSO_CALLED = {"lat": "latitude", "lon": "longitude", "lng": "longitude", "long": "longitude"}


def with_positions(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table with its columns renamed to latitude and longitude, if it gives these in place of x and y.

    >>> import pandas as pd
    >>> list(with_positions(pd.DataFrame({"lat": [32.1], "lng": [34.8]})))
    ['latitude', 'longitude']
    """
    also = {name: ALSO_CALLED[name] for name in table if name in ALSO_CALLED}
    names = [*also.values(), *(name for name in ("latitude", "longitude") if name in table)]
    # If there are two of a kind, or meters too, it is unclear which are meant.
    clear = sorted(names) == ["latitude", "longitude"] and "x" not in table
    return table.rename(columns=also) if clear else table


def first_row(mask: "pd.Series") -> int:
    """Return the number, from 1, of the first row where `mask` is true.

    >>> import pandas as pd
    >>> first_row(pd.Series([False, True, True]))
    2
    """
    return int(mask.to_numpy().argmax()) + 1


def finite(table: "pd.DataFrame", names: Sequence[str], path: Path) -> "pd.DataFrame":
    """Return `table` with columns `names` as float64.

    Raises
    ------
    InputError
        At the first value that is not a finite number; the message says row and column.
    """
    import pandas as pd

    result = table.copy()
    for name in names:
        result[name] = pd.to_numeric(table[name], errors="coerce").astype(float)
        bad = ~np.isfinite(result[name])
        if bad.any():
            row = first_row(bad)
            value = table[name].iloc[row - 1]
            raise InputError(f"{path}: row {row}: {name} is {str(value)!r}; give a number or leave the row out")
    return result


def check_positive(table: "pd.DataFrame", names: Sequence[str], path: Path, unit: str = "m") -> None:
    """Raise InputError where a standard deviation, in `unit`, is not above zero, or beyond what a fit can weigh."""
    for name in names:
        bad = ~table[name].between(SUREST, REACH_OF_FRAME)
        if bad.any():
            row = first_row(bad)
            value = table[name].iloc[row - 1]
            raise InputError(
                f"{path}: row {row}: {name} is {value:g}; give a standard deviation above 0 {unit}, from {SUREST:g} to "
                f"{REACH_OF_FRAME:g}"
            )


def check_names(table: "pd.DataFrame", names: Sequence[str], path: Path) -> None:
    """Raise InputError where a text of these columns is no name: what is written with it could not be read back."""
    for name in names:
        bad = ~table[name].map({one: is_name(one) for one in table[name].unique()})
        if bad.any():
            row = first_row(bad)
            raise InputError(
                f"{path}: row {row}: {name} is {table[name].iloc[row - 1][:LONGEST]!r}; give at most {LONGEST} "
                "characters in one line"
            )


def check_meters(table: "pd.DataFrame", frame: LocalFrame | None, path: Path) -> None:
    """Raise InputError where x and y are no meters of a local frame.

    They are eastings and northings where they are far off, and degrees where all are beside the frame's origin: in
    meters nothing would move.
    """
    x, y = table["x"], table["y"]
    far = x.abs().combine(y.abs(), max)
    if (far > REACH_OF_FRAME).any():
        row = int(far.to_numpy().argmax())
        raise InputError(
            f"{path}: row {row + 1}: x and y are {x.iloc[row]:.10g} and {y.iloc[row]:.10g}, which are no meters of a "
            "local frame; give those, or latitude and longitude in place of eastings and northings"
        )
    if frame is None:
        return
    for names, origin in (("latitude and longitude", frame.origin), ("longitude and latitude", frame.origin[::-1])):
        if max((x - origin[0]).abs().max(), (y - origin[1]).abs().max()) < DEGREES_OFF:
            raise InputError(f"{path}: x and y hold {names}; name the columns so")


def to_frame(
    latitude: NDArray[np.float64], longitude: NDArray[np.float64], frame: LocalFrame, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Latitude, longitude [row], degrees -> x, y [row], m.

    Raises
    ------
    InputError
        Where a value is out of range, or is over 100 km from the origin of `frame` (swapped ones look so, those of the
        origin as well as the columns).

    >>> frame = LocalFrame((32.0, 34.8), 90.0)
    >>> to_frame(np.array([34.8]), np.array([32.0]), frame, Path("gps.csv"))
    Traceback (most recent call last):
    vision.contract.errors.InputError: gps.csv: latitude and longitude look swapped, there or in the frame's \
origin (32.0, 34.8): exchange those of the file, or the two numbers of origin
    """
    for name, degrees, limit in (("latitude", latitude, 90), ("longitude", longitude, 180)):
        bad = np.abs(degrees) > limit
        if bad.any():
            row = int(bad.argmax())
            raise InputError(f"{path}: row {row + 1}: {name} is {degrees[row]:g}; give degrees within ±{limit}")
    x, y = frame.to_local(latitude, longitude)
    far = np.hypot(x, y)
    if far.max() > REACH_OF_FRAME:
        within = np.abs(longitude) <= 90
        swapped = np.hypot(*frame.to_local(np.where(within, longitude, 90.0), latitude))
        if np.median(swapped) < REACH_OF_FRAME:
            # Exchanged in the file or in the origin, the distance is the same: nothing here tells which.
            raise InputError(
                f"{path}: latitude and longitude look swapped, there or in the frame's origin {frame.origin}: "
                "exchange those of the file, or the two numbers of origin"
            )
        row = int(far.argmax())
        raise InputError(
            f"{path}: row {row + 1}: {far[row] / 1e3:.0f} km from the frame's origin {frame.origin}; "
            "check the position and [frame] origin"
        )
    return x, y
