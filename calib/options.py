"""What the commands' options mean: the local frame, the picture, measured values."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, LocalFrame, read_toml, require_writable
from vision.sources import require_file
from vision.stills import ANY_RATE, PICTURES, read_still

Image = NDArray[np.uint8]
Choice = TypeVar("Choice", bound=str)


def local_frame(path: Path | None, origin: str | None, x_azimuth: float | None) -> LocalFrame | None:
    """Take the frame from a TOML file's `[frame]`, or from `origin` "LAT,LON" and `x_azimuth`; None without either.

    Raises
    ------
    InputError
        If both are given, one of the two is missing, or a value is not valid.

    >>> local_frame(None, "32.1,34.8", 78.0)
    LocalFrame(origin=(32.1, 34.8), x_azimuth=78.0)
    """
    if path is None and origin is None and x_azimuth is None:
        return None
    if path is not None:
        if origin is not None or x_azimuth is not None:
            raise InputError("--frame and --origin, --x-azimuth: give one or the other")
        table = _frame_table(path)
        return _checked(table.get("origin"), table.get("x_azimuth"), f"{path}: [frame]")
    parts = origin.split(",") if origin else []
    try:
        values = [float(part) for part in parts]
    except ValueError as error:
        raise InputError(f"--origin: give LAT,LON in degrees, as 32.113,34.804, not {origin}") from error
    return _checked(values, x_azimuth, "--origin and --x-azimuth")


def _frame_table(path: Path) -> dict[str, Any]:
    table = read_toml(path, "a TOML file, as site.toml").get("frame")
    if not isinstance(table, dict):
        raise InputError(f"{path}: no [frame]; write [frame] with origin = [LAT, LON] and x_azimuth = DEGREES")
    return table


def _checked(origin: Any, x_azimuth: Any, where: str) -> LocalFrame:
    numbers = [*origin, x_azimuth] if isinstance(origin, list) else []
    if len(numbers) != 3 or not all(_is_number(value) for value in numbers):
        raise InputError(f"{where}: needs origin (latitude, longitude) and x_azimuth, degrees")
    if abs(numbers[0]) > 90 or abs(numbers[1]) > 180 or abs(numbers[2]) > 360:
        raise InputError(f"{where}: latitude within 90, longitude within 180, x_azimuth within 360 degrees")
    return LocalFrame((float(numbers[0]), float(numbers[1])), float(x_azimuth))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def measured(text: str | None, option: str, unit: str) -> tuple[float, float] | None:
    """Read "VALUE,SIGMA", both positive; None for None.

    >>> measured("7.5,0.2", "--height", "m")
    (7.5, 0.2)
    """
    if text is None:
        return None
    try:
        value, sigma = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"{option}: give VALUE,SIGMA in {unit}, as 7.5,0.2, not {text}") from error
    if not (np.isfinite([value, sigma]).all() and value > 0 and sigma > 0):
        raise InputError(f"{option}: value and sigma must be above 0 {unit}, not {text}")
    return value, sigma


def picture_size(video: Path | None, image_size: str | None) -> tuple[tuple[int, int], Image | None]:
    """Width and height, px, from "WxH" or from a video or picture, and then also its frame [height, width, 3].

    Raises
    ------
    InputError
        If neither is given, both are given and differ, the text is not a size, or the video cannot be read.

    >>> picture_size(None, "1280x720")
    ((1280, 720), None)
    """
    given = two_counts(image_size, "--image-size", "1280x720") if image_size is not None else None
    if video is None:
        if given is None:
            raise InputError("the size of the image is not known: give --video VIDEO or --image-size WxH")
        return given, None
    image = read_frame(video)
    size = (image.shape[1], image.shape[0])
    if given is not None and given != size:
        raise InputError(f"--image-size {image_size}: the video is {size[0]}x{size[1]}; leave one of them out")
    return size, image


def read_frame(source: Path, time: float | None = None) -> Image:
    """Read a picture, or the frame of a video nearest to `time`, s since its start (by default its middle one).

    A folder of pictures counts as a video; its pictures need times of their own only if `time` is given.

    Raises
    ------
    InputError
        If the file is missing or is neither, or the video is shorter.
    """
    if source.suffix.lower() in PICTURES:
        return read_picture(source)
    from vision.video import open_video

    video = open_video(source, rate=ANY_RATE if time is None else None)
    if time is None:
        frames = video.sample(3)
        return frames[len(frames) // 2].image
    if not video.time[0] - video.frame_interval <= time <= video.time[-1] + video.frame_interval:
        raise InputError(f"--time {time:g}: the video runs from {video.time[0]:.1f} to {video.time[-1]:.1f} s")
    place = int(np.abs(video.time - time).argmin())
    return next(video.frames_at(np.array([place]))).image


def read_picture(path: Path) -> Image:
    """Read a picture [height, width, 3], BGR; InputError if it is not one."""
    require_file(path)
    image = read_still(path)
    if image is None:
        raise InputError(f"{path}: not a picture that can be read; give .png or .jpg")
    return image


def two_counts(text: str, option: str, example: str) -> tuple[int, int]:
    """Read "AxB", both above zero.

    >>> two_counts("9x6", "--squares", "9x6")
    (9, 6)
    """
    first, cross, second = text.lower().partition("x")
    if not (cross and first.isdigit() and second.isdigit() and int(first) > 0 and int(second) > 0):
        raise InputError(f"{option}: give WIDTHxHEIGHT, as {example}, not {text}")
    return int(first), int(second)


def one_of(text: str, choices: Sequence[Choice], option: str) -> Choice:
    """Return `text` if it is one of the choices, else raise InputError.

    >>> one_of("camera", ("auto", "camera"), "--model")
    'camera'
    """
    for choice in choices:
        if text == choice:
            return choice
    raise InputError(f"{option} {text}: give one of {', '.join(choices)}")


def keep_inputs(written: Sequence[Path | None], read: Sequence[Path | None]) -> None:
    """Raise InputError where a file to write is one to read, or cannot be written.

    >>> keep_inputs([Path("street.png")], [Path("street.png")])
    Traceback (most recent call last):
    vision.contract.errors.InputError: street.png: would be overwritten, and is an input; give another --out
    """
    inputs = {path.resolve() for path in read if path}
    for path in written:
        if path and path.resolve() in inputs:
            raise InputError(f"{path}: would be overwritten, and is an input; give another --out")
    require_writable(*(path for path in written if path))
