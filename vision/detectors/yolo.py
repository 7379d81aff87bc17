"""Dense heads that answer with one table: YOLOv5 to 9, 11, 12, and YOLOX."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from vision.detectors.images import BGR_BYTES
from vision.detectors.layout import (
    PYRAMIDS,
    Candidates,
    Graph,
    Layout,
    Outputs,
    Size,
    are_shares,
    around,
    best_of,
    cell_count,
    cell_table,
    classes_along,
    pyramid_of,
)

LARGEST_LOGARITHM = 16.0  # of a width in cells; no vehicle is e^16 cells wide, and decoded widths in px are larger


def decode_yolov5(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, n, 5 + classes]: center, size, px; objectness; class scores."""
    raw = outputs[0][0]
    rows, score, label = best_likely(raw, wanted, floor)
    return Candidates(around(raw[rows, :2], raw[rows, 2:4]), score, label)


def decode_yolox(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, n, 5 + classes]: center and log size in cells of each stride; objectness; class scores.

    Ge et al. 2021, YOLOX; `demo_postprocess` of its ONNX demo.
    """
    raw = outputs[0][0]
    rows, score, label = best_likely(raw, wanted, floor)
    corner, stride = cell_table(size, pyramid_of(len(raw), size))
    center = (raw[rows, :2] + corner[rows]) * stride[rows]
    return Candidates(around(center, np.exp(raw[rows, 2:4]) * stride[rows]), score, label)


def best_likely(
    raw: NDArray[np.floating], wanted: NDArray[np.intp], floor: float
) -> tuple[NDArray[np.intp], NDArray[np.floating], NDArray[np.intp]]:
    """`best_of` of rows [n, 5 + classes] whose classes' scores, at most one, still count times the objectness."""
    likely = np.flatnonzero(raw[:, 4] >= floor)
    scores = raw[np.ix_(likely, wanted + 5)] * raw[likely, 4:5]
    best, score, place = best_of(scores, np.arange(len(wanted)), floor)
    return likely[best], score, wanted[place]


def decode_yolov8(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, 4 + classes, n]: center, size, px; class scores."""
    raw = outputs[0][0].T
    rows, score, label = best_of(raw[:, 4:], wanted, floor)
    return Candidates(around(raw[rows, :2], raw[rows, 2:4]), score, label)


def _is_yolov5(graph: Graph) -> bool:
    table = graph.table()
    counts = [3 * cell_count(graph.size, strides) for strides in PYRAMIDS]
    return len(table) in counts and table.shape[1] > 5 and are_shares(table[:, 4:])


def _is_yolov8(graph: Graph) -> bool:
    table = graph.table()
    counts = [cell_count(graph.size, strides) for strides in PYRAMIDS]
    return table.shape[1] in counts and len(table) > 4 and are_shares(table[4:])


def _is_yolov6(graph: Graph) -> bool:
    """YOLOX's shape, but a head without objectness, which its exporter sets to exactly one everywhere."""
    table = graph.table()
    return _is_table_of_cells(graph) and bool((table[:, 4] == 1).all())


def _is_yolox(graph: Graph, decoded: bool) -> bool:
    if not _is_table_of_cells(graph) or _is_yolov6(graph):
        return False
    return bool(graph.table()[:, 2:4].max() > LARGEST_LOGARITHM) == decoded


def _is_table_of_cells(graph: Graph) -> bool:
    table = graph.table()
    counts = [cell_count(graph.size, strides) for strides in PYRAMIDS]
    return len(table) in counts[:2] and table.shape[1] > 5 and are_shares(table[:, 4:])


YOLO = (
    Layout(
        "yolov5",
        "[1,3n,5+classes] (YOLOv5, 7)",
        _is_yolov5,
        decode_yolov5,
        classes=classes_along(2, others=5),
        dense=True,
    ),
    Layout(
        "yolov6",
        "[1,n,5+classes] in px, objectness 1 (YOLOv6)",
        _is_yolov6,
        decode_yolov5,
        classes=classes_along(2, others=5),
        dense=True,
    ),
    Layout(
        "yolov8",
        "[1,4+classes,n] (YOLOv8, 9, 11, 12)",
        _is_yolov8,
        decode_yolov8,
        classes=classes_along(1, others=4),
        dense=True,
    ),
    Layout(
        "yolox",
        "[1,n,5+classes] in cells",
        partial(_is_yolox, decoded=False),
        decode_yolox,
        classes=classes_along(2, others=5),
        dense=True,
        fitting="corner",
        normalization=BGR_BYTES,
    ),
    Layout(
        "yolox-decoded",
        "[1,n,5+classes] in px",
        partial(_is_yolox, decoded=True),
        decode_yolov5,
        classes=classes_along(2, others=5),
        dense=True,
        fitting="corner",
        normalization=BGR_BYTES,
    ),
)
