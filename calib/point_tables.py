"""Control point files (csv, json, OTVision's .otrfpts) as tables, and their places as meters of the local frame."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, LocalFrame
from vision.contract.columns import check_meters, finite, first_row, to_frame, with_positions
from vision.contract.csv_table import read_csv
from vision.contract.text import read_json

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
COLUMNS = ("name", "px", "py", "x", "y")
TEXT_COLUMNS = ("name", "zone")
PLACES = (("x", "y"), ("latitude", "longitude"), ("easting", "northing"))
UTM_EASTING = (100e3, 900e3)  # m, inside a zone and a little beyond
OTVISION = ("x_px", "y_px", "hemisphere", "zone_utm", "lon_utm", "lat_utm")


def read_table(path: Path) -> "pd.DataFrame":
    """Read a control point file as a table [point] with the columns of the csv.

    A `.json` is a list of objects with the keys of the csv's columns, or a calibration, whose control points are
    taken. An `.otrfpts` is what OTVision writes: {"1": {"x_px", "y_px", "hemisphere", "zone_utm", "lon_utm" (easting),
    "lat_utm" (northing)}, ...}.

    Raises
    ------
    InputError
        If the file is missing, not of its format, or has no points.
    """
    readers = {".json": _read_json, ".otrfpts": _read_otvision}
    reader = readers.get(path.suffix.lower())
    table = reader(path) if reader else read_csv(path, TEXT_COLUMNS, comment="#")
    table = with_positions(table)
    if table.empty:
        raise InputError(f"{path}: no control points; write one row per mark: {','.join(COLUMNS)}")
    return table


def _read_json(path: Path) -> "pd.DataFrame":
    import pandas as pd

    content = read_json(path, "a file of control points")
    rows = content.get("control_points") if isinstance(content, dict) else content
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(
            f"{path}: no list of control points; write [{{name, px, py, x, y}}, ...] or give a calibration"
        )
    return pd.DataFrame(rows).rename(columns={"u": "px", "v": "py"})


def _read_otvision(path: Path) -> "pd.DataFrame":
    import pandas as pd

    content = read_json(path, "a file of control points")
    if not isinstance(content, dict) or not all(isinstance(row, dict) for row in content.values()):
        raise InputError(f'{path}: not OTVision\'s reference points; they are {{"1": {{{", ".join(OTVISION)}}}, ...}}')
    for name, row in content.items():
        if missing := [key for key in OTVISION if key not in row]:
            raise InputError(f"{path}: point {name} has no {', '.join(missing)}; mark it in OTVision again")
    table = pd.DataFrame.from_dict(content, orient="index")
    if table.empty:
        return table
    return pd.DataFrame(
        {
            "name": table.index.astype(str),
            "px": table["x_px"].to_numpy(),
            "py": table["y_px"].to_numpy(),
            "easting": table["lon_utm"].to_numpy(),
            "northing": table["lat_utm"].to_numpy(),
            "zone": (table["zone_utm"].astype(str) + table["hemisphere"].astype(str)).to_numpy(),
        }
    )


def with_meters(table: "pd.DataFrame", frame: LocalFrame | None, crs: str | None, path: Path) -> "pd.DataFrame":
    """Add x, y (m, local frame) to a table [point] that has latitude, longitude or easting, northing instead.

    Parameters
    ----------
    table : with (x, y), or (latitude, longitude), WGS 84, or (easting, northing), in the unit of the reference system,
        and, for UTM, `zone` as 32N
    frame : local frame; needed for all but x, y
    crs : coordinate reference system of easting and northing where there is no zone, as EPSG:25832
    path : for messages

    Raises
    ------
    InputError
        If no pair of columns is whole, a value is not a number or out of range (swapped columns look so), or the frame
        or the coordinate reference system is missing.
    """
    names = place_columns(table, path)
    if names == ("x", "y"):
        table = finite(table, names, path)
        check_meters(table, frame, path)
        return table
    if frame is None:
        raise InputError(
            f"{path}: {names[0]} and {names[1]} need a local frame; give --frame site.toml or --origin and --x-azimuth"
        )
    x, y = to_frame(*geographic(table, crs, path), frame, path)
    return table.assign(x=x, y=y)


def place_columns(table: "pd.DataFrame", path: Path) -> tuple[str, str]:
    """Return which columns say where the points are; InputError where no pair of `PLACES` is whole."""
    names = next((pair for pair in PLACES if set(pair) <= set(table.columns)), None)
    if names is None:
        absent = [name for name in COLUMNS[3:] if name not in table]
        raise InputError(
            f"{path}: no column {', '.join(absent)}; control points have {', '.join(COLUMNS)} "
            "(or latitude, longitude, or easting, northing, for x, y)"
        )
    return names


def geographic(table: "pd.DataFrame", crs: str | None, path: Path) -> tuple[Array, Array]:
    """Latitude and longitude [point], degrees, of a table that has them, or easting and northing, m.

    Raises
    ------
    InputError
        As `with_meters` says.
    """
    if {"latitude", "longitude"} <= set(table.columns):
        table = finite(table, PLACES[1], path)
        return table["latitude"].to_numpy(), table["longitude"].to_numpy()
    table = finite(table, PLACES[2], path)
    places = np.full((2, len(table)), np.nan)
    systems = _systems(table, crs, path)
    for system in np.unique(systems):
        here = systems == system
        places[:, here] = _unprojected(table[here], str(system), path)
    return places[0], places[1]


def _systems(table: "pd.DataFrame", crs: str | None, path: Path) -> NDArray[np.str_]:
    """Coordinate reference system of easting and northing [point]."""
    if "zone" not in table:
        if crs is None:
            raise InputError(f"{path}: easting and northing need a column zone (32N) or --crs EPSG:CODE")
        return np.full(len(table), crs)
    zones = table["zone"].astype(str).str.strip().str.upper()
    bad = ~zones.str.fullmatch(r"0?([1-9]|[1-5]\d|60)[NS]")
    if bad.any():
        row = first_row(bad)
        raise InputError(f"{path}: row {row}: zone is {table['zone'].iloc[row - 1]!r}; give a UTM zone as 32N or 19S")
    east = table["easting"].to_numpy(float)
    outside = (east < UTM_EASTING[0]) | (east > UTM_EASTING[1])
    if outside.any():
        row = int(outside.argmax())
        swapped = UTM_EASTING[0] <= table["northing"].iloc[row] <= UTM_EASTING[1]
        mend = "easting and northing look swapped; exchange them" if swapped else "a UTM easting is 100000 to 900000 m"
        raise InputError(f"{path}: row {row + 1}: easting is {east[row]:.0f}: {mend}")
    return np.array([f"EPSG:{(32600 if zone[-1] == 'N' else 32700) + int(zone[:-1])}" for zone in zones])


def _unprojected(table: "pd.DataFrame", system: str, path: Path) -> Array:
    """Easting, northing, m, of one coordinate reference system -> latitude, longitude [2, point], degrees."""
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError

    try:
        transformer = Transformer.from_crs(CRS.from_user_input(system), CRS.from_epsg(4326), always_xy=True)
    except CRSError as error:
        raise InputError(f"--crs {system}: not a coordinate reference system; give one as EPSG:25832") from error
    longitude, latitude = transformer.transform(table["easting"].to_numpy(float), table["northing"].to_numpy(float))
    places = np.array([latitude, longitude], float)
    if not np.isfinite(places).all():
        raise InputError(f"{path}: easting and northing are outside {system}; check the zone or --crs")
    return places
