"""Graphs that list what they found, suppressed or end to end: YOLOv10 and 26, exports with NMS, PicoDet, SSD."""

import numpy as np
from numpy.typing import NDArray

from vision.detectors.images import RGB_BYTES, RGB_IMAGENET
from vision.detectors.layout import Candidates, Graph, Layout, Outputs, Size, in_bgr, listed
from vision.detectors.names import COCO_IDS
from vision.detectors.queries import holds_rows, in_shares


def decode_rows(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[1, m, 6]: left, top, right, bottom, px; score; class."""
    raw = outputs[0].reshape(-1, 6)
    return listed(raw[:, :4], raw[:, 4], raw[:, 5], wanted, floor)


def decode_paddle_rows(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """[m, 6]: class, -1 for none; score; left, top, right, bottom, px of the input at `scale_factor` 1."""
    raw = outputs[0].reshape(-1, 6)
    return listed(raw[:, 2:], raw[:, 1], raw[:, 0], wanted, floor)


def decode_ssd(outputs: Outputs, size: Size, wanted: NDArray[np.intp], floor: float) -> Candidates:
    """Boxes [1, m, 4]: top, left, bottom, right, in shares of the input; classes [1, m], from 1; scores [1, m]."""
    boxes, classes, scores = outputs
    box = boxes.reshape(-1, 4)[:, [1, 0, 3, 2]] * np.tile(np.array(size, float), 2)
    return listed(box, scores.reshape(-1), classes.reshape(-1) - 1, wanted, floor)


def _is_street(graph: Graph) -> bool:
    return set(graph.inputs) == {"frame", "background"} and graph.shapes[0][-1:] == (6,)


def _is_rows(graph: Graph) -> bool:
    return len(graph.inputs) == 1 and holds_rows(graph.table()) and not in_shares(graph)


def _is_paddle(graph: Graph) -> bool:
    return "scale_factor" in graph.inputs and graph.shapes[0][-1:] == (6,)


PICODET_ROWS = Layout(
    "picodet-nms",
    "image and scale_factor -> [m,6] class, score, left, top, right, bottom (PicoDet with postprocessing)",
    lambda graph: _is_paddle(graph) and "im_shape" not in graph.inputs,
    decode_paddle_rows,
    fitting="stretch",
    normalization=RGB_IMAGENET,
)

LISTS = (
    Layout("roadfiber-street", "frame and background [1,3,h,w] -> [1,m,6]", _is_street, decode_rows),
    Layout(
        "yolov10",
        "[1,m,6] left, top, right, bottom in px, score, class (YOLOv10, 26, exports with NMS)",
        _is_rows,
        decode_rows,
    ),
    PICODET_ROWS,
    in_bgr(PICODET_ROWS),
    Layout(
        "paddle-rows",
        "the same with im_shape, colors from 0 to 1 (RT-DETR by PaddleDetection; PP-YOLOE+ by --layout)",
        lambda graph: _is_paddle(graph) and "im_shape" in graph.inputs,
        decode_paddle_rows,
        fitting="stretch",
    ),
    # TensorFlow's detectors; they normalize and resize in the graph.
    Layout(
        "ssd",
        "detection_boxes [1,m,4] top, left, bottom, right in shares, detection_classes, detection_scores (SSD)",
        lambda graph: {"detection_boxes", "detection_classes", "detection_scores"} <= set(graph.outputs),
        decode_ssd,
        reads=("detection_boxes", "detection_classes", "detection_scores"),
        names=COCO_IDS[1:],
        fitting="stretch",
        normalization=RGB_BYTES,
    ),
)
