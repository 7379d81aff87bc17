"""The detector that comes along for real streets: its file, and its conversion from TensorFlow.js."""

import base64

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from torch.nn import functional

from vision.detectors import load_detector
from vision.nanodet import MODEL
from vision.nanodet.convert import Translation, stored_weights

VALID = {"s": base64.b64encode(b"VALID").decode()}
CHANNELS_LAST, CHANNELS_FIRST = [0, 2, 3, 1], [0, 3, 1, 2]


def ints(*numbers):
    return {"list": {"i": [str(number) for number in numbers]}}


@pytest.fixture(scope="module")
def kernels():
    """Multiples of 1/128 up to 127/128 in every output channel, which eight bits hold exactly."""
    rng = np.random.default_rng(0)
    codes = [rng.integers(-127, 128, shape) for shape in ((3, 3, 3, 4), (3, 3, 4, 6))]
    for code in codes:
        code[0, 0, 0] = 127
    return [(code / 128).astype(np.float16) for code in codes]


@pytest.fixture(scope="module")
def document(kernels):
    """A graph of all that NanoDet-g is made of, for 8 x 8 px, and its weights, as TensorFlow.js keeps it."""
    constants = {
        "pads": np.array([[0, 0], [0, 0], [1, 1], [1, 1]], np.int32),
        "last": np.array(CHANNELS_LAST, np.int32),
        "first": np.array(CHANNELS_FIRST, np.int32),
        "k0": kernels[0],
        "b0": np.array([0.5, -0.5, 0.1, 0], np.float16),
        "k1": kernels[1],
        "b1": np.zeros(6, np.float16),
        "eight": np.array([8, 8], np.int32),
        "least": np.array(-np.inf, np.float16),
        "axis": np.array(1, np.int32),
        "parts": np.array([2, 4], np.int32),
        "any": np.array([0, 0, 0], np.int32),
        "swap": np.array([0, 2, 1], np.int32),
    }
    conv = {"padding": VALID, "strides": ints(1, 2, 2, 1)}
    pool = {"ksize": ints(1, 3, 3, 1), "strides": ints(1, 2, 2, 1), "padding": VALID}
    sides = [{"size": str(side)} for side in (1, 3, 8, 8)]
    nodes = [
        ("x", "Placeholder", [], {"shape": {"shape": {"dim": sides}}}),
        ("p0", "Pad", ["x", "pads"], {}),
        ("t0", "Transpose", ["p0", "last"], {}),
        ("c0", "Conv2D", ["t0", "k0"], conv),
        ("a0", "Add", ["c0", "b0"], {}),
        ("t1", "Transpose", ["a0", "first"], {}),
        ("l0", "LeakyRelu", ["t1"], {"alpha": {"f": 0.1}}),
        ("p1", "PadV2", ["l0", "pads", "least"], {}),
        ("t2", "Transpose", ["p1", "last"], {}),
        ("m0", "MaxPool", ["t2"], pool),
        ("r0", "ResizeBilinear", ["m0", "eight"], {"half_pixel_centers": {"b": True}}),
        ("r1", "ResizeBilinear", ["a0", "eight"], {"half_pixel_centers": {"b": True}}),
        ("s0", "Add", ["r0", "r1"], {}),
        ("t3", "Transpose", ["s0", "first"], {}),
        ("p2", "Pad", ["t3", "pads"], {}),
        ("t4", "Transpose", ["p2", "last"], {}),
        ("c1", "Conv2D", ["t4", "k1"], {"padding": VALID, "strides": ints(1, 1, 1, 1)}),
        ("a1", "Add", ["c1", "b1"], {}),
        ("t5", "Transpose", ["a1", "first"], {}),
        ("v", "ConcatV2", ["t5", "t3", "axis"], {}),
        ("h", "SplitV", ["t5", "parts", "axis"], {}),
        ("g", "Sigmoid", ["h"], {}),
        ("f", "Reshape", ["h:1", "any"], {}),
        ("o", "Transpose", ["f", "swap"], {}),
        ("Identity", "Identity", ["g"], {}),
        ("Identity_1", "Identity", ["o"], {}),
        ("Identity_2", "Identity", ["v"], {}),
    ]
    manifest = [
        {"name": name, "shape": list(value.shape), "dtype": "int32"}
        if value.dtype == np.int32
        else {"name": name, "shape": list(value.shape), "dtype": "float32", "quantization": {"dtype": "float16"}}
        for name, value in constants.items()
    ]
    named = [dict(zip(("name", "op", "input", "attr"), node, strict=True)) for node in nodes]
    named += [{"name": name, "op": "Const"} for name in constants]
    raw = b"".join(value.tobytes() for value in constants.values())
    return {"modelTopology": {"node": named}, "weightsManifest": [{"weights": manifest}]}, raw


def by_torch(image, kernels):
    """What the graph of `document` computes."""
    first, second = (torch.from_numpy(kernel.astype(np.float32)).permute(3, 2, 0, 1) for kernel in kernels)
    size = image.shape[2:]
    down = functional.conv2d(image, first, torch.tensor([0.5, -0.5, 0.1, 0]), stride=2, padding=1)
    leaky = functional.leaky_relu(down, 0.1)
    pooled = functional.max_pool2d(leaky, 3, 2, padding=1)
    up = [functional.interpolate(maps, size, mode="bilinear") for maps in (pooled, down)]
    maps = functional.conv2d(sum(up), second, padding=1)
    return torch.sigmoid(maps[:, :2]), maps[:, 2:].flatten(2).transpose(1, 2), torch.cat([maps, sum(up)], 1)


@pytest.mark.parametrize("size", [(8, 8), (24, 16)])
def test_the_translated_graph_computes_the_same_at_any_size(document, kernels, size):
    model = Translation(*document, size).model(["Identity", "Identity_1", "Identity_2"], {"layout": "nanodet"})
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    image = np.random.default_rng(1).normal(size=(1, 3, size[1], size[0])).astype(np.float32)
    found = session.run(None, {"image": image})
    for mine, wanted in zip(found, by_torch(torch.from_numpy(image), kernels), strict=True):
        np.testing.assert_allclose(mine, wanted.numpy(), rtol=1e-3, atol=1e-4)


def test_weights_that_do_not_fill_the_file(document):
    with pytest.raises(ValueError, match="the document tells of"):
        stored_weights(document[0], document[1] + b"\0")


def test_an_operator_that_has_no_translation(document):
    known, raw = document
    nodes = [*known["modelTopology"]["node"], {"name": "e", "op": "Elu", "input": ["x"]}]
    with pytest.raises(ValueError, match="no translation of Elu"):
        Translation({**known, "modelTopology": {"node": nodes}}, raw, (8, 8)).model(["e"], {})


def test_the_file_is_small_and_says_what_it_is():
    facts = {entry.key: entry.value for entry in onnx.load_model(str(MODEL)).metadata_props}
    assert MODEL.stat().st_size < 5_000_000
    assert (facts["layout"], facts["license"]) == ("nanodet", "Apache-2.0")
    assert "Apache License" in MODEL.with_name("LICENSE").read_text(encoding="utf-8")
    assert MODEL.with_name("CARD.md").exists()
    detector = load_detector("nanodet")
    assert (detector.path, detector.size, len(detector.names)) == (MODEL, (640, 384), 80)
    assert len(detector.detect(np.full((360, 640, 3), 90, np.uint8))) == 0, "nothing on an empty road"


def test_the_default_finds_the_traffic_of_a_real_motorway(shared_data):
    from vision.pipeline import box_tracks
    from vision.video import open_video

    video = open_video(shared_data / "video" / "abhishek-verma-github_highway.mp4")
    table, *_ = box_tracks(video, load_detector("nanodet"), every=12)
    assert 8 <= table["track_id"].nunique() <= 20
    assert set(table["class"]) <= {"car", "truck", "bus", "van"}
