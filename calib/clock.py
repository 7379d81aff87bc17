"""The video's clock against UTC, as the survey's site.toml sets it and as the file's own times show it."""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from vision.contract import InputError, read_toml
from vision.contract.text import FARTHEST, TIME_MEND, moment
from vision.frames import Video
from vision.video import open_video

SPEED = 50 / 3.6  # m/s; speed of a vehicle, to translate time errors into distance
GAP = 1.5  # median frame intervals that make a gap


@dataclass(frozen=True)
class Clock:
    """How a video's frames are put on UTC.

    Attributes
    ----------
    start : UTC of the video's time zero by the camera's clock, as given in site.toml
    header : UTC of creation from the video's own header, or None
    clock_offset : s; how far the camera's clock is ahead; it is subtracted
    first, last : UTC of the first and last frame, corrected
    frames, interval, longest : count of frames, median and longest time between two, s
    gaps : count of intervals over 1.5 times the median
    """

    start: datetime
    header: datetime | None
    clock_offset: float
    first: datetime
    last: datetime
    frames: int
    interval: float
    longest: float
    gaps: int

    @property
    def start_after_header(self) -> float | None:
        """Time, s, from the header's creation time to `start`."""
        return None if self.header is None else (self.start - self.header).total_seconds()


def read_clock(site: Path, clock_offset: float | None = None) -> Clock:
    """Read the clock of a survey's video; `clock_offset`, s, overrides that of site.toml.

    Raises
    ------
    InputError
        If there is no [camera] with video and start, a value is not valid, or the video cannot be read.
    """
    path = site / "site.toml" if site.is_dir() else site
    camera = read_toml(path, "a TOML file, as site.toml").get("camera")
    if not isinstance(camera, dict) or not isinstance(camera.get("video"), str):
        raise InputError(f"{path}: no [camera] video; write [camera] with video, calibration and start")
    start, offset = camera.get("start"), camera.get("clock_offset", 0.0) if clock_offset is None else clock_offset
    if not isinstance(start, datetime):
        raise InputError(f"{path}: [camera] start is {start}; {TIME_MEND}")
    start = moment(start, f"{path}: [camera] start")
    if isinstance(offset, bool) or not isinstance(offset, int | float) or not abs(offset) <= FARTHEST:
        raise InputError(f"{path}: [camera] clock_offset is {offset}; give seconds")
    return _clock(open_video(path.parent / camera["video"]), start.astimezone(UTC), float(offset))


def _clock(video: Video, start: datetime, offset: float) -> Clock:
    steps = np.diff(video.time)
    header = None if video.created is None else datetime.fromisoformat(str(video.created)[:19]).replace(tzinfo=UTC)
    first, last = (start + timedelta(seconds=float(video.time[end]) - offset) for end in (0, -1))
    return Clock(
        start=start,
        header=header,
        clock_offset=offset,
        first=first,
        last=last,
        frames=len(video),
        interval=video.frame_interval,
        longest=float(steps.max()) if len(steps) else 0.0,
        gaps=int((steps > GAP * video.frame_interval).sum()),
    )


def facts(clock: Clock) -> dict[str, Any]:
    """Everything, JSON-ready."""
    result = asdict(clock) | {"start_after_header": clock.start_after_header}
    return {key: value.isoformat() if isinstance(value, datetime) else value for key, value in result.items()}


def words(clock: Clock) -> str:
    """Lines of text."""
    lines = [f"start (site.toml)     {_utc(clock.start)}"]
    if clock.header is None:
        lines.append("creation (header)     the video does not say")
    else:
        after = clock.start_after_header
        lines.append(f"creation (header)     {_utc(clock.header)}; start is {after:+.3f} s from it")
    lines += [
        f"clock_offset          {clock.clock_offset:+.3f} s, taken off: the camera's clock is ahead by this much",
        f"first frame           {_utc(clock.first)}",
        f"last frame            {_utc(clock.last)}",
        f"frames                {clock.frames}, every {clock.interval * 1e3:.1f} ms, "
        f"at most {clock.longest * 1e3:.1f} ms apart, {clock.gaps} gaps",
        f"0.1 s of clock error is {0.1 * SPEED:.1f} m of a vehicle at 50 km/h",
        "set it in site.toml: [camera] clock_offset = SECONDS; roadfiber locate compares it with the DAS",
    ]
    return "\n".join(lines)


def _utc(time: datetime) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + " UTC"
