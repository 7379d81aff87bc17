"""`roadfiber track --draw`: the video with its tracks drawn over it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.camera import Calibration
from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.contract.progress import progress
from vision.frames import Video
from vision.interpolate import BOX
from vision.overlay import COLORS, Drawn, Image, draw
from vision.tracker import contact

if TYPE_CHECKING:
    import pandas as pd

CODECS = ("avc1", "mp4v")  # H.264 where this OpenCV can write it, else MPEG-4
TAIL = 2.0  # s
MOST_REPEATED = 50  # most repeats of a picture where frames are far apart


def require_drawable(out: Path, video: Path) -> None:
    """Raise InputError unless `out` is an .mp4 file other than the video.

    >>> require_drawable(Path("tracks.gif"), Path("street.mp4"))
    Traceback (most recent call last):
    vision.contract.errors.InputError: tracks.gif: the video with tracks is written as .mp4; end its name so
    """
    if out.suffix.lower() != ".mp4":
        raise InputError(f"{out}: the video with tracks is written as .mp4; end its name so")
    if out.resolve() == video.resolve():
        raise InputError(f"{out}: would be overwritten, and is the video to track; give another --draw")


def draw_video(
    video: Video, table: "pd.DataFrame", out: Path, every: int = 1, calibration: Calibration | None = None
) -> None:
    """Write the video with boxes, tails of `TAIL` s, ids, classes and, in meters, speeds and fixes; whole or not.

    Frames come at a constant rate, that of the video's usual frame: where frames are farther apart, the last one stays,
    for `MOST_REPEATED` pictures at most.

    Parameters
    ----------
    video : that was tracked
    table : [fix] with track_id, class, frame, interpolated, the box (px) and perhaps x, y, sigma_x, sigma_y, speed
    out : .mp4 file
    every : n-th frame that was looked at; others are left out
    calibration : by which the fixes in meters are drawn; without it, tails follow the boxes' lower edges

    Raises
    ------
    InputError
        If this OpenCV writes no .mp4, or the disk is full.
    """
    places = np.arange(0, len(video), every)
    step = float(np.median(np.diff(video.time[places]))) if len(places) > 1 else 1.0
    vehicles = vehicles_by_frame(table, dict(zip(video.index.tolist(), video.time.tolist(), strict=True)), calibration)
    with writing(out) as temporary, progress("drawing tracks", len(places)) as advance:
        writer = _writer(temporary, 1 / step, (video.width // 2 * 2, video.height // 2 * 2), out)
        written = 0
        for place, image in zip(places, _images(video, places), strict=True):
            picture = draw(image, vehicles.get(int(video.index[place]), []))
            due = round(float(video.time[place] - video.time[0]) / step) + 1
            for _ in range(min(max(due - written, 0), MOST_REPEATED)):
                writer.write(picture[: video.height // 2 * 2, : video.width // 2 * 2])
            written = max(written, due)
            advance(1)
        writer.release()
        _require_pictures(temporary, out)


def vehicles_by_frame(
    table: "pd.DataFrame", times: dict[int, float], calibration: Calibration | None = None
) -> dict[int, list[Drawn]]:
    """What to draw in every frame.

    Parameters
    ----------
    table, calibration : as `draw_video` takes them
    times : s, of every frame of the video
    """
    shown: dict[int, list[Drawn]] = {}
    order = table.groupby("track_id", sort=False)["frame"].min().sort_values(kind="stable").index
    by_track = {name: rows.sort_values("frame") for name, rows in table.groupby("track_id")}
    for place, name in enumerate(order):
        rows, color = by_track[name], COLORS[place % len(COLORS)]
        frames, boxes = rows["frame"].to_numpy(int), rows[list(BOX)].to_numpy(float)
        time = np.array([times[frame] for frame in frames.tolist()])
        at = rows[["x", "y"]].to_numpy(float) if calibration else np.full((len(rows), 2), np.nan)
        stood = calibration.to_image(at) if calibration else contact(boxes)
        stood = np.where(np.isfinite(stood), stood, contact(boxes))
        crosses = _crosses(calibration, at, rows[["sigma_x", "sigma_y"]].to_numpy(float)) if calibration else None
        detected = ~rows["interpolated"].to_numpy(bool)
        speed = rows["speed"].to_numpy(float) if "speed" in rows else np.full(len(rows), np.nan)
        begins = np.searchsorted(time, time - TAIL)
        for now, frame in enumerate(frames.tolist()):
            part = slice(int(begins[now]), now + 1)
            words = words_of(str(name), str(rows["class"].iloc[0]), float(speed[now]), at[now])
            fix = None if crosses is None else np.where(np.isfinite(crosses[now]), crosses[now], stood[now])
            shown.setdefault(frame, []).append(Drawn(boxes[now], words, color, detected[part], stood[part], fix))
    return shown


def _crosses(calibration: Calibration, place: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels [fix, axis, end, 2] two standard deviations [fix, 2] of places [fix, 2], m, to either side."""
    arms = 2 * sigma[:, :, None] * np.eye(2)
    ends = place[:, None, None] + np.stack([-arms, arms], axis=2)
    return calibration.to_image(ends.reshape(-1, 2)).reshape(ends.shape)


def words_of(name: str, label: str, speed: float, place: NDArray[np.float64]) -> str:
    """Label of a vehicle, with its speed, m/s, and its place (2,), m, if known.

    >>> words_of("12", "car", 8.94, np.array([41.26, 1.8])), words_of("3", "bus", np.nan, np.full(2, np.nan))
    ('12 car 8.9 m/s at 41.3, 1.8 m', '3 bus')
    """
    at = f" at {place[0]:.1f}, {place[1]:.1f} m" if np.isfinite(place).all() else ""
    return f"{name} {label}" + (f" {speed:.1f} m/s" if np.isfinite(speed) else "") + at


def _images(video: Video, places: NDArray[np.intp]) -> Iterator[Image]:
    """Pictures of these frames; for a damaged one the last before it."""
    last = np.zeros((video.height, video.width, 3), np.uint8)
    for frame in video.decoded(places):
        last = last if frame is None else frame.image
        yield last


def _writer(path: Path, rate: float, size: tuple[int, int], out: Path) -> Any:
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # if a codec is missing, try the next one
    for codec in CODECS:
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, size)
        if writer.isOpened():
            return writer
        path.unlink(missing_ok=True)
    raise InputError(f"{out}: this OpenCV writes no .mp4; leave --draw out")


def _require_pictures(path: Path, out: Path) -> None:
    """Refuse a file that ends early: OpenCV does not tell of a full disk."""
    import cv2

    if not path.is_file() or cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) < 1:
        raise InputError(f"{out}: cannot be written to its end; make room, or write elsewhere")
