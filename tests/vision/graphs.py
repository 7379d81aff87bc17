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
) -> Path:
    """`size` is (width, height); what a gain multiplies is the mean of that channel of the input `image`."""
    shape = ["n", 3, "h", "w"] if dynamic else [1, 3, size[1], size[0]]
    inputs = [helper.make_tensor_value_info(image, element, shape), *extra_inputs]
    constants = {
        "channel": np.array([channel]),
        "axes": np.array([0, 1, 2, 3]),
        "one": np.array([], np.int64),
    }
    nodes = [
        helper.make_node("Gather", [image, "channel"], ["picked"], axis=1),
        helper.make_node("Cast", ["picked"], ["floats"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["floats", "axes"], ["mean_"], keepdims=0),
        helper.make_node("Reshape", ["mean_", "one"], ["mean"]),
    ]
    infos = []
    for name, values in outputs.items():
        integer = values.dtype == np.int64
        constants[f"{name}_base"] = values
        constants[f"{name}_gain"] = (gains or {}).get(name, np.zeros_like(values)).astype(np.float32)
        nodes += [
            helper.make_node("Mul", ["mean", f"{name}_gain"], [f"{name}_add"]),
            helper.make_node("Cast", [f"{name}_add"], [f"{name}_cast"], to=TensorProto.INT64 if integer else 1),
            helper.make_node("Add", [f"{name}_base", f"{name}_cast"], [name]),
        ]
        infos.append(helper.make_tensor_value_info(name, TensorProto.INT64 if integer else 1, values.shape))
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


def anchors(size):
    return sum((size[0] // s) * (size[1] // s) for s in (8, 16, 32))
