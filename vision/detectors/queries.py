"""Transformer detectors, which answer for a few hundred queries: RT-DETR, D-FINE, DEIM, RF-DETR."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.detectors.images import RGB_IMAGENET
from vision.detectors.layout import (
    Candidates,
    Graph,
    Layout,
    Outputs,
    Size,
    are_shares,
    around,
    best_of,
    classes_along,
    is_dense,
    listed,
)
from vision.detectors.names import COCO_IDS

MOST_QUERIES = 1000


def from_shares(box: NDArray[np.floating], size: Size) -> NDArray[np.floating]:
    """Center and size [n, 4] in shares of the input -> boxes in px."""
    scale = np.array(size, float)
    return around(box[:, :2] * scale, box[:, 2:4] * scale)


def decode_rtdetr(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, m, 4 + classes]: center, size, in shares of the input; class scores."""
    raw = outputs[0][0]
    rows, score, label = best_of(raw[:, 4:], wanted, floor)
    return Candidates(from_shares(raw[rows, :4], size), score, label)


def decode_rtdetr_rows(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, m, 6]: center, size, in shares of the input; score; class."""
    raw = outputs[0].reshape(-1, 6)
    return listed(from_shares(raw[:, :4], size), raw[:, 4], raw[:, 5], wanted, floor)


def decode_deim(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """Labels [1, m], boxes [1, m, 4] in px of `orig_target_sizes`, scores [1, m]; the batch axis may be missing."""
    labels, boxes, scores = outputs
    return listed(boxes.reshape(-1, 4), scores.reshape(-1), labels.reshape(-1), wanted, floor)


def decode_logits(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """Boxes [1, m, 4]: center, size, in shares of the input; logits [1, m, classes], each class by itself."""
    boxes, logits = (part.reshape(-1, part.shape[-1]) for part in outputs)
    scores = 1 / (1 + np.exp(-np.clip(logits, -80, 80)))
    rows, score, label = best_of(scores, wanted, floor)
    return Candidates(from_shares(boxes[rows], size), score, label)


def holds_rows(table: NDArray[np.floating]) -> bool:
    """Whether [m, 6] holds a score and a class number in each row."""
    if table.shape[1] != 6 or len(table) > MOST_QUERIES:
        return False
    return are_shares(table[:, 4]) and bool((np.rint(table[:, 5]) == table[:, 5]).all())


def in_shares(graph: Graph) -> bool:
    """Whether the boxes [m, 4+] of the one output are in shares of the input, not px; the exporter may say so."""
    if graph.metadata.get("head") == "RTDETRDecoder":
        return True
    box = np.abs(graph.table()[:, :4])
    return bool(box.size and 0 < box.max() <= 2)


def _is_rtdetr(graph: Graph) -> bool:
    table = graph.table()
    if not 0 < len(table) <= MOST_QUERIES or table.shape[1] < 5 or is_dense(len(table), graph.size):
        return False
    return in_shares(graph) and are_shares(table[:, 4:]) and not holds_rows(table)


def _is_deim(graph: Graph) -> bool:
    return "orig_target_sizes" in graph.inputs and {"labels", "boxes", "scores"} <= set(graph.outputs)


def _has_logits(graph: Graph, boxes: str, logits: str) -> bool:
    shapes = dict(zip(graph.outputs, graph.shapes, strict=True))
    return shapes.get(boxes, ())[-1:] == (4,) and len(shapes.get(logits, ())) == 3


DEIM = Layout(
    "deim",
    "images and orig_target_sizes -> labels, boxes, scores (RT-DETR, D-FINE, DEIM)",
    _is_deim,
    decode_deim,
    reads=("labels", "boxes", "scores"),
    fitting="stretch",
)

QUERIES = (
    Layout(
        "rtdetr",
        "[1,m,4+classes] in shares (RT-DETR by Ultralytics)",
        _is_rtdetr,
        decode_rtdetr,
        classes=classes_along(2, others=4),
        fitting="stretch",
    ),
    Layout(
        "rtdetr-rows",
        "[1,m,6] center, size in shares, score, class (RT-DETR by Ultralytics since May 2026)",
        lambda graph: len(graph.inputs) == 1 and holds_rows(graph.table()) and in_shares(graph),
        decode_rtdetr_rows,
        fitting="stretch",
    ),
    DEIM,
    # The same graph with a DINOv3 backbone wants ImageNet's colors, which it does not show.
    replace(
        DEIM,
        name="deim-imagenet",
        graph="as deim, for backbones trained on ImageNet's mean and deviation; by --layout only",
        matches=lambda graph: False,
        normalization=RGB_IMAGENET,
    ),
    # Class numbers are COCO's ids, from 0; the last column says "nothing" (export/_onnx/inference.py of RF-DETR).
    Layout(
        "rf-detr",
        "dets [1,m,4] in shares, labels [1,m,classes+1] logits (RF-DETR)",
        lambda graph: _has_logits(graph, "dets", "labels"),
        decode_logits,
        classes=classes_along(2, others=1, output=1),
        reads=("dets", "labels"),
        names=COCO_IDS[:90],
        fitting="stretch",
        normalization=RGB_IMAGENET,
    ),
    Layout(
        "detr-logits",
        "pred_boxes [1,m,4] in shares, logits [1,m,classes] (RT-DETR, D-FINE by Hugging Face)",
        lambda graph: _has_logits(graph, "pred_boxes", "logits"),
        decode_logits,
        classes=classes_along(2, others=0, output=1),
        reads=("pred_boxes", "logits"),
        fitting="stretch",
    ),
)
