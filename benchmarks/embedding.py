"""A small embedding that needs no training, as an ONNX graph: the histogram of a vehicle's colors."""

from itertools import product
from pathlib import Path

import numpy as np
from onnx import TensorProto, checker, helper, numpy_helper, save

from vision.appearance import DEVIATION, MEAN

SIDE = 48  # px of the image it takes
MIDDLE = (0.2, 0.8)  # share of either side that is looked at: around it is road
LEVELS = (0.05, 0.2, 0.4, 0.65, 0.95)  # of red, green and blue at the bins' centers
WIDTH = 0.15  # sd of a bin


def write_color_histogram(path: Path) -> Path:
    """Write the graph: image [n, 3, 48, 48], normalized as ImageNet's -> [n, 125], its mean taken off.

    Every pixel counts exp(-d^2 / (2 WIDTH^2)) in a bin at a distance d of colors; |x - c|^2 = |x|^2 - 2 c x + |c|^2 are
    two convolutions.
    """
    centers = np.array(list(product(LEVELS, repeat=3)))
    low, high = (round(SIDE * share) for share in MIDDLE)
    precision = 1 / (2 * WIDTH**2)
    constants = {
        "deviation": DEVIATION.reshape(1, 3, 1, 1),
        "mean": MEAN.reshape(1, 3, 1, 1),
        "begin": np.array([low, low]),
        "end": np.array([high, high]),
        "axes": np.array([2, 3]),
        "by_square": np.full((len(centers), 3, 1, 1), -precision),
        "by_color": 2 * precision * centers.reshape(-1, 3, 1, 1),
        "rest": -precision * (centers**2).sum(axis=1),
        "bins": np.array([1]),
    }
    steps = [
        ("Slice", ["image", "begin", "end", "axes"], "middle"),
        ("Mul", ["middle", "deviation"], "scaled"),
        ("Add", ["scaled", "mean"], "color"),
        ("Mul", ["color", "color"], "square"),
        ("Conv", ["square", "by_square", "rest"], "far"),
        ("Conv", ["color", "by_color"], "near"),
        ("Add", ["far", "near"], "likely"),
        ("Exp", ["likely"], "counts"),
        ("GlobalAveragePool", ["counts"], "pooled"),
        ("Flatten", ["pooled"], "histogram"),
        ("ReduceMean", ["histogram", "bins"], "usual"),
        ("Sub", ["histogram", "usual"], "vector"),
    ]
    graph = helper.make_graph(
        [helper.make_node(kind, inputs, [output]) for kind, inputs, output in steps],
        "color histogram",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["n", 3, SIDE, SIDE])],
        [helper.make_tensor_value_info("vector", TensorProto.FLOAT, ["n", len(centers)])],
        [
            numpy_helper.from_array(value.astype(np.int64 if value.dtype.kind == "i" else np.float32), name)
            for name, value in constants.items()
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)])
    model.ir_version = 8
    checker.check_model(model)
    save(model, path)
    return path
