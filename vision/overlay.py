"""Tracks drawn over one picture: boxes, tails, ids, classes, speeds and fixes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Color = tuple[int, int, int]
# Okabe and Ito's colors, told apart with every kind of color vision; blue, green, red.
COLORS: tuple[Color, ...] = (
    *((0, 159, 230), (233, 180, 86), (115, 158, 0), (66, 228, 240)),
    *((178, 114, 0), (0, 94, 213), (167, 121, 204)),
)
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
BRIGHT = 120  # luminance of a background from which black text is readable on it
LIGHTER = 0.55  # share of white in the color of undetected boxes
DASH = 6.0  # lengths of a dash and of a gap, in lines' thicknesses
LETTERS = 22.0  # px of picture height per px of letter height
SMALLEST = 11.0  # px


@dataclass(frozen=True)
class Drawn:
    """A vehicle in one picture.

    Parameters
    ----------
    box : left, top, right, bottom, px
    words : id, class and, in meters, speed and place
    color : of its track
    detected : [n] of its tail's places, and last of this picture, whether it was detected there
    tail : [n, 2], px, where it stood until now, the oldest first
    fix : [axis, end, 2], px, two standard deviations of its place either way along x and along y; None in pixels
    """

    box: Array
    words: str
    color: Color
    detected: NDArray[np.bool_]
    tail: Array
    fix: Array | None = None


def draw(image: Image, vehicles: Sequence[Drawn]) -> Image:
    """Draw vehicles on a copy of a picture [height, width, 3], the nearest last.

    What was not detected but interpolated is dashed and lighter. Lines and words have a dark edge, and words a ground
    of their track's color, so that they can be read on every picture.
    """
    canvas = image.copy()
    letters = max(image.shape[0] / LETTERS / 1.6, SMALLEST)
    thickness = max(round(letters / 7), 1)
    nearest_last = sorted(vehicles, key=lambda one: float(one.box[3]))
    for one in nearest_last:
        draw_tail(canvas, one, thickness)
    for one in nearest_last:
        draw_box(canvas, one, thickness)
        draw_fix(canvas, one, thickness)
    taken: list[tuple[int, int, int, int]] = []
    for one in reversed(nearest_last):
        taken.append(draw_words(canvas, one, letters, taken))
    return canvas


def lighter(color: Color) -> Color:
    """Color mixed with white.

    >>> lighter((0, 100, 200))
    (140, 185, 230)
    """
    blue, green, red = (round(part + LIGHTER * (255 - part)) for part in color)
    return blue, green, red


def draw_tail(canvas: Image, one: Drawn, thickness: int) -> None:
    """Draw where a vehicle came from."""
    parts = [
        (part, one.color if seen else lighter(one.color))
        for part, seen in zip(pairwise(one.tail), one.detected[1:], strict=True)
    ]
    _edged(canvas, [(np.stack(part), color) for part, color in parts], thickness)


def draw_box(canvas: Image, one: Drawn, thickness: int) -> None:
    """Draw a box, dashed and lighter where it was not detected."""
    left, top, right, bottom = one.box
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
    if one.detected[-1]:
        _edged(canvas, [(corners, one.color)], thickness)
        return
    dashes = [dash for side in pairwise(corners) for dash in _dashes(*side, DASH * thickness)]
    _edged(canvas, [(dash, lighter(one.color)) for dash in dashes], thickness)


def draw_fix(canvas: Image, one: Drawn, thickness: int) -> None:
    """Ring the ground that a vehicle's place is, with a cross of its two standard deviations."""
    import cv2

    if one.fix is None:
        return
    middle, radius = one.tail[-1].round().astype(int).tolist(), 3 * thickness
    cv2.circle(canvas, middle, radius, BLACK, thickness + 2, cv2.LINE_AA)
    cv2.circle(canvas, middle, radius, WHITE, thickness, cv2.LINE_AA)
    _edged(canvas, [(arm, WHITE) for arm in one.fix], thickness)


def draw_words(
    canvas: Image, one: Drawn, letters: float, taken: Sequence[tuple[int, int, int, int]]
) -> tuple[int, int, int, int]:
    """Write words above a box, or higher where others are; return the place they take (left, top, right, bottom)."""
    import cv2

    height, width = canvas.shape[:2]
    scale, weight = cv2.getFontScaleFromHeight(cv2.FONT_HERSHEY_SIMPLEX, round(letters)), max(round(letters / 12), 1)
    (across, up), below = cv2.getTextSize(one.words, cv2.FONT_HERSHEY_SIMPLEX, scale, weight)
    pad = max(round(letters / 4), 2)
    across, tall = across + 2 * pad, up + below + pad
    left = int(np.clip(one.box[0], 0, max(width - across, 0)))
    top = int(np.clip(one.box[1] - tall, 0, max(height - tall, 0)))
    while clash := [spot for spot in taken if _overlap((left, top, left + across, top + tall), spot)]:
        higher = min(spot[1] for spot in clash) - tall - 1
        if higher < 0:
            break
        top = higher
    color = one.color if one.detected[-1] else lighter(one.color)
    cv2.rectangle(canvas, (left, top), (left + across, top + tall), BLACK, 2)
    cv2.rectangle(canvas, (left, top), (left + across, top + tall), color, -1)
    luminance = 0.114 * color[0] + 0.587 * color[1] + 0.299 * color[2]
    ink, place = BLACK if luminance > BRIGHT else WHITE, (left + pad, top + tall - below)
    cv2.putText(canvas, one.words, place, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, weight, cv2.LINE_AA)
    return left, top, left + across, top + tall


def _overlap(a: tuple[int, int, int, int], b: tuple[int, int, int, int]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _edged(canvas: Image, lines: Sequence[tuple[Array, Color]], thickness: int) -> None:
    """Draw lines through pixels [n, 2] with a dark edge, which lies below all of them."""
    import cv2

    whole = [(line.round().astype(np.int32), color) for line, color in lines]
    for line, _ in whole:
        cv2.polylines(canvas, [line], False, BLACK, thickness + 2, cv2.LINE_AA)
    for line, color in whole:
        cv2.polylines(canvas, [line], False, color, thickness, cv2.LINE_AA)


def _dashes(first: Array, last: Array, dash: float) -> list[Array]:
    """Dashes [2, 2] from one place to another, about as long as the gaps between them."""
    count = max(round(float(np.linalg.norm(last - first)) / (2 * dash)), 1)
    starts = np.arange(count) / count
    return [first + np.array([[at], [at + 0.5 / count]]) * (last - first) for at in starts]
