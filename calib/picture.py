"""Draw a calibration over a frame of its video: ground grid, control points, residuals."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.ground import GroundFit
from vision.contract import InputError, writing

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
GREEN, RED, BLUE, YELLOW = (80, 220, 80), (60, 60, 255), (255, 200, 110), (0, 230, 255)  # blue, green, red
MAGNIFY = 20.0  # residuals are drawn this many times as long
NARROW = 1000  # px
GRID_X, GRID_Y = 10.0, 2.0  # m between grid lines


def draw_fit(image: Image, points: ControlPoints, fit: GroundFit) -> Image:
    """Draw the ground grid, the points and their magnified residuals on a copy of a frame [height, width, 3].

    Frames narrower than `NARROW` px are drawn twice as large, so that the names can be read.
    """
    import cv2

    scale = 2 if image.shape[1] < NARROW else 1
    canvas = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8)
    for line, label in _grid(points.ground):
        _polyline(canvas, scale * fit.calibration.to_image(line), label)
    predicted = scale * fit.calibration.to_image(points.ground)
    for name, pixel, place, used in zip(points.names, scale * points.pixels, predicted, fit.used, strict=True):
        color = GREEN if used else RED
        center = _integers(pixel)
        cv2.circle(canvas, center, 5, color, 1, cv2.LINE_AA)
        if np.isfinite(place).all():
            cv2.line(canvas, center, _integers(pixel + MAGNIFY * (place - pixel)), YELLOW, 1, cv2.LINE_AA)
        cv2.putText(canvas, name, (center[0] + 7, center[1] - 4), cv2.FONT_HERSHEY_SIMPLEX, 0.35, color, 1, cv2.LINE_AA)
    note = f"grid {GRID_X:g} x {GRID_Y:g} m; yellow: residuals x{MAGNIFY:g}; red: left out"
    cv2.putText(canvas, note, (8, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas


def write_picture(image: Image, path: str | Path) -> None:
    """Write an image [height, width, 3], whole or not at all; its suffix names the format."""
    import cv2

    with writing(path) as temporary:
        if not cv2.haveImageWriter(str(temporary)) or not cv2.imwrite(str(temporary), image):
            raise InputError(f"{path}: no picture of this kind can be written; end its name in .png or .jpg")


def _grid(ground: Array) -> list[tuple[Array, str]]:
    """Lines [n, 2], m, across the surveyed area and one cell beyond, each with the label of its coordinate."""
    low = np.floor(ground.min(axis=0) / (GRID_X, GRID_Y)) * (GRID_X, GRID_Y)
    high = np.ceil(ground.max(axis=0) / (GRID_X, GRID_Y)) * (GRID_X, GRID_Y)
    x, y = np.linspace(low[0], high[0], 200), np.linspace(low[1], high[1], 50)
    across = [(np.column_stack([np.full_like(y, at), y]), f"x {at:g}") for at in np.arange(low[0], high[0] + 1, GRID_X)]
    along = [(np.column_stack([x, np.full_like(x, at)]), f"y {at:g}") for at in np.arange(low[1], high[1] + 1, GRID_Y)]
    return across + along


def _polyline(canvas: Image, pixels: Array, label: str) -> None:
    import cv2

    height, width = canvas.shape[:2]
    near = np.isfinite(pixels).all(axis=1) & (np.abs(pixels) < 10 * max(width, height)).all(axis=1)
    pixels = pixels[near]
    if len(pixels) < 2:
        return
    cv2.polylines(canvas, [pixels.round().astype(np.int32)], False, BLUE, 1, cv2.LINE_AA)
    inside = pixels[((pixels > 0) & (pixels < (width - 40, height))).all(axis=1)]
    if len(inside):
        cv2.putText(canvas, label, _integers(inside[-1]), cv2.FONT_HERSHEY_SIMPLEX, 0.33, BLUE, 1, cv2.LINE_AA)


def _integers(pixel: Array) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))
