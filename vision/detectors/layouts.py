"""The layouts detectors are exported in: how to know one, feed it and read its answer.

Every decoder takes the graph's outputs, the input size (width, height) and the classes to look for, and returns boxes
in px of the input. Dense heads are read for the wanted classes only: the best of them, wherever another class wins,
is still evidence for a vehicle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.detectors.images import BGR_BYTES, BGR_IMAGENET, RGB_UNIT, Fitting, Normalization

Outputs = Sequence[NDArray[np.float32]]
Shapes = Sequence[tuple[int, ...]]


class Candidates(NamedTuple):
    """Boxes [n, 4], px of the input; scores [n]; class places [n]."""

    box: NDArray[np.floating]
    score: NDArray[np.floating]
    label: NDArray[np.intp]


class Signature(NamedTuple):
    """What a graph shows of itself: input names, output names and the shapes a dry run gave, input size (w, h)."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]
    size: tuple[int, int]


@dataclass(frozen=True)
class Layout:
    """One way detectors are exported.

    Parameters
    ----------
    name : as `--layout` takes it
    graph : what the graph looks like, for people
    matches : whether a signature is of this layout
    classes : number of classes, from the output shapes; None where they do not show it
    decode : outputs -> Candidates, those at or above a score floor
    fitting, fill, normalization : what the input is made of
    threshold : score above which its detections are believable on their own
    """

    name: str
    graph: str
    matches: Callable[[Signature], bool]
    classes: Callable[[Shapes], int | None]
    decode: Callable[[Outputs, tuple[int, int], NDArray[np.intp], float], Candidates]
    fitting: Fitting = "center"
    fill: int = 114
    normalization: Normalization = RGB_UNIT
    threshold: float = 0.4


@cache
def cells(size: tuple[int, int], strides: tuple[int, ...] = (8, 16, 32)) -> list[NDArray[np.float64]]:
    """Top left corner (x, y) of the grid cells of each stride, row by row, in cells: one [n, 2] for each stride."""
    grids = []
    for stride in strides:
        columns, rows = -(-size[0] // stride), -(-size[1] // stride)
        grids.append(np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2).astype(float))
    return grids


def best_of(
    scores: NDArray[np.floating], wanted: NDArray[np.intp], floor: float
) -> tuple[NDArray[np.intp], NDArray[np.floating], NDArray[np.intp]]:
    """Rows of scores [n, classes] whose best wanted class reaches the floor, that score, and that class."""
    scores = scores[:, wanted]
    best = scores.argmax(axis=1)
    top = scores[np.arange(len(scores)), best]
    rows = np.flatnonzero(top >= floor)
    return rows, top[rows], wanted[best[rows]]


def around(center: NDArray[np.floating], size: NDArray[np.floating]) -> NDArray[np.floating]:
    """Centers and sizes [n, 2] -> boxes [n, 4]."""
    return np.concatenate([center - size / 2, center + size / 2], axis=1)


def decode_yolox(outputs: Outputs, size: tuple[int, int], wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, n, 5 + classes]: center and log size in cells of strides 8, 16, 32; objectness; class scores.

    Exports that decode the grid themselves hold sizes in px there, far beyond any logarithm of cells.
    """
    raw = outputs[0][0]
    likely = np.flatnonzero(raw[:, 4] >= floor)  # scores of classes are at most one
    best, score, label = best_of(raw[likely, 5:] * raw[likely, 4:5], wanted, floor)
    rows = likely[best]
    if raw[:, 2:4].max() > 16:
        return Candidates(around(raw[rows, :2], raw[rows, 2:4]), score, label)
    grids = cells(size)
    stride = np.concatenate([np.full(len(g), s) for g, s in zip(grids, (8, 16, 32), strict=True)])[rows, None]
    center = (raw[rows, :2] + np.concatenate(grids)[rows]) * stride
    return Candidates(around(center, np.exp(raw[rows, 2:4]) * stride), score, label)


def decode_nanodet(outputs: Outputs, size: tuple[int, int], wanted: NDArray[np.intp], floor: float) -> Candidates:
    """Per stride, class scores [1, n, classes] and distances [1, n, 4 bins] to the four edges.

    A distance, in cells, is the mean of the softmax over its bins (Li et al. 2020, Generalized Focal Loss, eq. 5).
    """
    bins_first = outputs[0].shape[-1] == 32 and outputs[-1].shape[-1] != 32
    half = len(outputs) // 2
    scores, distances = (outputs[half:], outputs[:half]) if bins_first else (outputs[:half], outputs[half:])
    strides = (8, 16, 32, 64)[:half]
    parts = []
    for score, distance, grid, stride in zip(scores, distances, cells(size, strides), strides, strict=True):
        rows, top, label = best_of(score[0], wanted, floor)
        logits = distance[0, rows].reshape(len(rows), 4, distance.shape[2] // 4)
        weight = np.exp(logits - logits.max(axis=2, keepdims=True))
        edges = (weight @ np.arange(weight.shape[2])) / weight.sum(axis=2)
        center = grid[rows] + 0.5
        box = np.concatenate([center - edges[:, :2], center + edges[:, 2:]], axis=1) * stride
        parts.append((box, top, label))
    return Candidates(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def decode_yolov8(outputs: Outputs, size: tuple[int, int], wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, 4 + classes, n]: center, size, px; class scores."""
    raw = outputs[0][0].T
    rows, score, label = best_of(raw[:, 4:], wanted, floor)
    return Candidates(around(raw[rows, :2], raw[rows, 2:4]), score, label)


def decode_end_to_end(outputs: Outputs, size: tuple[int, int], wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, m, 6]: left, top, right, bottom, px; score; class."""
    raw = outputs[0].reshape(-1, 6)
    label = raw[:, 5].round().astype(np.intp)
    rows = np.flatnonzero((raw[:, 4] >= floor) & np.isin(label, wanted))
    return Candidates(raw[rows, :4], raw[rows, 4], label[rows])


def decode_deim(outputs: Outputs, size: tuple[int, int], wanted: NDArray[np.intp], floor: float) -> Candidates:
    """Labels [1, m], boxes [1, m, 4] in px of `orig_target_sizes`, scores [1, m]."""
    labels, boxes, scores = (np.asarray(part) for part in outputs)
    label, score = labels.reshape(-1).astype(np.intp), scores.reshape(-1)
    rows = np.flatnonzero((score >= floor) & np.isin(label, wanted))
    return Candidates(boxes.reshape(-1, 4)[rows], score[rows], label[rows])


def _dense_count(size: tuple[int, int]) -> int:
    return sum(len(grid) for grid in cells(size))


def _is_yolox(graph: Signature) -> bool:
    (shape, *others) = graph.shapes
    return not others and len(shape) == 3 and shape[1] == _dense_count(graph.size) and shape[2] > 5


def _is_yolov8(graph: Signature) -> bool:
    (shape, *others) = graph.shapes
    return not others and len(shape) == 3 and shape[2] == _dense_count(graph.size) and shape[1] > 4


def _is_end_to_end(graph: Signature) -> bool:
    (shape, *others) = graph.shapes
    return not others and len(graph.inputs) == 1 and len(shape) == 3 and shape[2] == 6 and shape[1] <= 1000


def _is_nanodet(graph: Signature) -> bool:
    half = len(graph.shapes) // 2
    if len(graph.shapes) not in (6, 8) or any(len(shape) != 3 for shape in graph.shapes):
        return False
    counts = [len(grid) for grid in cells(graph.size, (8, 16, 32, 64)[:half])]
    widths = [{shape[2] for shape in part} for part in (graph.shapes[:half], graph.shapes[half:])]
    agree = [shape[1] for shape in graph.shapes] == counts * 2 and all(len(width) == 1 for width in widths)
    return agree and {32} in widths


def _is_deim(graph: Signature) -> bool:
    return "orig_target_sizes" in graph.inputs and graph.outputs == ("labels", "boxes", "scores")


def _is_street(graph: Signature) -> bool:
    return set(graph.inputs) == {"frame", "background"} and graph.shapes[0][-1] == 6


def _nanodet_classes(shapes: Shapes) -> int:
    half = len(shapes) // 2
    return shapes[half][2] if shapes[0][2] == 32 else shapes[0][2]


LAYOUTS = (
    Layout(
        "roadfiber-street",
        "frame and background [1,3,h,w] -> [1,m,6]",
        _is_street,
        lambda shapes: None,
        decode_end_to_end,
    ),
    Layout(
        "deim",
        "images and orig_target_sizes -> labels, boxes, scores (RT-DETR, D-FINE, DEIM)",
        _is_deim,
        lambda shapes: None,
        decode_deim,
        fitting="stretch",
    ),
    Layout(
        "nanodet",
        "class scores [1,n,classes] and distances [1,n,32] for each stride",
        _is_nanodet,
        _nanodet_classes,
        decode_nanodet,
        fill=0,
        normalization=BGR_IMAGENET,
    ),
    Layout(
        "yolox",
        "[1,n,5+classes] (raw or decoded grid)",
        _is_yolox,
        lambda shapes: shapes[0][2] - 5,
        decode_yolox,
        fitting="corner",
        normalization=BGR_BYTES,
    ),
    Layout(
        "yolov8",
        "[1,4+classes,n] (YOLOv8, 9, 11, 12)",
        _is_yolov8,
        lambda shapes: shapes[0][1] - 4,
        decode_yolov8,
    ),
    Layout(
        "yolov10",
        "[1,m,6] end to end (YOLOv10, 26)",
        _is_end_to_end,
        lambda shapes: None,
        decode_end_to_end,
    ),
)
