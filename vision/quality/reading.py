"""One table of tracks, of any kind that can be compared."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from vision.contract.columns import check_positive, finite, first_row
from vision.contract.errors import InputError
from vision.contract.table import read_as_is, to_utc
from vision.detectors.names import VEHICLES, plain_name
from vision.exchange import read_mot, read_otdet, read_ottrk
from vision.interpolate import BOX
from vision.jitter import seconds

if TYPE_CHECKING:
    import pandas as pd

NEEDED = ("time", "track_id", "class", "frame")
NUMBERS = ("sigma_x", "sigma_y", "x_measured", "y_measured")
SUFFIXES = (".csv", ".parquet", ".txt", ".ottrk", ".otdet")
TRUE = ("true", "1", "1.0")


def read_tracks(path: Path, frame_rate: float | None = None) -> "pd.DataFrame":
    """Read one table of tracks; time in s, NaN where the file has no clock.

    Raises
    ------
    InputError
        If the file is missing, empty, of an unknown kind or lacks a column.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of table of tracks; give one of {', '.join(SUFFIXES)}")
    if suffix == ".txt":
        return tidy(read_mot(path, frame_rate), path)
    table = {".ottrk": read_ottrk, ".otdet": follow_otdet}.get(suffix, read_as_is)(path)
    if missing := [name for name in NEEDED if name not in table]:
        raise InputError(f"{path}: no column {', '.join(missing)}; give a table that `roadfiber track` wrote")
    columns = [names for names in (["x", "y"], BOX) if all(name in table for name in names)]
    if not columns:
        raise InputError(f"{path}: neither x, y nor {', '.join(BOX)}; give a table that `roadfiber track` wrote")
    if table.empty:
        raise InputError(f"{path}: no fixes; nothing was tracked, try a lower --min-score or another --detector")
    known = [name for name in NUMBERS if name in table]
    table = finite(table, ["frame", *(name for names in columns for name in names), *known], path)
    check_positive(table, [name for name in known if name.startswith("sigma")], path)
    check_rows(table, path)
    return tidy(table.assign(time=to_seconds(table["time"], path)), path)


def follow_otdet(path: Path) -> "pd.DataFrame":
    """Follow the vehicles that OTVision detected."""
    from vision.follow import follow_table

    table = read_otdet(path)
    table = table.assign(time=seconds(table["time"]), **{"class": table["class"].map(plain_name)})
    vehicles = table[table["class"].isin(VEHICLES)]
    return follow_table(vehicles) if len(vehicles) else vehicles.assign(track_id="")


def check_rows(table: "pd.DataFrame", path: Path) -> None:
    """Raise InputError at the first row that cannot be of a video."""
    frame = table["frame"]
    bad = {
        "names no track or class; fill it in": table["track_id"].isna() | table["class"].isna(),
        "has a frame that is not a whole number from 0 on; give the frame's place in the video": (frame < 0)
        | (frame % 1 != 0),
    }
    if all(name in table for name in BOX):
        flat = (table[BOX[0]] >= table[BOX[2]]) | (table[BOX[1]] >= table[BOX[3]])
        bad["has a box without area; give left, top, right, bottom in px"] = flat
    for complaint, rows in bad.items():
        if rows.any():
            raise InputError(f"{path}: row {first_row(rows)} {complaint}")


def tidy(table: "pd.DataFrame", path: Path) -> "pd.DataFrame":
    """Return `table` with all columns of a setting, each of one kind, sorted by track and frame."""
    named = table["class"].astype(str).map(plain_name)
    detected = table["detected_class"].fillna("").astype(str).map(plain_name) if "detected_class" in table else named
    interpolated = table["interpolated"] if "interpolated" in table else table["frame"] < 0
    flags = interpolated.astype(str).str.lower().isin(TRUE)
    # A fix that was detected but could not be placed is not a miss of the detector.
    missed = flags & (detected == "") if "detected_class" in table else flags
    table = table.assign(
        track_id=table["track_id"].astype(str),
        frame=table["frame"].astype(int),
        interpolated=flags,
        missed=missed,
        detected_class=detected.mask(missed, ""),
        **{"class": named},
    )
    if flags.all():
        raise InputError(f"{path}: all fixes are interpolated; give those that were detected too")
    if set(BOX) <= set(table) and (table[BOX] <= 1).all(axis=None):
        raise InputError(f"{path}: its boxes are shares of the picture, no number beyond 1; give them in px")
    if (twice := table.duplicated(["track_id", "frame"])).any():
        row = table[twice].iloc[0]
        raise InputError(f"{path}: track {row['track_id']} is twice in frame {row['frame']}; keep one fix")
    return table.sort_values(["track_id", "frame"], ignore_index=True)


def to_seconds(column: "pd.Series", path: Path) -> "pd.Series":
    """Times as seconds, or as ISO 8601 in UTC -> s from the first."""
    import pandas as pd

    if column.dtype.kind not in "mM" and pd.to_numeric(column, errors="coerce").notna().any():
        return finite(column.to_frame("time"), ["time"], path)["time"]
    return pd.Series(seconds(to_utc(column, path)), index=column.index)


def read_speed(path: Path) -> dict[str, float] | None:
    """Frames per second by step, from what `roadfiber track --json` printed.

    None where there is no such file.
    """
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
        return {str(step): float(rate) for step, rate in summary["frames_per_second"].items()} or None
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not what `roadfiber track --json` prints; move it away or write it again") from error
