"""What the command's options mean: the local frame, and the size of the image."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, LocalFrame


def local_frame(path: Path | None, origin: str | None, x_azimuth: float | None) -> LocalFrame | None:
    """Take the frame from a TOML file's `[frame]`, or from `origin` "LAT,LON" and `x_azimuth`; None without either.

    Raises
    ------
    InputError
        Both are given, one of the two is missing, or a value is none.

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
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get("frame")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give a TOML file with [frame] origin, x_azimuth") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not TOML: {error}") from error
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


def picture_size(video: Path | None, image_size: str | None) -> tuple[tuple[int, int], NDArray[np.uint8] | None]:
    """Width and height, px, from "WxH" or from a video, and then also its middle frame [height, width, 3].

    Raises
    ------
    InputError
        Neither is given, both and they differ, the text is no size, or the video cannot be read.

    >>> picture_size(None, "1280x720")
    ((1280, 720), None)
    """
    given = _parse_size(image_size) if image_size is not None else None
    if video is None:
        if given is None:
            raise InputError("the size of the image is not known: give --video VIDEO or --image-size WxH")
        return given, None
    from vision.video import open_video

    content = open_video(video)
    size = (content.width, content.height)
    if given is not None and given != size:
        raise InputError(f"--image-size {image_size}: the video is {size[0]}x{size[1]}; leave one of them out")
    frames = content.sample(3)
    return size, frames[len(frames) // 2].image


def _parse_size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit() and int(width) > 0 and int(height) > 0):
        raise InputError(f"--image-size: give WIDTHxHEIGHT in pixels, as 1280x720, not {text}")
    return int(width), int(height)
