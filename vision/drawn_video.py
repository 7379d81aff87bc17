"""`roadfiber track --draw`: the video with its tracks drawn over it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.contract.progress import progress
from vision.frames import Video
from vision.interpolate import BOX
from vision.overlay import COLORS, Drawn, Image, draw

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


def draw_video(video: Video, table: "pd.DataFrame", out: Path, every: int = 1) -> None:
    """Write the video with boxes, tails of `TAIL` s, ids, classes and, where the table has it, speeds; whole or not.

    Frames come at a constant rate, that of the video's usual frame: where frames are farther apart, the last one stays,
    for `MOST_REPEATED` pictures at most.

    Parameters
    ----------
    video : that was tracked
    table : [fix] with track_id, class, frame, interpolated, the box (px) and perhaps speed (m/s)
    out : .mp4 file
    every : n-th frame that was looked at; others are left out

    Raises
    ------
    InputError
        If this OpenCV writes no .mp4, or the disk is full.
    """
    places = np.arange(0, len(video), every)
    step = float(np.median(np.diff(video.time[places]))) if len(places) > 1 else 1.0
    vehicles = vehicles_by_frame(table, dict(zip(video.index.tolist(), video.time.tolist(), strict=True)))
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


def vehicles_by_frame(table: "pd.DataFrame", times: dict[int, float]) -> dict[int, list[Drawn]]:
    """What to draw in every frame.

    Parameters
    ----------
    table : [fix] as `draw_video` takes it
    times : s, of every frame of the video
    """
    shown: dict[int, list[Drawn]] = {}
    order = table.groupby("track_id", sort=False)["frame"].min().sort_values(kind="stable").index
    by_track = {name: rows.sort_values("frame") for name, rows in table.groupby("track_id")}
    for place, name in enumerate(order):
        rows, color = by_track[name], COLORS[place % len(COLORS)]
        frames, boxes = rows["frame"].to_numpy(int), rows[list(BOX)].to_numpy(float)
        time = np.array([times[frame] for frame in frames.tolist()])
        contact = np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], axis=1)
        detected = ~rows["interpolated"].to_numpy(bool)
        speed = rows["speed"].to_numpy(float) if "speed" in rows else np.full(len(rows), np.nan)
        begins = np.searchsorted(time, time - TAIL)
        for now, frame in enumerate(frames.tolist()):
            part = slice(int(begins[now]), now + 1)
            words = words_of(str(name), str(rows["class"].iloc[0]), float(speed[now]))
            shown.setdefault(frame, []).append(Drawn(boxes[now], words, color, detected[part], contact[part]))
    return shown


def words_of(name: str, label: str, speed: float) -> str:
    """Label of a vehicle, with its speed, m/s, if known.

    >>> words_of("12", "car", 8.94), words_of("3", "bus", float("nan"))
    ('12 car 8.9 m/s', '3 bus')
    """
    return f"{name} {label}" + (f" {speed:.1f} m/s" if np.isfinite(speed) else "")


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
