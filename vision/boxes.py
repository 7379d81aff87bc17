"""Boxes as (left, top, right, bottom), px: overlap and suppression."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def overlap(a: Array, b: Array) -> Array:
    """Intersection over union of every box of a [n, 4] with every box of b [m, 4] -> [n, m], 0 to 1.

    >>> overlap(np.array([[0, 0, 2, 2.0]]), np.array([[1, 0, 3, 2.0], [5, 5, 6, 6.0]])).round(3).tolist()
    [[0.333, 0.0]]
    """
    (left, top, right, bottom), (left_b, top_b, right_b, bottom_b) = (
        np.ascontiguousarray(a.T),
        np.ascontiguousarray(b.T),
    )
    common = _shared(left, right, left_b, right_b)
    common *= _shared(top, bottom, top_b, bottom_b)
    union = area(a)[:, None] + area(b) - common
    return np.asarray(common / np.maximum(union, 1e-12))


def _shared(low: Array, high: Array, low_b: Array, high_b: Array) -> Array:
    """Length that every interval of a [n] shares with every one of b [m] -> [n, m]."""
    length = np.minimum(high[:, None], high_b)
    length -= np.maximum(low[:, None], low_b)
    return np.maximum(length, 0.0, out=length)


def area(boxes: Array) -> Array:
    """Area of boxes [n, 4] -> [n], px^2; 0 for inverted ones."""
    side = np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0)
    return np.asarray(side[:, 0] * side[:, 1])


def suppress(boxes: Array, scores: Array, limit: float = 0.5) -> NDArray[np.intp]:
    """Greedy non-maximum suppression, blind to class: rows to keep, best score first.

    A box goes if it overlaps a better one by more than `limit`. Scores are above 0; ties keep their order, so the
    answer is the same on every machine.

    >>> suppress(np.array([[0, 0, 10, 10], [1, 0, 11, 10], [30, 0, 40, 10.0]]), np.array([0.5, 0.9, 0.6])).tolist()
    [1, 2]
    """
    import cv2

    if not len(boxes):
        return np.zeros(0, np.intp)
    corner_and_size: Any = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)
    chances: Any = scores
    return np.asarray(cv2.dnn.NMSBoxes(corner_and_size, chances, 0.0, limit), np.intp).ravel()
