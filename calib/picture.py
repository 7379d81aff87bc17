"""Draw a calibration over a frame of its video: ground grid, horizon, control points, residuals."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.ground import GroundFit
from vision.camera import Calibration
from vision.contract import InputError, writing

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Color = tuple[int, int, int]
GREEN, RED, BLUE, YELLOW = (80, 220, 80), (60, 60, 255), (255, 200, 110), (0, 230, 255)  # blue, green, red
WHITE, BLACK, MAGENTA = (255, 255, 255), (0, 0, 0), (255, 90, 255)
MAGNIFY = 20.0  # residuals are drawn this many times as long
NARROW = 1000  # px
GRID_X, GRID_Y = 10.0, 2.0  # m between grid lines
FAR = 2000.0  # m, where the horizon is drawn
STEP = 0.25  # m between the points of a line
NOTE, LABEL = 0.5, 0.42  # size of letters, 22 px high at 1


def draw_fit(image: Image, points: ControlPoints, fit: GroundFit) -> Image:
    """Draw the ground grid, the points and their magnified residuals on a copy of a frame [height, width, 3].

    Frames narrower than `NARROW` px are drawn twice as large, so that the names can be read.
    """
    canvas, scale = enlarged(image)
    draw_grid(canvas, fit.calibration, points.ground, scale)
    predicted = scale * fit.calibration.to_image(points.ground)
    for name, pixel, place, used in zip(points.names, scale * points.pixels, predicted, fit.used, strict=True):
        draw_point(canvas, name, pixel, GREEN if used else RED)
        if np.isfinite(place).all():
            draw_line(canvas, np.stack([pixel, pixel + MAGNIFY * (place - pixel)]), YELLOW)
    write_note(canvas, f"grid {GRID_X:g} x {GRID_Y:g} m; yellow: residuals x{MAGNIFY:g}; red: left out")
    return canvas


def enlarged(image: Image) -> tuple[Image, int]:
    """Copy of an image, twice as large where it is narrow, and the factor."""
    import cv2

    scale = 2 if image.shape[1] < NARROW else 1
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8), scale


def draw_grid(canvas: Image, calibration: Calibration, ground: Array, scale: int = 1) -> None:
    """Draw lines of equal x and of equal y over the area of places [n, 2], m, and one cell beyond."""
    for line, label in grid_lines(ground):
        pixels = scale * calibration.to_image(line)
        draw_line(canvas, pixels, BLUE)
        height, width = canvas.shape[:2]
        inside = pixels[((pixels > 0) & (pixels < (width - 40, height))).all(axis=1)]
        if len(inside):
            write_at(canvas, label, inside[-1], BLUE, LABEL)


def draw_horizon(canvas: Image, calibration: Calibration, scale: int = 1) -> bool:
    """Draw where the road plane ends, as a line of places `FAR` away all around; say whether any is in the picture."""
    camera = calibration.pinhole()
    center = np.zeros(2) if camera is None else camera.position[:2]
    angle = np.linspace(0, 2 * np.pi, 3000)
    around = center + FAR * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pixels = scale * calibration.to_image(around)
    shown = ((pixels > 0) & (pixels < (canvas.shape[1], canvas.shape[0]))).all(axis=1).any()
    draw_line(canvas, pixels, MAGENTA)
    return bool(shown)


def draw_point(canvas: Image, name: str, pixel: Array, color: Color) -> None:
    """Draw a ring and a name."""
    import cv2

    cv2.circle(canvas, _integers(pixel), 5, color, 1, cv2.LINE_AA)
    write_at(canvas, name, pixel + np.array([7, -4]), color, LABEL)


def draw_line(canvas: Image, pixels: Array, color: Color, thickness: int = 1) -> None:
    """Draw a line through pixels [n, 2], broken where they are not near the picture."""
    import cv2

    reach = 4 * max(canvas.shape[:2])
    near: NDArray[np.bool_] = np.asarray((np.abs(pixels) < reach).all(axis=1))  # false for NaN
    breaks = np.flatnonzero(~near)
    jumps = np.flatnonzero(np.linalg.norm(np.diff(np.where(near[:, None], pixels, 0), axis=0), axis=1) > reach / 2) + 1
    for part in np.split(np.arange(len(pixels)), np.unique(np.concatenate([breaks, breaks + 1, jumps]))):
        if len(part) > 1 and near[part].all():
            cv2.polylines(canvas, [pixels[part].round().astype(np.int32)], False, color, thickness, cv2.LINE_AA)


def write_at(canvas: Image, text: str, pixel: Array, color: Color, size: float) -> None:
    """Write a few words at a pixel, with a dark rim that sets them off from whatever is behind."""
    import cv2

    # Not thicker letters: they would be wider, too.
    rim = [pixel + np.array([right, down]) for right in (-1, 0, 1) for down in (-1, 0, 1)]
    for place, ink in (*((place, BLACK) for place in rim), (pixel, color)):
        cv2.putText(canvas, text, _integers(place), cv2.FONT_HERSHEY_SIMPLEX, size, ink, 1, cv2.LINE_AA)


def write_note(canvas: Image, text: str, color: Color = WHITE) -> None:
    """Write a line in the upper left corner, on a dark box."""
    import cv2

    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, NOTE, 1)
    cv2.rectangle(canvas, (0, 0), (width + 16, height + below + 12), BLACK, cv2.FILLED)
    write_at(canvas, text, np.array([8.0, height + 7.0]), color, NOTE)


def write_picture(image: Image, path: str | Path) -> None:
    """Write an image [height, width, 3], whole or not at all; its suffix names the format."""
    import cv2

    path = Path(path)
    if not cv2.haveImageWriter(str(path)):
        raise InputError(f"{path}: no picture of this kind can be written; end its name in .png or .jpg")
    with writing(path) as temporary:
        temporary.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())


def grid_lines(ground: Array, cell: tuple[float, float] = (GRID_X, GRID_Y)) -> list[tuple[Array, str]]:
    """Lines [n, 2], m, across the area of places [n, 2], to the next whole cell, each with its coordinate's label.

    >>> [label for _, label in grid_lines(np.array([[1.0, 0.5], [12.0, 1.5]]))]
    ['x 0', 'x 10', 'x 20', 'y 0', 'y 2']
    """
    low = np.floor(ground.min(axis=0) / cell) * cell
    high = np.ceil(ground.max(axis=0) / cell) * cell
    x, y = (np.arange(low[axis], high[axis] + STEP / 2, STEP) for axis in (0, 1))
    across = [
        (np.column_stack([np.full_like(y, at), y]), f"x {at:g}") for at in np.arange(low[0], high[0] + 0.1, cell[0])
    ]
    along = [
        (np.column_stack([x, np.full_like(x, at)]), f"y {at:g}") for at in np.arange(low[1], high[1] + 0.1, cell[1])
    ]
    return across + along


def _integers(pixel: Array) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))
