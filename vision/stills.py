"""A folder of pictures as a video: in the order of their names, at the times they tell or at a rate that is given."""

import hashlib
import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.progress import progress
from vision.frames import Frame, Video
from vision.still_times import exif_times, name_times

log = logging.getLogger("roadfiber.video")

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
ANY_RATE = 1.0  # 1/s, used if it does not matter when the pictures were taken


@dataclass(frozen=True)
class Stills(Video):
    """Pictures of a fixed camera.

    Parameters
    ----------
    files : [frame], the pictures
    """

    files: tuple[Path, ...] = ()

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of the checksums of all pictures, in their order."""
        digest = hashlib.sha256()
        with progress(f"checksum of {self.path.name}", len(self)) as advance:
            for path in self.files:
                digest.update(hashlib.sha256(path.read_bytes()).digest())
                advance(1)
        return digest.hexdigest()

    def decoded(self, wanted: NDArray[np.intp]) -> Iterator[Frame | None]:
        """Decode the picture at each of these places; None for a damaged one."""
        damaged = 0
        for place in wanted:
            path = self.files[place]
            image = read_still(path)
            damaged += image is None
            if image is not None and image.shape[:2] != (self.height, self.width):
                raise InputError(
                    f"{path}: is {image.shape[1]} x {image.shape[0]} px, but the first picture of its folder is "
                    f"{self.width} x {self.height} px; leave only those of one camera there"
                )
            yield None if image is None else Frame(int(self.index[place]), float(self.time[place]), image)
        if damaged:
            log.warning("%s: %d pictures are damaged and left out", self.path, damaged)


def read_still(path: Path) -> NDArray[np.uint8] | None:
    """Read a picture [height, width, 3], BGR; None if it is not one."""
    import cv2

    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a picture or a video") from error
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    return None if image is None else np.asarray(image, np.uint8)


def open_stills(folder: Path, rate: float | None = None) -> Stills:
    """Open a folder of pictures, which are taken in the order of their names, numbers in these by their value.

    Parameters
    ----------
    folder : only its pictures count, by their suffix
    rate : 1/s, at which they were taken; by default their times are those of their EXIF data, else those in their names
        (as 20250811_060000.250), where these increase from each to the next

    Raises
    ------
    InputError, where the folder holds no picture, the first cannot be read, or their times are not known.
    """
    files = tuple(sorted((path for path in folder.iterdir() if path.suffix.lower() in PICTURES), key=_by_number))
    if not files:
        raise InputError(f"{folder}: holds no pictures ({', '.join(PICTURES)}); give a video or a folder of stills")
    first = read_still(files[0])
    if first is None:
        raise InputError(f"{files[0]}: not a picture that can be read; take it out of the folder, or copy it again")
    time, created = (np.arange(len(files)) / rate, None) if rate else told_times(folder, files)
    return Stills(folder, first.shape[1], first.shape[0], np.arange(len(files)), time, created, files)


def require_rate(video: Path, rate: float | None) -> None:
    """Raise InputError where a rate, 1/s, is none, or is given for a file, which has its own times.

    >>> require_rate(Path("street.mp4"), 25.0)
    Traceback (most recent call last):
    vision.contract.errors.InputError: --frame-rate 25: is for a folder of stills; street.mp4 has its own times
    """
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise InputError(f"--frame-rate {rate:g}: must be above 0")
    if rate is not None and not video.is_dir():
        raise InputError(f"--frame-rate {rate:g}: is for a folder of stills; {video} has its own times")


def told_times(folder: Path, files: Sequence[Path]) -> tuple[NDArray[np.float64], np.datetime64 | None]:
    """Times [picture], s since the first, that pictures tell, and UTC of the first where they tell the zone, too."""
    for source, times in (("their EXIF data", exif_times(files)), ("their names", name_times(files))):
        if times is not None and (np.diff(times.clock) > np.timedelta64(0)).all():
            log.info("%s: %d pictures, timed by %s", folder, len(files), source)
            return (times.clock - times.clock[0]) / np.timedelta64(1, "s"), times.clock[0] if times.utc else None
    raise InputError(
        f"{folder}: neither EXIF data nor names give its {len(files)} pictures times that increase from one to the "
        "next; say how many were taken per second (--frame-rate 5)"
    )


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Key that puts `a9.png` before `a10.png`."""
    return [(int(part), "") if part.isdigit() else (-1, part.lower()) for part in re.split(r"(\d+)", path.name)]
