"""When pictures were taken, by their EXIF data or by their names."""

import re
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

EXIF, TAKEN, FRACTION, OFFSET = 0x8769, 0x9003, 0x9291, 0x9011  # the block, and what it says of the moment of exposure
# A date and a time of day, a fraction of a second (behind a point or comma, or just milli- or microseconds), a zone.
STAMP = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[T_ .-]*(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)"
    r"(?:[.,](\d{1,6})|[-_]?(\d{3}|\d{6}))?(?!\d)(Z|[+-]\d\d:?\d\d)?"
)
UNIX = re.compile(r"(?<!\d)(1\d{9})(?:[._]?(\d{3}|\d{6}))?(?!\d)")  # s since 1970, and a fraction


class Times(NamedTuple):
    """Times of pictures.

    Attributes
    ----------
    clock : datetime64[us] [picture], by the camera's clock
    utc : whether that is UTC
    """

    clock: NDArray[np.datetime64]
    utc: bool


def exif_times(files: Sequence[Path]) -> Times | None:
    """Times by EXIF data; None unless every picture has one."""
    return _all(files, _taken)


def name_times(files: Sequence[Path]) -> Times | None:
    """Times by names; None unless every name has one.

    >>> name_times([Path("cam1_20250811_060000.250.jpg")])
    Times(clock=array(['2025-08-11T06:00:00.250000'], dtype='datetime64[us]'), utc=False)
    >>> name_times([Path("2025-08-11T08-00-00+0200.png")])
    Times(clock=array(['2025-08-11T06:00:00.000000'], dtype='datetime64[us]'), utc=True)
    >>> name_times([Path("frame_000017.png")]) is None
    True
    """
    return _all(files, lambda path: _named(path.stem))


def _all(files: Sequence[Path], moment_of: Callable[[Path], datetime | None]) -> Times | None:
    moments = list[datetime]()
    for path in files:
        moment = moment_of(path)
        if moment is None:
            return None
        moments.append(moment)
    zoned = [moment.tzinfo is not None for moment in moments]
    if any(zoned) != all(zoned):
        return None
    shifts = [moment.utcoffset() or timedelta(0) for moment in moments]
    clock = [moment.replace(tzinfo=None) - shift for moment, shift in zip(moments, shifts, strict=True)]
    return Times(np.array(clock, "datetime64[us]"), all(zoned))


def _named(stem: str) -> datetime | None:
    if found := STAMP.search(stem):
        *parts, behind_point, digits, zone = found.groups()
        return _moment("".join(parts), behind_point or digits or "", zone or "")
    if found := UNIX.search(stem):
        seconds, fraction = found.groups()
        return datetime.fromisoformat("1970-01-01T00:00:00+00:00") + timedelta(
            seconds=int(seconds), microseconds=int((fraction or "").ljust(6, "0"))
        )
    return None


def _taken(path: Path) -> datetime | None:
    from PIL import Image

    try:
        with Image.open(path) as image:
            block = image.getexif().get_ifd(EXIF)
    except (OSError, SyntaxError, ValueError):
        return None
    taken, fraction, zone = (str(block.get(tag, "")).strip("\0 ") for tag in (TAKEN, FRACTION, OFFSET))
    return _moment(re.sub(r"\D", "", taken), re.sub(r"\D", "", fraction), zone)


def _moment(digits: str, fraction: str, zone: str) -> datetime | None:
    """Fourteen digits from year to second, those of a fraction of a second, and a zone or nothing; None for no time."""
    try:
        return datetime.strptime(f"{digits}{fraction[:6] or '0':0<6}{zone}", "%Y%m%d%H%M%S%f" + ("%z" if zone else ""))
    except ValueError:
        return None
