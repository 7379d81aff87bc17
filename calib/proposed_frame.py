"""Propose a local frame for control points in geographic coordinates, if none is given."""

import logging
from pathlib import Path

import numpy as np

from calib.options import local_frame
from calib.point_tables import geographic, place_columns, read_table
from vision.contract import LocalFrame, read_toml
from vision.contract.columns import to_frame

log = logging.getLogger("roadfiber.calibrate")

PLACES, TENTHS = 6, 1  # digits of the origin (0.1 m) and of the azimuth, degrees


def frame_for(
    points: Path | None, path: Path | None, origin: str | None, x_azimuth: float | None, crs: str | None
) -> LocalFrame | None:
    """Take the local frame that was given; without one, propose one for points that need it, and say so.

    Parameters
    ----------
    points : file of control points, or None
    path, origin, x_azimuth : as for `local_frame`; a file without `[frame]` gives none
    crs : of easting and northing without a zone

    Raises
    ------
    InputError
        As `local_frame` and `read_control_points` say.
    """
    given = (
        origin is not None
        or x_azimuth is not None
        or (path is not None and "frame" in read_toml(path, "a TOML file, as site.toml"))
    )
    proposed = None if given or points is None else propose_frame(points, crs)
    if proposed is None:
        return local_frame(path, origin, x_azimuth)
    log.warning(
        "%s: no frame was given; taken [frame] origin = [%s, %s], x_azimuth = %s (the middle of the points, and the "
        "way they go): write it into site.toml, or give --frame",
        points, *proposed.origin, proposed.x_azimuth,
    )  # fmt: skip
    return proposed


def propose_frame(points: Path, crs: str | None = None) -> LocalFrame | None:
    """Frame centered on control points, +x along their longest extent, 0 to 180 degrees; None for points in meters.

    Parameters
    ----------
    points : file of control points
    crs : of easting and northing without a zone

    Raises
    ------
    InputError
        As `read_control_points` says.
    """
    table = read_table(points)
    if place_columns(table, points) == ("x", "y"):
        return None
    latitude, longitude = geographic(table, crs, points)
    # Clipped, so that the error names the rows whose coordinates are out of range.
    middle = (
        round(float(np.clip(np.median(latitude), -90, 90)), PLACES),
        round(float(np.clip(np.median(longitude), -180, 180)), PLACES),
    )
    north, east = to_frame(latitude, longitude, LocalFrame(middle, 0.0), points)
    places = np.stack([north - north.mean(), east - east.mean()], axis=1)
    way = np.linalg.svd(places, full_matrices=False)[2][0]
    return LocalFrame(middle, round(float(np.rad2deg(np.arctan2(way[1], way[0]))) % 180, TENTHS))
