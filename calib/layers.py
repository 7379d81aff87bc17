"""What the page draws, as arrays: the frame, the grid, the error map, the frame seen from above, error ellipses."""

import numpy as np
from numpy.typing import NDArray

from calib.picture import grid_lines
from vision.camera import Calibration

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
ABOVE = (480, 360)  # columns and rows of the view from above
ELLIPSE = 2.0  # standard deviations


def rgba(image: Image, alpha: Image | None = None) -> NDArray[np.uint32]:
    """Picture [height, width, 3], BGR -> [height, width] of packed RGBA, first row first.

    >>> hex(rgba(np.array([[[1, 2, 3]]], np.uint8))[0, 0])
    '0xff010203'
    """
    opaque = np.full(image.shape[:2], 255, np.uint8) if alpha is None else alpha
    return np.ascontiguousarray(np.dstack([image[..., ::-1], opaque])).view(np.uint32)[..., 0]


def grid_in_picture(calibration: Calibration, ground: Array) -> tuple[list[Array], list[Array]]:
    """Pixels u and v of the ground grid's lines over the area of places [n, 2], NaN where not visible."""
    width, height = calibration.image_size
    lines = [calibration.to_image(line) for line, _ in grid_lines(ground)]
    margin = max(width, height)
    off = [np.abs(line - (width / 2, height / 2)).max(axis=1, keepdims=True) for line in lines]
    near = [np.where(far < margin, line, np.nan) for line, far in zip(lines, off, strict=True)]
    return [line[:, 0] for line in near], [line[:, 1] for line in near]


def from_above(image: Image, calibration: Calibration, low: Array, high: Array) -> NDArray[np.uint32]:
    """Frame as seen from above [row, column], packed RGBA, x to the right and y down, transparent where unseen."""
    import cv2

    span = np.maximum(high - low, 1e-6)
    columns, rows = ABOVE
    x = low[0] + (np.arange(columns) + 0.5) * span[0] / columns
    y = low[1] + (np.arange(rows) + 0.5) * span[1] / rows
    pixels = calibration.to_image(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(rows, columns, 2)
    seen: NDArray[np.bool_] = np.asarray(((pixels >= 0) & (pixels <= calibration.image_size)).all(axis=2))
    place = np.where(seen[..., None], pixels - 0.5, -10).astype(np.float32)
    warped = cv2.remap(image, place[..., 0], place[..., 1], cv2.INTER_LINEAR)
    return rgba(np.asarray(warped, np.uint8), np.where(seen, 255, 0).astype(np.uint8))


def ellipses(calibration: Calibration, pixels: Array, sigma: Array) -> tuple[list[Array], list[Array]]:
    """Error ellipses, x and y, m, of the places of pixels [n, 2], at `ELLIPSE` standard deviations.

    They combine the errors of the calibration and of the pixels, sigma [n], px.
    """
    jacobian = calibration.jacobian(pixels) * sigma[:, None, None]
    covariance = calibration.position_covariance(pixels) + jacobian @ jacobian.transpose(0, 2, 1)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    values, vectors = np.linalg.eigh(covariance[known])
    angle = np.linspace(0, 2 * np.pi, 33)
    circle = ELLIPSE * np.stack([np.cos(angle), np.sin(angle)])
    outlines = calibration.to_ground(pixels)[known, :, None] + vectors @ (np.sqrt(values)[:, :, None] * circle)
    return list(outlines[:, 0]), list(outlines[:, 1])
