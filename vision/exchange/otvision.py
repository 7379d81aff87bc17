"""OTVision's tracks (`.ottrk`) and detections (`.otdet`), as OpenTrafficCam's tools write them.

Both are JSON packed with bzip2, with `metadata` (`otdet_version`; of the `video` width, height, `recorded_start_date`
and `actual_fps`; of the `detection` `normalized_bbox`) and `data`. Tracks: `data.detections` has one entry per box and
frame: `class`, `confidence`, `x, y, w, h`, `frame` from 1, `occurrence`, `interpolated-detection`, `track-id`.
Detections: `data` has, by the frame's number from 1, its `occurrence` and `detections`.

Up to version 1.1 of the detection format `occurrence` is a date, since then seconds since 1970, as a number or as text:
what it is shows in the value. Up to 1.0, x, y is the middle of the box, since then its upper left corner; both in px,
or in shares of the picture where `normalized_bbox` says so. Frames of a track file count from the first one with a
track; where the file says when the video began, they are counted from there. Reference points (`.otrfpts`) are read by
`roadfiber calibrate ground`.
"""

import bz2
import json
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vision.contract.errors import InputError
from vision.contract.text import YEARS
from vision.interpolate import BOX

if TYPE_CHECKING:
    import pandas as pd

CENTERED = (1, 0)  # last version of the detection format whose x, y is the box's middle
LARGEST = 1 << 30  # bytes that are unpacked; a few of bzip2 can stand for all of a machine's memory
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
    metadata, data = _content(Path(path))
    if "detections" not in data:
        raise InputError(f"{path}: holds no tracks of OTVision; where these are its detections, name it .otdet")
    try:
        table = _table(metadata, ((entry, entry["frame"], entry["occurrence"]) for entry in data["detections"]))
        if table.empty:
            raise InputError(f"{path}: no tracks; OTVision's detections must be tracked first")
        named = [(str(entry["track-id"]), bool(entry.get("interpolated-detection"))) for entry in data["detections"]]
        table = table.assign(frame=table["frame"] + _frames_before(metadata, table))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: no tracks of OTVision ({type(error).__name__} {error}); write them again") from error
    table["track_id"], table["interpolated"] = zip(*named, strict=True)
    table["detected_class"] = table["class"].mask(table["interpolated"], "")
    return table.sort_values(["track_id", "frame"], ignore_index=True)


def read_otdet(path: Path | str) -> "pd.DataFrame":
    """Read detections of OTVision, which nobody has tracked yet.

    Parameters
    ----------
    path : `.otdet` file, packed or plain

    Returns
    -------
    table [detection] of time (datetime64[ns, UTC]), class, the box (px), confidence, frame (from 0), sorted by frame

    Raises
    ------
    InputError
        If the file is missing, no such file, or holds no detections.
    """
    metadata, data = _content(Path(path))
    try:
        rows = ((entry, key, frame["occurrence"]) for key, frame in data.items() for entry in frame["detections"])
        table = _table(metadata, rows)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        reason = f"{type(error).__name__} {error}"
        raise InputError(f"{path}: no detections of OTVision ({reason}); write them again") from error
    if table.empty:
        raise InputError(f"{path}: no detections; lower OTVision's confidence")
    return table.sort_values("frame", kind="stable", ignore_index=True)


def _table(metadata: dict[str, Any], rows: Iterable[tuple[dict[str, Any], Any, Any]]) -> "pd.DataFrame":
    """Boxes of (entry, number of the frame, occurrence) as columns."""
    import pandas as pd

    found = list(rows)
    entries = [entry for entry, _, _ in found]
    seconds = np.array([_seconds(when) for _, _, when in found], float)
    if not ((seconds >= 0) & (seconds < YEARS[1].timestamp())).all():
        raise ValueError("an occurrence is of no year")
    left, top, width, height = (np.array([float(entry[name]) for entry in entries], float) for name in "xywh")
    if _centered(metadata, any(_is_date(when) for _, _, when in found)):
        left, top = left - width / 2, top - height / 2
    across, down = _scale(metadata)
    box = (left * across, top * down, (left + width) * across, (top + height) * down)
    time = pd.to_datetime((seconds * 1e6).round().astype("int64"), unit="us", utc=True)
    return pd.DataFrame(
        {
            "time": time.as_unit("ns"),
            "class": [str(entry["class"]).lower() for entry in entries],
            **dict(zip(BOX, box, strict=True)),
            "confidence": [float(entry["confidence"]) for entry in entries],
            "frame": np.array([int(number) - 1 for _, number, _ in found], int),
        }
    )


def _is_date(when: Any) -> bool:
    return isinstance(when, str) and "-" in when


def _seconds(when: Any) -> float:
    """Seconds since 1970 of a date of OTVision, or of seconds as a number or text.

    >>> _seconds("1970-01-02 00:00:00.500000"), _seconds("86400.5"), _seconds(86400.5)
    (86400.5, 86400.5, 86400.5)
    """
    return datetime.strptime(when, DATE).replace(tzinfo=UTC).timestamp() if _is_date(when) else float(when)


def _centered(metadata: dict[str, Any], dated: bool) -> bool:
    """Whether x, y is the middle of boxes; of a file without a version, that is so where it has dates."""
    version = re.search(r"(\d+)\.(\d+)", str(metadata.get("otdet_version")))
    return (int(version[1]), int(version[2])) <= CENTERED if version else dated


def _scale(metadata: dict[str, Any]) -> tuple[float, float]:
    """Return px per unit of x and y."""
    if not metadata.get("detection", {}).get("normalized_bbox", False):
        return 1.0, 1.0
    return float(metadata["video"]["width"]), float(metadata["video"]["height"])


def _frames_before(metadata: dict[str, Any], table: "pd.DataFrame") -> int:
    """How many frames of the video passed before the file's frame 0, by its clock; 0 where it does not say."""
    video = metadata.get("video", {})
    began, rate = video.get("recorded_start_date"), video.get("actual_fps")
    if began is None or not rate:
        return 0
    first = int(table["frame"].to_numpy().argmin())
    passed = table["time"].iloc[first].timestamp() - _seconds(began)
    return max(0, round(passed * float(rate)) - int(table["frame"].iloc[first]))


def _content(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """`metadata` and `data` of a file of OTVision, packed with bzip2 or plain."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give .ottrk or .otdet of OTVision") from error
    try:
        content = json.loads(bz2.BZ2Decompressor().decompress(raw, LARGEST) if raw[:3] == b"BZh" else raw)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not .ottrk or .otdet of OTVision ({error})") from error
    metadata, data = (content.get(name) if isinstance(content, dict) else None for name in ("metadata", "data"))
    if not isinstance(metadata, dict) or not isinstance(data, dict):
        raise InputError(f"{path}: not .ottrk or .otdet of OTVision (no metadata and data); write it again")
    return metadata, data
