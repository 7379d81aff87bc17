"""Video files with the time every frame was really taken, not the frame rate the header claims."""

import logging
import os
import struct
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from vision.cache import checksum, keep_arrays, kept_arrays
from vision.contract.errors import InputError
from vision.frames import Frame, Video
from vision.sources import require_file, undecodable
from vision.stills import open_stills
from vision.timestamps import SAME, clock, codec_of, frame_times, open_capture

log = logging.getLogger("roadfiber.video")

# Silence FFmpeg's own messages, which would add to our one line. FFmpeg reads this once, before the first file.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

MP4_EPOCH = np.datetime64("1904-01-01T00:00:00", "ns")


class VideoFile(Video):
    """A file that FFmpeg reads."""

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of the file."""
        return checksum(self.path)

    def decoded(self, wanted: NDArray[np.intp]) -> Iterator[Frame | None]:
        """Decode the frame at each of these places; InputError, where the file ends before them."""
        capture, now, damaged = open_capture(self.path), -np.inf, 0
        for place in wanted:
            refused = 0
            # Grabbing is exact, unlike seeking (key frames, variable rates); damaged packets are refused one by one.
            while now < self.time[place] - SAME:
                if capture.grab():
                    now = clock(capture)
                elif (refused := refused + 1) > len(self):
                    raise InputError(
                        f"{self.path}: decodes to {max(now, 0.0):.1f} s of {self.time[-1]:.1f} s; it changed while it "
                        "was read, or is damaged: wait until the recording is finished, or copy it again"
                    )
            here = abs(now - self.time[place]) < SAME
            image = capture.retrieve()[1] if here else None
            damaged += image is None
            yield None if image is None else Frame(int(self.index[place]), float(self.time[place]), image)
        if damaged:
            log.warning("%s: %d frames are damaged and left out", self.path, damaged)


def open_video(path: str | Path, cache: Path | None = None, rate: float | None = None) -> Video:
    """Count and time the frames of a file (`vision.timestamps`) or a folder of pictures (`vision.stills`).

    The timestamp of a frame is the presentation time the container holds for it. A frame whose time does not increase
    is left out and counted in the log.

    Parameters
    ----------
    path : the file or folder
    cache : folder where what decodes is kept by the file's checksum; the next time nothing is decoded
    rate : 1/s, of the pictures of a folder; by default they must tell their times. A file always does

    Raises
    ------
    InputError, for a file that is missing, no video, without frames or timestamps, or cut short (what decodes
    ends earlier than the header says).
    """
    import cv2

    path = Path(path)
    if path.is_dir():
        return open_stills(path, rate)
    require_file(path)
    capture = open_capture(path)
    usual, claimed = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
    raw, shape = frame_times(path) if cache is None else _kept_times(path, cache)
    if not len(raw):
        raise undecodable(path, codec_of(capture))
    increasing = raw > np.maximum.accumulate(np.concatenate([[-np.inf], raw[:-1]]))
    if len(raw) > 1 and increasing.sum() < 0.5 * len(raw):
        raise InputError(f"{path}: has no timestamps; remux it (ffmpeg -r RATE -i {path.name} -c copy out.mp4)")
    if not increasing.all():
        log.warning("%s: %d frames left out, their time does not increase", path, (~increasing).sum())
    created, duration = movie_header(path)
    _require_whole(path, float(raw.max()), duration or (claimed / usual if usual > 0 else 0.0))
    height, width = shape
    return VideoFile(path, width, height, np.flatnonzero(increasing), raw[increasing], created)


def _kept_times(path: Path, cache: Path) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """`frame_times`, cached by file."""
    place = cache / "timestamps" / f"{checksum(path)}.npz"
    kept = kept_arrays(place)
    if kept is None:
        time, shape = frame_times(path)
        kept = {"time": time, "shape": np.array(shape)}
        keep_arrays(place, kept)
    height, width = (int(side) for side in kept["shape"])
    return np.asarray(kept["time"], float), (height, width)


def _require_whole(path: Path, decoded: float, duration: float) -> None:
    # Headers may include the last frame's duration, or frames that a recorder dropped at the end.
    if duration - decoded > max(1.0, 0.03 * duration):
        raise InputError(
            f"{path}: decodes to {decoded:.1f} s of the {duration:.1f} s its header claims, so it is cut "
            "short or damaged; copy it again, or keep what is whole (ffmpeg -i IN -c copy OUT)"
        )


def movie_header(path: str | Path) -> tuple[np.datetime64 | None, float | None]:
    """Read (creation time in UTC, duration in s) from an MP4 or QuickTime file, None where it does not say.

    `moov/mvhd` of ISO 14496-12, 8.2.2. The duration honors edit lists, so a trimmed clip is not a damaged one.
    Cameras differ in whether they keep UTC and whether they write the recording's start or its end.
    """
    with Path(path).open("rb") as file:
        movie = _find_box(file, b"moov", 0, Path(path).stat().st_size)
        header = _find_box(file, b"mvhd", *movie) if movie else None
        if not header:
            return None, None
        file.seek(header[0])
        wide = file.read(4)[:1] == b"\x01"
        layout = ">QQIQ" if wide else ">IIII"
        seconds, _, ticks_per_second, ticks = struct.unpack(layout, file.read(struct.calcsize(layout)))
    created = MP4_EPOCH + np.timedelta64(seconds, "s") if seconds else None
    return created, ticks / ticks_per_second if ticks and ticks_per_second else None


def _find_box(file: BinaryIO, kind: bytes, start: int, end: int) -> tuple[int, int] | None:
    """Content (first byte, end) of the first box of a kind in a part of an MP4 file."""
    while start + 8 <= end:
        file.seek(start)
        size, name = struct.unpack(">I4s", file.read(8))
        content = start + 8
        if size == 1:
            size, content = struct.unpack(">Q", file.read(8))[0], start + 16
        if size == 0:
            size = end - start
        if name == kind:
            return content, start + size
        if size < 8:
            return None
        start += size
    return None
