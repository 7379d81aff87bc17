"""OTVision's tracks (`.ottrk`) and reference points (`.otrfpts`), as OpenTrafficCam's tools write them.

A `.ottrk` file is JSON packed with bzip2: `metadata`, and `data.detections` with one entry per box and frame (`class`,
`confidence`, `x, y, w, h` in px, `frame` from 1, `occurrence`, `interpolated-detection`, `track-id`). Up to version 1.0
of its detection format x, y is the middle of the box, since then its upper left corner; up to 1.1 `occurrence` is a
date, since then seconds since 1970. A `.otrfpts` file is JSON: a name, then `x_px, y_px` and UTM `zone_utm,
hemisphere, lon_utm, lat_utm` in meters.
"""

import bz2
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vision.contract.errors import InputError
from vision.interpolate import BOX

if TYPE_CHECKING:
    import pandas as pd

CENTERED = (1, 0)  # last version of the detection format whose x, y is the box's middle
DATED = (1, 1)  # last one whose occurrence is a date
DATE = "%Y-%m-%d %H:%M:%S.%f"
POINT_FIELDS = ("x_px", "y_px", "zone_utm", "hemisphere", "lon_utm", "lat_utm")


def read_ottrk(path: Path | str) -> "pd.DataFrame":
    """Read tracks of OTVision.

    Parameters
    ----------
    path : `.ottrk` file, packed or plain

    Returns
    -------
    table [fix] of time (datetime64[ns, UTC]; OTVision's own dates are taken for UTC), track_id (text), class, the box
        (px), confidence, interpolated, frame (from 0), detected_class, sorted by track and frame

    Raises
    ------
    InputError
        If the file is missing, no such file, or holds no tracks.
    """
    import pandas as pd

    content = _json(Path(path), ".ottrk tracks of OTVision")
    try:
        rows = content["data"]["detections"]
        version = tuple(int(part) for part in str(content["metadata"].get("otdet_version", "1.0")).split(".")[:2])
        table = pd.DataFrame([_row(entry, version) for entry in rows])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: no tracks of OTVision ({type(error).__name__} {error}); write them again") from error
    if table.empty:
        raise InputError(f"{path}: no tracks; OTVision's detections must be tracked first")
    time = pd.to_datetime((table["time"] * 1e6).round().astype("int64"), unit="us", utc=True).dt.as_unit("ns")
    detected = table["class"].mask(table["interpolated"], "")
    return table.assign(time=time, detected_class=detected).sort_values(["track_id", "frame"], ignore_index=True)


def _row(entry: dict[str, Any], version: tuple[int, ...]) -> dict[str, Any]:
    left, top, width, height = (float(entry[name]) for name in "xywh")
    if version <= CENTERED:
        left, top = left - width / 2, top - height / 2
    when = entry["occurrence"]
    dated = version <= DATED
    return {
        "time": datetime.strptime(when, DATE).replace(tzinfo=UTC).timestamp() if dated else float(when),
        "track_id": str(entry["track-id"]),
        "class": str(entry["class"]).lower(),
        **dict(zip(BOX, (left, top, left + width, top + height), strict=True)),
        "confidence": float(entry["confidence"]),
        "interpolated": bool(entry.get("interpolated-detection", False)),
        "frame": int(entry["frame"]) - 1,
    }


def read_reference_points(path: Path | str) -> "pd.DataFrame":
    """Read OTVision's reference points as control points.

    Parameters
    ----------
    path : `.otrfpts` file

    Returns
    -------
    table [point] of name, px, py (px), latitude, longitude (degrees, WGS 84)

    Raises
    ------
    InputError
        If the file is missing, no such file, or a point is incomplete or in no UTM zone.

    Examples
    --------
    >>> import tempfile
    >>> point = {"x_px": 14, "y_px": 259, "hemisphere": "N", "zone_utm": 32, "lon_utm": 500000.0, "lat_utm": 5e6}
    >>> path = Path(tempfile.mkdtemp()) / "street.otrfpts"
    >>> _ = path.write_text(json.dumps({"1": point}))
    >>> read_reference_points(path).round(4).values.tolist()
    [['1', 14.0, 259.0, 45.1535, 9.0]]
    """
    import pandas as pd

    content = _json(Path(path), ".otrfpts reference points of OTVision")
    points = content if isinstance(content, dict) else {}
    if not points:
        raise InputError(f"{path}: no reference points; OTVision names each of them")
    return pd.DataFrame([{"name": name, **_point(point, f"{path}: point {name}")} for name, point in points.items()])


def _point(point: Any, where: str) -> dict[str, float]:
    from pyproj import Transformer

    if not isinstance(point, dict) or any(name not in point for name in POINT_FIELDS):
        raise InputError(f"{where}: not complete; give {', '.join(POINT_FIELDS)}")
    try:
        zone, east, north = int(point["zone_utm"]), float(point["lon_utm"]), float(point["lat_utm"])
        px, py = float(point["x_px"]), float(point["y_px"])
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: {error}; give numbers") from error
    if not 1 <= zone <= 60 or point["hemisphere"] not in ("N", "S"):
        raise InputError(f"{where}: UTM zone {zone}{point['hemisphere']}; give a zone from 1 to 60 and N or S")
    code = (32600 if point["hemisphere"] == "N" else 32700) + zone
    longitude, latitude = Transformer.from_crs(code, 4326, always_xy=True).transform(east, north)
    return {"px": px, "py": py, "latitude": latitude, "longitude": longitude}


def _json(path: Path, what: str) -> Any:
    """Read JSON, packed with bzip2 or plain."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give {what}") from error
    try:
        return json.loads(bz2.decompress(raw) if raw[:3] == b"BZh" else raw)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not {what} ({error})") from error
