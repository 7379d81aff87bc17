"""Dense heads that give the distances to the four edges as distributions over bins: NanoDet, NanoDet-Plus, PicoDet."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from vision.detectors.images import BGR_IMAGENET, RGB_IMAGENET
from vision.detectors.layout import (
    Candidates,
    Graph,
    Layout,
    Outputs,
    Shapes,
    Size,
    are_shares,
    best_of,
    cell_count,
    cells,
    classes_along,
    in_bgr,
    pyramid_of,
)

BINS = 8  # of a distance: 0 to 7 cells, the `reg_max` of most published models
WIDTHS = (4 * BINS, 4 * 11)  # of four distances; 0 to 10 cells in NanoDet-g
STRIDES = (8, 16, 32, 64)


def decode_level(
    score: NDArray[np.floating],
    distance: NDArray[np.floating],
    center: NDArray[np.floating],
    stride: int,
    wanted: NDArray[np.intp],
    floor: float,
) -> Candidates:
    """One stride: class scores [n, classes], bins [n, 4 bins] and centers [n, 2] in cells.

    A distance, in cells, is the mean of the softmax over its bins (Li et al. 2020, Generalized Focal Loss, eq. 5).
    """
    rows, top, label = best_of(score, wanted, floor)
    logits = distance[rows].reshape(len(rows), 4, distance.shape[1] // 4)
    weight = np.exp(logits - logits.max(axis=2, keepdims=True))
    edges = (weight @ np.arange(weight.shape[2])) / weight.sum(axis=2)
    box = np.concatenate([center[rows] - edges[:, :2], center[rows] + edges[:, 2:]], axis=1) * stride
    return Candidates(box, top, label)


def joined(parts: list[Candidates]) -> Candidates:
    """Candidates of several strides as one."""
    return Candidates(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def decode_levels(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """For each stride class scores [1, n, classes] and distances [1, n, 4 bins], either kind first."""
    half = len(outputs) // 2
    first = _bins_first(outputs[0].shape[-1], outputs[-1].shape[-1])
    scores, distances = (outputs[half:], outputs[:half]) if first else (outputs[:half], outputs[half:])
    levels = zip(scores, distances, cells(size, STRIDES[:half]), STRIDES[:half], strict=True)
    return joined([decode_level(s[0], d[0], grid + 0.5, stride, wanted, floor) for s, d, grid, stride in levels])


def decode_nanodet_plus(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, n, classes + 4 bins], all strides one after another.

    Distances are from the cells' corners, not their centers (`get_single_level_center_priors` of NanoDet-Plus's head).
    """
    raw = outputs[0][0]
    grids = cells(size, pyramid_of(len(raw), size))
    ends = np.cumsum([len(grid) for grid in grids])[:-1]
    levels = zip(np.split(raw, ends), grids, STRIDES, strict=False)
    split = raw.shape[1] - 4 * BINS
    return joined([decode_level(r[:, :split], r[:, split:], grid, s, wanted, floor) for r, grid, s in levels])


def _bins_first(first: int, last: int) -> bool:
    """Whether outputs of these widths give distances before scores; where both may be distances, scores come first."""
    return next((last != width for width in WIDTHS if width in (first, last)), False)


def _has_levels(graph: Graph, levels: int) -> bool:
    shapes = graph.shapes
    if len(shapes) != 2 * levels or any(len(shape) != 3 for shape in shapes):
        return False
    counts = [len(grid) for grid in cells(graph.size, STRIDES[:levels])]
    widths = [{shape[2] for shape in part} for part in (shapes[:levels], shapes[levels:])]
    agree = [shape[1] for shape in shapes] == counts * 2 and all(len(width) == 1 for width in widths)
    return agree and any({width} in widths for width in WIDTHS)


def _is_nanodet_plus(graph: Graph) -> bool:
    table = graph.table()
    counts = [cell_count(graph.size, STRIDES), cell_count(graph.size)]
    if len(table) not in counts or table.shape[1] <= 4 * BINS:
        return False
    return are_shares(table[:, : -4 * BINS]) and not are_shares(table[:, -4 * BINS :])


def _level_classes(shapes: Shapes) -> int:
    half = len(shapes) // 2
    if not half or any(len(shape) != 3 for shape in shapes):
        raise ValueError("scores and distances must come as pairs [1, n, k]")
    return shapes[half][2] if _bins_first(shapes[0][2], shapes[half][2]) else shapes[0][2]


# PaddleDetection trains on RGB and stretches (ppdet's `Decode`, and deploy/third_engine/onnx/preprocess.py).
PICODET = Layout(
    "picodet",
    "class scores [1,n,classes] and distances [1,n,32] for each of four strides",
    partial(_has_levels, levels=4),
    decode_levels,
    classes=_level_classes,
    dense=True,
    fitting="stretch",
    normalization=RGB_IMAGENET,
)

DISTANCES = (
    Layout(
        "nanodet",
        "class scores [1,n,classes] and distances [1,n,32], or 44, for each of three strides",
        partial(_has_levels, levels=3),
        decode_levels,
        classes=_level_classes,
        dense=True,
        fill=0,
        normalization=BGR_IMAGENET,
    ),
    Layout(
        "nanodet-plus",
        "[1,n,classes+32]",
        _is_nanodet_plus,
        decode_nanodet_plus,
        classes=classes_along(2, others=4 * BINS),
        dense=True,
        fill=0,
        normalization=BGR_IMAGENET,
    ),
    PICODET,
    in_bgr(PICODET),
)
