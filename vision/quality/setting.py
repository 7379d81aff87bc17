"""Tables of tracks to compare: one per detector or setting, all of one video."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

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


@dataclass(frozen=True)
class Setting:
    """Tracks made by one detector or setting.

    Parameters
    ----------
    name : to show
    path : where they came from
    tracks : [fix] with track_id, class, detected_class (empty where interpolated), frame, time (s from the video's
        zero), interpolated, x, y; boxes (px) and sigma_x, sigma_y (m) where they are known
    unit : of x and y: m, or px where no calibration is behind them: the middle of the box's lower edge
    speed : frames per second by step, where it is known
    """

    name: str
    path: Path
    tracks: "pd.DataFrame"
    unit: str
    speed: dict[str, float] | None = None

    @property
    def has_boxes(self) -> bool:
        """Whether boxes in the picture are known."""
        return all(name in self.tracks for name in BOX)


def read_settings(
    paths: Sequence[Path], names: Sequence[str] | None = None, frame_rate: float | None = None
) -> list[Setting]:
    """Read tables of tracks of one video.

    Parameters
    ----------
    paths : `.csv` or `.parquet` as `roadfiber track` writes them, with or without meters; MOTChallenge `.txt`;
        OTVision's tracks (`.ottrk`) and detections (`.otdet`, of which roadfiber's tracker takes the vehicles). A
        `.json` beside a table, of the same name, is taken for what `track --json` printed: its speed.
    names : to show; by default those of the files
    frame_rate : 1/s, for MOTChallenge files; by default that of the other tables

    Returns
    -------
    settings in the order given, in meters where all tables have them, else in pixels

    Raises
    ------
    InputError
        If a file is missing, empty, of an unknown kind or lacks a column, names do not fit, or the tables are not of
        one video: the same frames at other times, or no frame in common.
    """
    if not paths:
        raise InputError("no tables of tracks; give at least one that `roadfiber track` wrote")
    names = list(names) if names else distinct([path.stem for path in paths])
    if len(names) != len(paths) or len(set(names)) != len(names):
        raise InputError(f"--names: {len(set(names))} different names for {len(paths)} tables; give one for each")
    found = [
        Setting(name, path, read_tracks(path, frame_rate), "m", read_speed(path.with_suffix(".json")))
        for name, path in zip(names, map(Path, paths), strict=True)
    ]
    rates = [rate for rate in map(rate_of, found) if rate]
    found = [with_clock(setting, rates) for setting in found]
    check_same_video(found)
    metric = all("x" in setting.tracks for setting in found)
    return found if metric else [in_pixels(setting) for setting in found]


def distinct(names: Sequence[str]) -> list[str]:
    """Names with a number where one comes twice.

    >>> distinct(["a", "b", "a"])
    ['a', 'b', 'a 2']
    """
    count = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [name if number == 1 else f"{name} {number}" for name, number in zip(names, count, strict=True)]


def read_tracks(path: Path, frame_rate: float | None = None) -> "pd.DataFrame":
    """Read one table of tracks; time in s, NaN where the file has no clock.

    Raises
    ------
    InputError
        As `read_settings` says.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of table of tracks; give one of {', '.join(SUFFIXES)}")
    if suffix == ".txt":
        return read_mot(path, frame_rate).pipe(lambda table: table.assign(detected_class=table["class"]))
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
        "has a frame that is no whole number from 0 on; give the frame's place in the video": (frame < 0)
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
    table = table.assign(
        track_id=table["track_id"].astype(str),
        frame=table["frame"].astype(int),
        interpolated=flags,
        detected_class=detected.mask(flags, ""),
        **{"class": named},
    )
    if flags.all():
        raise InputError(f"{path}: all fixes are interpolated; give those that were detected too")
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


def rate_of(setting: Setting) -> float | None:
    """Frames per second of the video that a table's own clock and frames say; None without a clock."""
    frame, time = setting.tracks["frame"].to_numpy(float), setting.tracks["time"].to_numpy(float)
    if not np.isfinite(time).all() or np.ptp(frame) == 0:
        return None
    if np.ptp(time) <= 0:
        raise InputError(f"{setting.path}: time stands still while frames pass; give every frame its time")
    return float(np.ptp(frame) / np.ptp(time))


def with_clock(setting: Setting, rates: Sequence[float]) -> Setting:
    """Give a table without a clock that of the others."""
    if setting.tracks["time"].notna().all():
        return setting
    if not rates:
        raise InputError(f"{setting.path}: has frames but no clock; give --frame-rate of the video")
    return replace(setting, tracks=setting.tracks.assign(time=setting.tracks["frame"] / rates[0]))


def check_same_video(settings: Sequence[Setting]) -> None:
    """Raise InputError unless all tables show the same times for the same frames."""
    clocks = [setting.tracks.drop_duplicates("frame").set_index("frame")["time"] for setting in settings]
    for setting, clock in zip(settings[1:], clocks[1:], strict=True):
        apart = (clocks[0] - clock).dropna()
        interval = 1 / (rate_of(settings[0]) or 1.0)
        if apart.empty or np.ptp(apart) > interval:
            reason = "have no frame in common" if apart.empty else "have the same frames at other times"
            raise InputError(f"{setting.path}: {settings[0].path} and this {reason}; give tables of one video")


def in_pixels(setting: Setting) -> Setting:
    """Return a setting with the middle of the box's lower edge as x, y, px."""
    if not setting.has_boxes:
        raise InputError(f"{setting.path}: has no boxes, and other tables no meters; track all with --calibration")
    tracks = setting.tracks
    x = (tracks[BOX[0]] + tracks[BOX[2]]) / 2
    return replace(setting, tracks=tracks.assign(x=x, y=tracks[BOX[3]]), unit="px")
