"""Tables of tracks to compare: one per detector or setting, all of one video."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.dropped import read_dropped
from vision.interpolate import BOX
from vision.quality.reading import read_speed, read_tracks

if TYPE_CHECKING:
    import pandas as pd


BEYOND = 0.5  # px; a box that extends no farther beyond the picture counts as inside
MOST_OUTSIDE = 0.1  # share of boxes with their middle outside the picture, above which they are of another video
Source = TypeVar("Source")
Clock = tuple[NDArray[np.float64], NDArray[np.float64]]  # frames and their times, s


@dataclass(frozen=True)
class Setting:
    """Tracks made by one detector or setting.

    Parameters
    ----------
    name : to show
    path : where they came from
    tracks : [fix] with track_id, class, detected_class (empty where `missed`), frame, time (s from the video's zero),
        interpolated (not placed by a box of its own), missed (not detected either), x, y; boxes (px) and sigma_x,
        sigma_y (m) where they are known
    unit : of x and y: m, or px where no calibration is behind them: the middle of the box's lower edge
    speed : frames per second by step, where it is known
    clipped : how many boxes reached beyond the picture and were clipped to it
    others : tracks by class, of classes that are not compared
    dropped : [fix] that were detected and not placed on the road (`vision.dropped`), where the file beside the table
        says so
    """

    name: str
    path: Path
    tracks: "pd.DataFrame"
    unit: str
    speed: dict[str, float] | None = None
    clipped: int = 0
    others: dict[str, int] = field(default_factory=dict)
    dropped: "pd.DataFrame | None" = None

    @property
    def has_boxes(self) -> bool:
        """Whether boxes in the picture are known."""
        return all(name in self.tracks for name in BOX)


@dataclass(frozen=True)
class Picture:
    """What is known of a video.

    Parameters
    ----------
    path : of it
    width, height : px
    index, time : of its frames [frame]: their numbers, from 0, and when they were taken, s
    """

    path: Path
    width: int
    height: int
    index: NDArray[np.int64]
    time: NDArray[np.float64]

    @property
    def frames(self) -> int:
        """How many there are, those that cannot be decoded among them."""
        return int(self.index[-1]) + 1


@dataclass(frozen=True)
class Tables:
    """Tables that can be compared, and why others cannot.

    Parameters
    ----------
    settings : in the order given, in meters where all have them, else in pixels
    left_out : a line on each table that is not among them
    """

    settings: list[Setting]
    left_out: tuple[str, ...] = ()

    def each(self, change: Callable[[Setting], Setting]) -> "Tables":
        """Change every setting; those that cannot be changed are left out."""
        changed = usable(change, self.settings)
        return Tables(changed.settings, self.left_out + changed.left_out)


def usable(make: Callable[[Source], Setting], sources: Sequence[Source]) -> Tables:
    """Make a setting of every source; InputError if none can be made."""
    made: list[Setting] = []
    refused: list[InputError] = []
    for source in sources:
        try:
            made.append(make(source))
        except InputError as error:
            refused.append(error)
    if not made:
        raise refused[0]
    return Tables(made, tuple(map(str, refused)))


def read_settings(
    paths: Sequence[Path],
    names: Sequence[str] | None = None,
    frame_rate: float | None = None,
    picture: Picture | None = None,
) -> Tables:
    """Read tables of tracks of one video; those that cannot be used are left out.

    Parameters
    ----------
    paths : `.csv` or `.parquet` as `roadfiber track` writes them, with or without meters; MOTChallenge `.txt`;
        OTVision's tracks (`.ottrk`) and detections (`.otdet`, of which roadfiber's tracker takes the vehicles). A
        `.json` beside a table, of the same name, is taken for what `track --json` printed: its speed; a `.dropped`
        beside it says what was detected and not placed on the road.
    names : to show; by default those of the files
    frame_rate : 1/s, for MOTChallenge files; by default they have the clock of the other tables, else of the video
    picture : of the video, to which boxes are clipped; by default they are left as they are

    Raises
    ------
    InputError
        If names do not fit, or no table is left: files that are missing, empty, of an unknown kind or lack a column; or
        the tables are not of one video and there is no majority: the same frames at other times, or no frame in common.
    """
    if not paths:
        raise InputError("no tables of tracks; give at least one that `roadfiber track` wrote")
    names = list(names) if names else distinct([path.stem for path in paths])
    if len(names) != len(paths) or len(set(names)) != len(names):
        raise InputError(f"--names: {len(set(names))} different names for {len(paths)} tables; give one for each")

    def read(source: tuple[str, Path]) -> Setting:
        name, path = source
        speed = read_speed(path.with_suffix(".json"))
        found = Setting(name, path, read_tracks(path, frame_rate), "m", speed, dropped=read_dropped(path))
        rate_of(found)  # its clock must go on
        if picture is None or not found.has_boxes:
            return found
        tracks, count = clip_boxes(found.tracks, picture, path)
        return replace(found, tracks=tracks, clipped=count)

    tables = usable(read, list(zip(names, map(Path, paths), strict=True)))
    clocks = [clock_of(setting) for setting in tables.settings if rate_of(setting)]
    clocks += [] if picture is None else [(picture.index.astype(float), picture.time)]
    tables = of_one_video(tables.each(lambda setting: with_clock(setting, clocks)))
    metric = all("x" in setting.tracks for setting in tables.settings)
    return tables if metric else tables.each(in_pixels)


def distinct(names: Sequence[str]) -> list[str]:
    """Names, with a number added to repeated ones.

    >>> distinct(["a", "b", "a"])
    ['a', 'b', 'a 2']
    """
    count = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [name if number == 1 else f"{name} {number}" for name, number in zip(names, count, strict=True)]


def rate_of(setting: Setting) -> float | None:
    """Frames per second of the video that a table's own clock and frames say; None without a clock."""
    frame, time = setting.tracks["frame"].to_numpy(float), setting.tracks["time"].to_numpy(float)
    if not np.isfinite(time).all() or np.ptp(frame) == 0:
        return None
    if np.ptp(time) <= 0:
        raise InputError(f"{setting.path}: time stands still while frames pass; give every frame its time")
    return float(np.ptp(frame) / np.ptp(time))


def clock_of(setting: Setting) -> Clock:
    """Frames of a table and their times, s."""
    rows = setting.tracks.drop_duplicates("frame").sort_values("frame")
    return rows["frame"].to_numpy(float), rows["time"].to_numpy(float)


def with_clock(setting: Setting, clocks: Sequence[Clock]) -> Setting:
    """Give a table without a clock the first of `clocks`, which goes on at its mean rate before and after."""
    if setting.tracks["time"].notna().all():
        return setting
    if not clocks:
        raise InputError(f"{setting.path}: has frames but no clock; give --video, or its --frame-rate")
    at, time = clocks[0]
    frame = setting.tracks["frame"].to_numpy(float)
    inside = np.clip(frame, at[0], at[-1])
    seconds = np.interp(inside, at, time) + (frame - inside) * np.ptp(time) / np.ptp(at)
    return replace(setting, tracks=setting.tracks.assign(time=seconds))


def of_one_video(tables: Tables) -> Tables:
    """Leave out tables that are not of the video that most are of; InputError where no two agree."""
    settings = tables.settings
    complaints = [[other_video(one, setting) for setting in settings] for one in settings]
    agreeing = [row.count("") for row in complaints]
    most = agreeing.index(max(agreeing))
    if len(settings) > 1 and agreeing[most] < 2:
        raise InputError(next(filter(None, complaints[most])))
    kept = [setting for setting, line in zip(settings, complaints[most], strict=True) if not line]
    return Tables(kept, (*tables.left_out, *filter(None, complaints[most])))


def other_video(one: Setting, other: Setting) -> str:
    """Say why another table is not of the same video; nothing where it may be: the same frames at the same times."""
    clocks = [setting.tracks.drop_duplicates("frame").set_index("frame")["time"] for setting in (one, other)]
    apart = (clocks[0] - clocks[1]).dropna()
    if len(apart) and np.ptp(apart) <= 1 / (rate_of(one) or 1.0):
        return ""
    reason = "have no frame in common" if apart.empty else "have the same frames at other times"
    return f"{other.path}: {one.path} and this {reason}; give tables of one video"


def clip_boxes(tracks: "pd.DataFrame", picture: Picture, path: Path) -> tuple["pd.DataFrame", int]:
    """Clip boxes to the picture: detectors draw them a little beyond its border.

    Parameters
    ----------
    tracks : [fix] with frame and the box, px
    picture : of the video
    path : of the table, for messages

    Returns
    -------
    the same table, boxes inside; and how many were changed by more than half a pixel

    Raises
    ------
    InputError
        If tracks have frames after the end, or more than one box in ten has its middle outside: they are of another
        video.
    """
    size = np.array([picture.width, picture.height], float)
    box = tracks[BOX].to_numpy(float)
    middle = (box[:, :2] + box[:, 2:]) / 2
    outside = ((middle < 0) | (middle > size)).any(axis=1)
    if outside.mean() > MOST_OUTSIDE or tracks["frame"].max() >= picture.frames:
        raise InputError(
            f"{path}: has boxes or frames that {picture.path} ({picture.width} x {picture.height} px, "
            f"{picture.frames} frames) has not; give the video of these tracks"
        )
    # A box entirely outside keeps a pixel at the border, so that no track is interrupted.
    low = np.clip(box[:, :2], 0.0, size - 1)
    high = np.clip(box[:, 2:], low + 1, size)
    inside = np.concatenate([low, high], axis=1)
    changed = int((np.abs(inside - box) > BEYOND).any(axis=1).sum())
    return tracks.assign(**dict(zip(BOX, inside.T, strict=True))), changed


def in_pixels(setting: Setting) -> Setting:
    """Return a setting with the middle of the box's lower edge as x, y, px."""
    if not setting.has_boxes:
        raise InputError(f"{setting.path}: has no boxes, and other tables no meters; track all with --calibration")
    tracks = setting.tracks
    x = (tracks[BOX[0]] + tracks[BOX[2]]) / 2
    return replace(setting, tracks=tracks.assign(x=x, y=tracks[BOX[3]]), unit="px")
