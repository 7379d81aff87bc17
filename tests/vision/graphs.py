"""Small ONNX graphs that answer like detectors: a constant plus a gain times the mean of one input channel."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


def write_graph(
    path: Path,
    outputs: dict[str, np.ndarray],
    *,
    size=(416, 416),
    gains: dict[str, np.ndarray] | None = None,
    channel: int = 0,
    image: str = "images",
    extra_inputs: tuple = (),
    metadata: dict[str, str] | None = None,
    element=TensorProto.FLOAT,
    dynamic: bool = False,
    channels_last: bool = False,
    batch: int = 1,
    half: bool = False,
) -> Path:
    """`size` is (width, height); what a gain multiplies is the mean of that channel of the input `image`.

    `half` makes the outputs half precision.
    """
    sides = ["h", "w"] if dynamic else [size[1], size[0]]
    shape = [*sides, 3] if channels_last else [3, *sides]
    inputs = [helper.make_tensor_value_info(image, element, ["n" if dynamic else batch, *shape]), *extra_inputs]
    constants = {
        "channel": np.array([channel]),
        "axes": np.array([0, 1, 2, 3]),
        "one": np.array([], np.int64),
    }
    nodes = [
        helper.make_node("Gather", [image, "channel"], ["picked"], axis=3 if channels_last else 1),
        helper.make_node("Cast", ["picked"], ["floats"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["floats", "axes"], ["mean_"], keepdims=0),
        helper.make_node("Reshape", ["mean_", "one"], ["mean"]),
    ]
    infos = []
    for name, values in outputs.items():
        kind = {np.dtype(np.int64): TensorProto.INT64}.get(values.dtype, TensorProto.FLOAT)
        last = TensorProto.FLOAT16 if half and kind == TensorProto.FLOAT else kind
        constants[f"{name}_base"] = values
        constants[f"{name}_gain"] = (gains or {}).get(name, np.zeros_like(values)).astype(np.float32)
        nodes += [
            helper.make_node("Mul", ["mean", f"{name}_gain"], [f"{name}_add"]),
            helper.make_node("Cast", [f"{name}_add"], [f"{name}_cast"], to=kind),
            helper.make_node("Add", [f"{name}_base", f"{name}_cast"], [f"{name}_sum"]),
            helper.make_node("Cast", [f"{name}_sum"], [name], to=last),
        ]
        infos.append(helper.make_tensor_value_info(name, last, values.shape))
    initializers = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "detector", inputs, infos, initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    for key, value in (metadata or {}).items():
        model.metadata_props.add(key=key, value=value)
    onnx.save(model, str(path))
    return path


def yolov8(count_of_classes=80, size=(416, 416)):
    """Empty answer [1, 4 + classes, n]; fill column j with cx, cy, w, h and a score."""
    return np.zeros((1, 4 + count_of_classes, anchors(size)), np.float32)


def anchors(size, strides=(8, 16, 32)):
    return sum(-(-size[0] // s) * -(-size[1] // s) for s in strides)


def center_size(box):
    """Left, top, right, bottom -> center x, center y, width, height."""
    return [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, box[2] - box[0], box[3] - box[1]]


def bins(distance: float, count: int = 8) -> np.ndarray:
    """Logits [count] of two neighboring bins whose softmax has this mean."""
    logits = np.full(count, -50.0)
    low = int(distance)
    logits[low : low + 2] = np.log([1 - (distance - low) + 1e-12, distance - low + 1e-12])
    return logits


def write_bright_spot_detector(path: Path, size=(640, 360), level=0.5) -> Path:
    """A real detector of one thing: the box around all pixels of channel 0 above a level, as a "car" [1, 1, 6]."""
    width, height = size
    far = 1e6
    constants = {
        "zero": np.array([0]),
        "level": np.array(level, np.float32),
        "one": np.array(1.0, np.float32),
        "far": np.array(far, np.float32),
        "columns": np.arange(width, dtype=np.float32),
        "rows": np.arange(height, dtype=np.float32),
        "over_rows": np.array([2]),
        "over_columns": np.array([3]),
        "all_axes": np.array([0, 1, 2]),
        "six": np.array([1, 1, 6]),
        "flat": np.array([1]),
        "car": np.array([2.0], np.float32),
    }
    nodes = [
        helper.make_node("Gather", ["images", "zero"], ["red"], axis=1),
        helper.make_node("Greater", ["red", "level"], ["bright"]),
        helper.make_node("Cast", ["bright"], ["mask"], to=1),
    ]
    for axis, over, places in (("x", "over_rows", "columns"), ("y", "over_columns", "rows")):
        nodes += [
            helper.make_node("ReduceMax", ["mask", over], [f"{axis}_any"], keepdims=0),
            helper.make_node("Sub", ["one", f"{axis}_any"], [f"{axis}_none"]),
            helper.make_node("Mul", [f"{axis}_none", "far"], [f"{axis}_away"]),
            helper.make_node("Add", [f"{axis}_away", places], [f"{axis}_low"]),
            helper.make_node("Sub", [places, f"{axis}_away"], [f"{axis}_high"]),
            helper.make_node("ReduceMin", [f"{axis}_low", "all_axes"], [f"{axis}_first"], keepdims=0),
            helper.make_node("ReduceMax", [f"{axis}_high", "all_axes"], [f"{axis}_last"], keepdims=0),
            helper.make_node("Add", [f"{axis}_last", "one"], [f"{axis}_end"]),
            helper.make_node("Reshape", [f"{axis}_first", "flat"], [f"{axis}1"]),
            helper.make_node("Reshape", [f"{axis}_end", "flat"], [f"{axis}2"]),
        ]
    nodes += [
        helper.make_node("ReduceMax", ["mask"], ["found"], keepdims=0),
        helper.make_node("Reshape", ["found", "flat"], ["score"]),
        helper.make_node("Concat", ["x1", "y1", "x2", "y2", "score", "car"], ["row"], axis=0),
        helper.make_node("Reshape", ["row", "six"], ["output0"]),
    ]
    graph = helper.make_graph(
        nodes,
        "bright",
        [helper.make_tensor_value_info("images", 1, [1, 3, height, width])],
        [helper.make_tensor_value_info("output0", 1, [1, 1, 6])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9), str(path))
    return path


def write_decoded_yolox(path: Path, model: Path, side: int) -> Path:
    """A real YOLOX whose grid is decoded in the graph, as `export_onnx.py --decode_in_inference` does."""
    graph_model = onnx.load(model)
    graph = graph_model.graph
    answer = graph.output[0]
    grids = [np.stack(np.meshgrid(*[np.arange(side // s)] * 2), -1).reshape(-1, 2) for s in (8, 16, 32)]
    strides = [np.full((len(grid), 1), s) for grid, s in zip(grids, (8, 16, 32), strict=True)]
    constants = {
        "grid": np.concatenate(grids).astype(np.float32)[None],
        "stride": np.concatenate(strides).astype(np.float32)[None],
    }
    parts = [2, 2, answer.type.tensor_type.shape.dim[2].dim_value - 4]  # an attribute: the model is of opset 11
    graph.initializer.extend(numpy_helper.from_array(value, name) for name, value in constants.items())
    graph.node.extend(
        [
            helper.make_node("Split", [answer.name], ["offset", "logarithm", "scores"], axis=2, split=parts),
            helper.make_node("Add", ["offset", "grid"], ["cell"]),
            helper.make_node("Mul", ["cell", "stride"], ["center"]),
            helper.make_node("Exp", ["logarithm"], ["cells"]),
            helper.make_node("Mul", ["cells", "stride"], ["size"]),
            helper.make_node("Concat", ["center", "size", "scores"], ["decoded"], axis=2),
        ]
    )
    answer.name = "decoded"
    onnx.save(graph_model, str(path))
    return path
