"""GPS tracks from GPX files, through the standard library's XML."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from vision.contract.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

# GPX has no field for accuracy; the usual 1-sigma horizontal error of a single-frequency receiver in a street.
GPX_SIGMA = 3.0

logger = logging.getLogger("roadfiber")


def local_name(element: ElementTree.Element) -> str:
    """Return the tag of `element` without its namespace (GPX 1.0 and 1.1 differ only there)."""
    return element.tag.rpartition("}")[2]


def children(element: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    """Return the children of `element` called `name`, whatever the namespace."""
    return [child for child in element if local_name(child) == name]


def text_of(element: ElementTree.Element, name: str) -> str:
    """Return the text of the first child of `element` called `name`, or the empty string."""
    return next((child.text or "" for child in children(element, name)), "").strip()


def track_rows(track: ElementTree.Element, number: int) -> list[list[str]]:
    """Return (time, track_id, class, latitude, longitude) of each point; each segment is a track of its own."""
    segments = children(track, "trkseg")
    name = text_of(track, "name") or str(number)
    vehicle_class = text_of(track, "type") or "vehicle"
    rows = []
    for index, segment in enumerate(segments, start=1):
        track_id = name if len(segments) == 1 else f"{name}/{index}"
        for point in children(segment, "trkpt"):
            position = [point.get("lat", ""), point.get("lon", "")]
            rows.append([text_of(point, "time"), track_id, vehicle_class, *position])
    return rows


def read_gpx(path: Path) -> "pd.DataFrame":
    """Read the tracks of a GPX file.

    Parameters
    ----------
    path : a GPX 1.0 or 1.1 file; its `<type>` becomes the class (`vehicle` where absent)

    Returns
    -------
    table of text columns `time, track_id, class, latitude, longitude` and `sigma`, m (`GPX_SIGMA`)

    Raises
    ------
    InputError
        If the file is not well-formed XML.
    """
    import pandas as pd

    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not a readable GPX file ({error}); export the track again") from error
    tracks = children(root, "trk")
    rows = [row for number, track in enumerate(tracks, start=1) for row in track_rows(track, number)]
    names = ["time", "track_id", "class", "latitude", "longitude"]
    table = pd.DataFrame(rows, columns=names, dtype=str).assign(sigma=GPX_SIGMA)
    logger.info(
        "%s: GPX states no accuracy; sigma = %g m assumed for each fix; class, by <type> (vehicle where it has none, a "
        "point load): %s", path, GPX_SIGMA, ", ".join(sorted(table["class"].unique())),
    )  # fmt: skip
    return table
