"""Edges of boxes: the sd of each, and which ones a nearer vehicle hides."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EDGE_BIAS = 1.0  # px, and
# Sizes of the box: sd of an edge error that is common to all frames of a vehicle, besides that of all edges together
# (`body_fit.GROWTH`). Three detectors: 0.033 to 0.049 against labels of two public clips, 0.031 to 0.045 on rendered
# streets.
SHAPE_BIAS = 0.04
USUAL_JITTER = 0.03  # sd of an edge, sizes of the box, for tracks too short to estimate it
FEWEST_FIXES = 5  # fixes of a track long enough to estimate it
COVERED = 0.5  # share of an edge behind another box that makes it hidden
MARGIN = 2.0  # px; a box nearer to the image's border than this may be cut by it


def hidden_edges(frame: NDArray[np.int64], boxes: Array) -> NDArray[np.bool_]:
    """Which edges of boxes [n, 4] are for the most part behind another box of their frame [n] -> [n, 4].

    Of two boxes the one whose lower edge is lower in the image is nearer.

    >>> boxes = np.array([[0.0, 0, 40, 30], [20.0, 5, 60, 50]])
    >>> hidden_edges(np.array([7, 7]), boxes).tolist()
    [[False, False, True, True], [False, False, False, False]]
    """
    hidden = np.zeros(boxes.shape, bool)
    order = np.argsort(frame, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(frame[order])) + 1):
        if len(rows) > 1:
            hidden[rows] = _covered(boxes[rows]) >= COVERED
    return hidden


def _covered(boxes: Array) -> Array:
    """Largest share of every edge [n, 4] that one nearer box covers."""
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    other_low, other_high = boxes[None, :, :2], boxes[None, :, 2:]
    nearer = boxes[None, :, 3] > boxes[:, None, 3]
    common = np.maximum(np.minimum(high, other_high) - np.maximum(low, other_low), 0.0)
    # Along an edge runs the other axis: top and bottom run along x.
    along = (common / np.maximum(high - low, 1e-9))[..., ::-1]
    inside = [(other_low < side) & (side < other_high) for side in (low, high)]
    shares = np.concatenate([np.where(within, along, 0.0) for within in inside], axis=2)
    return np.asarray((shares * nearer[..., None]).max(axis=1))


def edge_sigma(time: Array, boxes: Array, image_size: tuple[int, int]) -> Array:
    """Sd of every edge of a track's boxes [n, 4], px; infinite for edges at the image's border.

    Detector jitter goes with the size of the box. Its share is measured on the track: the median distance of every
    edge from the straight line, in time, between its neighbors (three fixes, so variances add to about 1.5).
    """
    size = sizes(boxes)
    share = USUAL_JITTER
    if len(time) >= FEWEST_FIXES:
        part = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
        bend = np.abs(boxes[1:-1] - (1 - part) * boxes[:-2] - part * boxes[2:]) / size[1:-1, None]
        share = 1.4826 * float(np.median(bend)) / np.sqrt(1.5)
    edge = np.sqrt((share**2 + SHAPE_BIAS**2) * size**2 + EDGE_BIAS**2)
    sigma = np.repeat(edge[:, None], 4, axis=1)
    low, high = boxes[:, :2] < MARGIN, boxes[:, 2:] > np.array(image_size) - MARGIN
    sigma[np.concatenate([low, high], axis=1)] = np.inf
    return sigma


def sizes(boxes: Array) -> Array:
    """Square root of the area of boxes [n, 4] -> [n], px."""
    return np.asarray(np.sqrt(np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 1.0)))
