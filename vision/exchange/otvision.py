"""OTVision's tracks (`.ottrk`), as OpenTrafficCam's tools write them.

A `.ottrk` file is JSON packed with bzip2: `metadata`, and `data.detections` with one entry per box and frame (`class`,
`confidence`, `x, y, w, h` in px, `frame` from 1, `occurrence`, `interpolated-detection`, `track-id`). Up to version 1.0
of its detection format x, y is the middle of the box, since then its upper left corner; up to 1.1 `occurrence` is a
date, since then seconds since 1970. Its reference points (`.otrfpts`) are read by `roadfiber calibrate ground`.
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

    content = _json(Path(path))
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


def _json(path: Path) -> Any:
    """Read JSON, packed with bzip2 or plain."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give .ottrk tracks of OTVision") from error
    try:
        return json.loads(bz2.decompress(raw) if raw[:3] == b"BZh" else raw)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not .ottrk tracks of OTVision ({error})") from error
