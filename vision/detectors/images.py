"""Fit an image into the network's input, and map boxes back to the image."""

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Fitting = Literal["center", "corner", "stretch"]


@dataclass(frozen=True)
class Placement:
    """Where the image lies in the network's input: input px = image px * scale + offset, along (x, y)."""

    scale: tuple[float, float]
    offset: tuple[float, float]

    def to_image(self, boxes: NDArray[np.floating]) -> NDArray[np.float64]:
        """Boxes [n, 4] in px of the input -> px of the image."""
        scale, offset = np.tile(self.scale, 2), np.tile(self.offset, 2)
        return np.asarray((boxes - offset) / scale, np.float64)


@cache
def window_of(shape: tuple[int, int], size: tuple[int, int], fitting: Fitting) -> tuple[tuple[slice, slice], Placement]:
    """Where an image of a shape (height, width) goes in an input of `size` (width, height): rows, columns; placement.

    "center" and "corner" (top left) keep its proportions, "stretch" does not.

    >>> window_of((360, 640), (416, 416), "corner")[0]
    (slice(0, 234, None), slice(0, 416, None))
    """
    height, width = shape
    inner = size
    if fitting != "stretch":
        ratio = min(size[0] / width, size[1] / height)
        inner = (max(round(width * ratio), 1), max(round(height * ratio), 1))
    left, top = ((size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2) if fitting == "center" else (0, 0)
    window = (slice(top, top + inner[1]), slice(left, left + inner[0]))
    return window, Placement((inner[0] / width, inner[1] / height), (left, top))


def fit_image(
    image: NDArray[np.uint8], size: tuple[int, int], fitting: Fitting, fill: int
) -> tuple[NDArray[np.uint8], Placement]:
    """Lay an image [h, w, 3] into `size` (width, height), padding with `fill`; say where it went."""
    window, placement = window_of(image.shape[:2], size, fitting)
    canvas = np.full((size[1], size[0], 3), fill, np.uint8)
    shrink(image, canvas[window])
    return canvas, placement


def shrink(image: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """Scale an image [h, w, 3] into `out` [h', w', 3]."""
    import cv2

    if image.shape == out.shape:
        out[:] = image
    else:
        cv2.resize(image, out.shape[1::-1], dst=out)


@dataclass(frozen=True)
class Normalization:
    """Values of the network's input: (pixel - mean) / deviation, in `order`; mean and deviation in that order."""

    order: Literal["RGB", "BGR"]
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deviation: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def reversed(self) -> "Normalization":
        """The same with the colors in the other order.

        >>> RGB_IMAGENET.reversed == BGR_IMAGENET
        True
        """
        return Normalization("BGR" if self.order == "RGB" else "RGB", self.mean[::-1], self.deviation[::-1])

    @property
    def words(self) -> str:
        """In words.

        >>> RGB_UNIT.words, BGR_IMAGENET.words
        ('RGB from 0 to 1', "BGR less ImageNet's mean")
        """
        if any(self.mean):
            return f"{self.order} less ImageNet's mean"
        return f"{self.order} from 0 to {255 / self.deviation[0]:g}"

    def tensor(self, canvas: NDArray[np.uint8], dtype: type = np.float32, channels_last: bool = False) -> NDArray[Any]:
        """Image [h, w, 3] BGR, 0-255 -> [1, 3, h, w], or [1, h, w, 3].

        >>> red = np.array([[[0, 0, 255]]], np.uint8)
        >>> RGB_UNIT.tensor(red).ravel().tolist(), BGR_BYTES.tensor(red, np.uint8).ravel().tolist()
        ([1.0, 0.0, 0.0], [0, 0, 255])
        """
        height, width = canvas.shape[:2]
        out: NDArray[Any] = np.empty((1, height, width, 3) if channels_last else (1, 3, height, width), dtype)
        self.fill(canvas, out, channels_last)
        return out

    def fill(self, image: NDArray[np.uint8], out: NDArray[Any], channels_last: bool = False) -> None:
        """Write an image [h, w, 3] BGR into `out` [1, 3, h, w]; bytes stay unchanged: such a network normalizes.

        Allocating a tensor anew for every frame would cost more than filling it.
        """
        import cv2

        target = out[0].transpose(2, 0, 1) if channels_last else out[0]
        planes = cv2.split(image) if self.order == "BGR" else cv2.split(image)[::-1]
        for plane, mean, deviation, channel in zip(planes, self.mean, self.deviation, target, strict=True):
            if out.dtype == np.uint8 or (mean == 0 and deviation == 1):
                channel[:] = plane
                continue
            np.multiply(plane, np.float32(1 / deviation), out=channel, casting="same_kind")
            if mean:
                channel -= np.float32(mean / deviation)


RGB_UNIT = Normalization("RGB", deviation=(255.0, 255.0, 255.0))
RGB_BYTES = Normalization("RGB")
BGR_BYTES = Normalization("BGR")
RGB_IMAGENET = Normalization("RGB", mean=(123.675, 116.28, 103.53), deviation=(58.395, 57.12, 57.375))
BGR_IMAGENET = Normalization("BGR", mean=(103.53, 116.28, 123.675), deviation=(57.375, 57.12, 58.395))
