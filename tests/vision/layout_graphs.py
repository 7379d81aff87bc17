"""A synthetic graph of every layout that answers alike: a bus scored 0.8 in BOX, and a surer person elsewhere."""

import numpy as np
from onnx import TensorProto, helper

from tests.vision.graphs import anchors, bins, center_size, write_graph, yolov8
from vision.detectors.names import COCO

BUS, PERSON = COCO.index("bus"), COCO.index("person")
BUS_ID, PERSON_ID = 6, 1  # as COCO numbers them
SIDE = 416
SIZE = np.array([SIDE, SIDE] * 2)
IMAGE = np.full((312, 624, 3), 90, np.uint8)  # 2/3 fits it into 416 x 208; centered, 104 px from the top
BOX = np.array([150.0, 60, 270, 150])
CENTERED = BOX * 2 / 3 + np.array([0, 104, 0, 104])
CORNERED = BOX * 2 / 3
STRETCHED = BOX * np.array([SIDE / 624, SIDE / 312] * 2)


def side_input(name, kind=TensorProto.FLOAT):
    return helper.make_tensor_value_info(name, kind, ["n", 2])


def yolov5(path, **more):
    answer = np.zeros((1, 3 * anchors((SIDE, SIDE)), 85), np.float32)
    answer[0, 7, :5], answer[0, 7, 5 + BUS] = [*center_size(CENTERED), 1.0], 0.8
    answer[0, 9, :5], answer[0, 9, 5 + PERSON] = [*center_size(CENTERED + 150), 1.0], 0.9
    return write_graph(path, {"output0": answer}, **more)


def yolov6(path, **more):
    answer = np.zeros((1, anchors((SIDE, SIDE)), 85), np.float32)
    answer[0, :, 4] = 1
    answer[0, 7, :4], answer[0, 7, 5 + BUS] = center_size(CENTERED), 0.8
    answer[0, 9, :4], answer[0, 9, 5 + PERSON] = center_size(CENTERED + 150), 0.9
    return write_graph(path, {"outputs": answer}, **more)


def yolov8_graph(path, **more):
    answer = yolov8()
    answer[0, :4, 7], answer[0, 4 + BUS, 7] = center_size(CENTERED), 0.8
    answer[0, :4, 9], answer[0, 4 + PERSON, 9] = center_size(CENTERED + 150), 0.9
    return write_graph(path, {"output0": answer}, **more)


def yolov10(path, **more):
    answer = np.zeros((1, 300, 6), np.float32)
    answer[0, 0] = [*CENTERED, 0.8, BUS]
    answer[0, 1] = [*(CENTERED + 150), 0.9, PERSON]
    return write_graph(path, {"output0": answer}, **more)


def yolox_answer():
    answer = np.zeros((1, anchors((SIDE, SIDE)), 85), np.float32)
    grid, stride, column, row = SIDE // 16, 16, 9, 4
    cell = (SIDE // 8) ** 2 + row * grid + column
    cx, cy, w, h = center_size(CORNERED)
    answer[0, cell, :5] = [cx / stride - column, cy / stride - row, np.log(w / stride), np.log(h / stride), 1.0]
    answer[0, cell, 5 + BUS] = 0.8
    return answer


def yolox(path, **more):
    return write_graph(path, {"output": yolox_answer()}, **more)


def yolox_decoded(path, **more):
    answer = np.zeros((1, anchors((SIDE, SIDE)), 85), np.float32)
    answer[0, 5, :5], answer[0, 5, 5 + BUS] = [*center_size(CORNERED), 1.0], 0.8
    return write_graph(path, {"output": answer}, **more)


def rtdetr(path, **more):
    answer = np.zeros((1, 300, 84), np.float32)
    for row, (box, label, score) in enumerate([(STRETCHED, BUS, 0.8), (STRETCHED + 150, PERSON, 0.9)]):
        answer[0, row, :4], answer[0, row, 4 + label] = center_size(box / SIDE), score
    return write_graph(path, {"output0": answer}, **more)


def rtdetr_rows(path, **more):
    answer = np.zeros((1, 300, 6), np.float32)
    answer[0, 0] = [*center_size(STRETCHED / SIDE), 0.8, BUS]
    answer[0, 1] = [*center_size((STRETCHED + 150) / SIDE), 0.9, PERSON]
    return write_graph(path, {"output0": answer}, **more)


def deim_answer():
    return {
        "labels": np.array([[BUS, PERSON]]),
        "boxes": np.array([[STRETCHED, STRETCHED + 150]], np.float32),
        "scores": np.array([[0.8, 0.9]], np.float32),
    }


def deim(path, **more):
    return write_graph(path, deim_answer(), extra_inputs=(side_input("orig_target_sizes", TensorProto.INT64),), **more)


def logits(columns, answers):
    """Sure of nothing but each (class, score) of `answers`, row by row."""
    values = np.full((1, 300, columns), -12.0)
    for row, (label, score) in enumerate(answers):
        values[0, row, label] = np.log(score / (1 - score))
    return values.astype(np.float32)


def share_boxes():
    boxes = np.full((1, 300, 4), 0.5, np.float32)
    boxes[0, 0], boxes[0, 1] = center_size(STRETCHED / SIDE), center_size((STRETCHED + 150) / SIDE)
    return boxes


def rf_detr(path, **more):
    labels = logits(91, [(BUS_ID, 0.8), (PERSON_ID, 0.9)])
    return write_graph(path, {"dets": share_boxes(), "labels": labels}, image="input", **more)


def detr_logits(path, **more):
    answer = {"logits": logits(80, [(BUS, 0.8), (PERSON, 0.9)]), "pred_boxes": share_boxes()}
    return write_graph(path, answer, image="pixel_values", **more)


def levels(strides, box, offset, swapped=False, count=8):
    """Per stride class scores and distance bins; the bus sits in the cell under its center at stride 32."""
    classes = {s: np.zeros((1, anchors((SIDE, SIDE), (s,)), 80), np.float32) for s in strides}
    distances = {s: np.zeros((1, anchors((SIDE, SIDE), (s,)), 4 * count), np.float32) for s in strides}
    column, row = (np.array(center_size(box)[:2]) // 32).astype(int)
    cell = row * (SIDE // 32) + column
    center = (np.array([column, row]) + offset) * 32
    edges = np.concatenate([center - box[:2], box[2:] - center]) / 32
    classes[32][0, cell, BUS] = 0.8
    distances[32][0, cell] = np.concatenate([bins(edge, count) for edge in edges])
    named = [(f"class_{s}", classes[s]) for s in strides], [(f"distance_{s}", distances[s]) for s in strides]
    return dict(named[1] + named[0]) if swapped else dict(named[0] + named[1])


def nanodet(path, **more):
    return write_graph(path, levels((8, 16, 32), CENTERED, 0.5), **more)


def nanodet_g(path, swapped=False, **more):
    return write_graph(path, levels((8, 16, 32), CENTERED, 0.5, swapped, count=11), **more)


def nanodet_swapped(path, **more):
    return write_graph(path, levels((8, 16, 32), CENTERED, 0.5, swapped=True), **more)


def nanodet_plus(path, strides=(8, 16, 32, 64), **more):
    parts = levels(strides, CENTERED, 0.0)
    rows = [np.concatenate([parts[f"class_{s}"], parts[f"distance_{s}"]], axis=2) for s in strides]
    return write_graph(path, {"output": np.concatenate(rows, axis=1)}, image="data", **more)


def picodet(path, **more):
    return write_graph(path, levels((8, 16, 32, 64), STRETCHED, 0.5), image="image", **more)


def paddle_rows(path, extra=("im_shape", "scale_factor"), **more):
    answer = np.full((3, 6), -1, np.float32)
    answer[0], answer[1] = [PERSON, 0.9, *(STRETCHED + 150)], [BUS, 0.8, *STRETCHED]
    outputs = {"multiclass_nms3_0.tmp_0": answer, "multiclass_nms3_0.tmp_2": np.array([2])}
    return write_graph(path, outputs, image="image", extra_inputs=tuple(map(side_input, extra)), **more)


def picodet_nms(path, **more):
    return paddle_rows(path, extra=("scale_factor",), **more)


def ssd(path, **more):
    boxes = np.array([STRETCHED, STRETCHED + 150]) / SIDE
    outputs = {
        "detection_boxes:0": boxes[None][:, :, [1, 0, 3, 2]].astype(np.float32),
        "detection_classes:0": np.array([[BUS_ID, PERSON_ID]], np.float32),
        "detection_scores:0": np.array([[0.8, 0.9]], np.float32),
        "num_detections:0": np.array([2], np.float32),
    }
    usual = {"element": TensorProto.UINT8, "channels_last": True, "image": "image_tensor:0"}
    return write_graph(path, outputs, **{**usual, **more})


def street(path, **more):
    answer = np.zeros((1, 100, 6), np.float32)
    answer[0, 0] = [*CENTERED, 0.8, 1]
    background = helper.make_tensor_value_info("background", TensorProto.FLOAT, [1, 3, SIDE, SIDE])
    metadata = {"layout": "roadfiber-street", "names": "{0: 'car', 1: 'bus'}", "threshold": "0.35"}
    return write_graph(
        path, {"detections": answer}, image="frame", extra_inputs=(background,), metadata=metadata, **more
    )


GRAPHS = {
    "yolov5": yolov5,
    "yolov6": yolov6,
    "yolov8": yolov8_graph,
    "yolov10": yolov10,
    "yolox": yolox,
    "yolox-decoded": yolox_decoded,
    "rtdetr": rtdetr,
    "rtdetr-rows": rtdetr_rows,
    "deim": deim,
    "rf-detr": rf_detr,
    "detr-logits": detr_logits,
    "nanodet": nanodet,
    "nanodet-plus": nanodet_plus,
    "picodet": picodet,
    "picodet-nms": picodet_nms,
    "paddle-rows": paddle_rows,
    "ssd": ssd,
    "roadfiber-street": street,
}
