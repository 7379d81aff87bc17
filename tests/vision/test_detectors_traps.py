"""Graphs that would fail silently, or with a riddle: each is one line that says what to do."""

import logging

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from tests.vision import layout_graphs as graphs
from tests.vision.graphs import center_size, write_decoded_yolox, write_graph, yolov8
from tests.vision.layout_graphs import BUS, CENTERED, GRAPHS, IMAGE
from tests.vision.videos import write_video
from vision.contract.errors import InputError
from vision.detectors import LAYOUTS, load_detector, session
from vision.detectors.images import BGR_BYTES, fit_image
from vision.detectors.session import ACCELERATORS, open_session
from vision.video import open_video


def bus(size=(416, 416)):
    answer = yolov8(size=size)
    answer[0, :4, 7], answer[0, 4 + BUS, 7] = center_size(CENTERED), 0.8
    return answer


def refused(path, match, **options):
    with pytest.raises(InputError, match=match) as error:
        load_detector(path, **options)
    assert "\n" not in str(error.value)


def test_files_that_are_not_a_model(tmp_path):
    refused(tmp_path / "none.onnx", r"no such file.*street")
    (tmp_path / "junk.onnx").write_bytes(b"junk")
    refused(tmp_path / "junk.onnx", "not an ONNX model")


@pytest.mark.parametrize(
    "outputs",
    [
        {"logits": np.zeros((1, 1000), np.float32)},
        {"masks": np.zeros((1, 21, 52, 52), np.float32)},
        {"output0": np.zeros((1, 116, 3549), np.float32), "output1": np.zeros((1, 32, 104, 104), np.float32)},
        {"o": np.full((1, 84, 3549), 7, np.float32)},
        {"depth": np.zeros((416, 416), np.float32)},
        {"score": np.array(0.5, np.float32)},
    ],
    ids=["classifier", "segmenter", "yolo with masks", "scores beyond 1", "depth", "scalar"],
)
def test_a_graph_that_is_not_a_detector(outputs, tmp_path):
    name, values = next(iter(outputs.items()))
    shape = rf"gives {name} \[{', '.join(map(str, values.shape))}\]"
    refused(write_graph(tmp_path / "m.onnx", outputs), rf"{shape}.*; give a detector's export")


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_no_layout_can_be_forced_on_a_classifier(layout, tmp_path):
    path = write_graph(tmp_path / "m.onnx", {"logits": np.zeros((1, 1000), np.float32)})
    refused(path, f"cannot be read as {layout.name}", layout=layout.name)


@pytest.mark.parametrize("layout", ["yolox", "nanodet-plus", "nanodet", "rf-detr", "deim", "ssd", "picodet-nms"])
def test_a_layout_that_does_not_fit_the_rows(layout, tmp_path):
    path = write_graph(tmp_path / "m.onnx", {"o": np.zeros((1, 777, 85), np.float32)})
    names = ["car"] * (53 if layout == "nanodet-plus" else 80)
    refused(path, f"cannot be read as {layout}", layout=layout, names=names)


def test_a_graph_that_takes_no_image(tmp_path):
    inputs = helper.make_tensor_value_info("token", TensorProto.FLOAT, [1, 5])
    refused(write_graph(tmp_path / "m.onnx", {"o": bus()}, extra_inputs=(inputs,)), "asks for token beside the image")
    identity = helper.make_graph(
        [helper.make_node("Identity", ["text"], ["o"])],
        "text",
        [helper.make_tensor_value_info("text", TensorProto.FLOAT, [1, 5])],
        [helper.make_tensor_value_info("o", TensorProto.FLOAT, [1, 5])],
    )
    model = helper.make_model(identity, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    (tmp_path / "text.onnx").write_bytes(model.SerializeToString())
    refused(tmp_path / "text.onnx", "takes no image")


def test_a_model_for_another_task(tmp_path):
    path = write_graph(tmp_path / "m.onnx", {"o": bus()}, metadata={"task": "pose"})
    refused(path, "is a model for the task 'pose'")


def test_several_images_at_a_time(tmp_path):
    path = write_graph(tmp_path / "m.onnx", {"o": np.repeat(bus(), 4, axis=0)}, batch=4)
    refused(path, r"takes 4 images at a time; export it for one")


def only_takes(path, width, height, **more):
    """A graph of free axes that runs for one size only: it adds a tensor of that shape."""
    import onnx

    model = onnx.load(write_graph(path, {"o": bus((width, height))}, dynamic=True, **more))
    constant = onnx.numpy_helper.from_array(np.zeros((1, 3, height, width), np.float32), "positions")
    model.graph.initializer.append(constant)
    model.graph.node.insert(0, helper.make_node("Concat", ["images", "positions"], ["both"], axis=0))
    for node in model.graph.node[1:]:
        node.input[:] = ["both" if name == "images" else name for name in node.input]
    onnx.save(model, str(path))
    return path


def test_size_of_the_metadata(tmp_path, caplog):
    path = only_takes(tmp_path / "m.onnx", 640, 384, metadata={"imgsz": "[384, 640]"})
    assert load_detector(path).size == (640, 384) and not caplog.messages
    assert load_detector(only_takes(tmp_path / "one.onnx", 320, 320, metadata={"imgsz": "320"})).size == (320, 320)


def test_size_of_the_metadata_that_the_graph_refuses(tmp_path, caplog):
    path = only_takes(tmp_path / "m.onnx", 416, 416, metadata={"imgsz": "[1280, 1280]"})
    detector = load_detector(path)
    assert detector.size == (416, 416) and len(detector.detect(IMAGE)) == 1
    assert [message.split(": ")[1] for message in caplog.messages] == ["refuses 1280 x 1280 px, so 416 x 416 is taken"]


def test_size_of_the_metadata_that_is_not_the_graphs(tmp_path, caplog):
    path = write_graph(tmp_path / "m.onnx", {"o": bus()}, metadata={"imgsz": "[640, 640]"})
    assert load_detector(path).size == (416, 416)
    assert "says it takes 640 x 640 px but its graph takes 416 x 416" in caplog.text


@pytest.mark.parametrize("stated", ["[384", "'large'", "{}", "[1, 2, 3]"])
def test_size_that_cannot_be_read(stated, tmp_path, caplog):
    path = write_graph(tmp_path / "m.onnx", {"o": bus((640, 640))}, dynamic=True, metadata={"imgsz": stated})
    assert load_detector(path).size == (640, 640)
    assert "cannot be read" in caplog.text or stated == "{}"


def test_a_graph_that_takes_no_usual_size(tmp_path):
    refused(only_takes(tmp_path / "m.onnx", 100, 60), r"refuses an image of 640 x 640 px")


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    return open_video(write_video(path, [IMAGE] * 3))


DENSE = [layout.name for layout in LAYOUTS if layout.dense and layout.name in GRAPHS]


@pytest.mark.parametrize("layout", DENSE)
def test_class_scores_all_exactly_zero(layout, tmp_path, clip, monkeypatch):
    """As static quantization of boxes and scores in one tensor leaves them."""
    written = {}
    monkeypatch.setattr(graphs, "write_graph", lambda path, outputs, **more: written.update(outputs))
    GRAPHS[layout](tmp_path / "m.onnx")
    for name, values in written.items():
        if layout == "yolov8":
            values[:, 4:] = 0
        elif values.shape[2] == 85:
            values[:, :, 5:] = 0
        elif values.shape[2] == 112:
            values[:, :, :80] = 0
        elif "class" in name:
            values[:] = 0
    detector = load_detector(write_graph(tmp_path / "m.onnx", written))
    assert detector.mute
    with pytest.raises(InputError, match="class scores are exactly zero, as int8 quantization"):
        detector.prepare(clip)


def test_a_real_model_quantized(shared_data, tmp_path):
    """Boxes in px and scores share the last tensor, so one step of its 255 is larger than any score."""
    from onnxruntime.quantization import QuantType, quantize_static

    video = open_video(shared_data / "video" / "abhishek-verma-github_highway.mp4")
    whole = write_decoded_yolox(tmp_path / "m.onnx", shared_data / "models" / "yolox_nano.onnx", 416)
    detector = load_detector(whole)
    fitted = (fit_image(frame.image, detector.size, "corner", 114)[0] for frame in video.sample(2))
    shown = iter([{"images": BGR_BYTES.tensor(canvas)} for canvas in fitted])

    class Frames:
        def get_next(self):
            return next(shown, None)

        def __len__(self):
            return 2

    quantize_static(whole, tmp_path / "q.onnx", Frames(), weight_type=QuantType.QInt8)
    detector = load_detector(tmp_path / "q.onnx")
    assert detector.mute
    with pytest.raises(InputError, match="class scores are exactly zero"):
        detector.prepare(video)


def test_a_model_that_is_sure_of_nothing_in_noise_is_not_mute(tmp_path, clip):
    """Scores of noise may round to zero in half precision; then frames of the video decide."""
    answer, gain = bus(), np.zeros_like(bus())
    gain[0, 4 + BUS, 7], answer[0, 4 + BUS, 7] = 3.0, 0.0
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, gains={"o": gain}, element=TensorProto.FLOAT)
    detector = load_detector(path, layout="yolov8")
    assert detector.prepare(clip) is detector
    object.__setattr__(detector, "mute", True)
    assert detector.prepare(clip) is detector


def test_a_list_of_nothing_is_not_mute(tmp_path, clip):
    detector = load_detector(write_graph(tmp_path / "m.onnx", {"o": np.zeros((1, 300, 6), np.float32)}))
    assert len(detector.prepare(clip).detect(IMAGE)) == 0


class Sessions:
    """Stands for onnxruntime on machines that this is not: which providers are listed and which start."""

    def __init__(self, monkeypatch, listed, working):
        self.opened = []
        monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: listed)
        monkeypatch.setattr(onnxruntime, "InferenceSession", self.open)
        self.working = working

    def open(self, path, options, providers):
        self.opened.append((providers, options.get_session_config_entry("session.intra_op.allow_spinning")))
        working = self.working

        class Session:
            def get_providers(self):
                return [name for name in providers if name in working]

        return Session()


CPU, CUDA, OPENVINO = "CPUExecutionProvider", "CUDAExecutionProvider", "OpenVINOExecutionProvider"


def test_first_accelerator_there_is(tmp_path, monkeypatch):
    sessions = Sessions(monkeypatch, [CPU, OPENVINO, CUDA], [CUDA, OPENVINO, CPU])
    assert open_session(tmp_path).get_providers()[0] == CUDA
    assert sessions.opened == [([CUDA, CPU], "0")]
    assert ACCELERATORS[0] == CUDA and len(ACCELERATORS) == 4


def test_accelerator_without_its_libraries(tmp_path, monkeypatch, caplog):
    Sessions(monkeypatch, [CUDA, OPENVINO, CPU], [OPENVINO, CPU])
    with caplog.at_level(logging.WARNING):
        assert open_session(tmp_path).get_providers()[0] == OPENVINO
    assert "CUDAExecutionProvider does not run it here (its libraries are missing)" in caplog.text


def test_accelerator_that_refuses_the_model(tmp_path, monkeypatch, caplog):
    sessions = Sessions(monkeypatch, [CUDA, CPU], [CUDA, CPU])

    def broken(path, options, providers):
        if CUDA in providers:
            raise RuntimeError("out of memory\nat line 1")
        return sessions.open(path, options, providers)

    monkeypatch.setattr(onnxruntime, "InferenceSession", broken)
    assert open_session(tmp_path).get_providers() == [CPU]
    assert "CUDAExecutionProvider does not run it here (out of memory)" in caplog.text


def test_no_accelerator(tmp_path, monkeypatch):
    sessions = Sessions(monkeypatch, ["AzureExecutionProvider", CPU], [CPU])
    open_session(tmp_path)
    assert sessions.opened == [([CPU], "0")]


@pytest.mark.parametrize(("mine", "all_there_are", "threads"), [({1}, 2, 1), ({0, 1}, 2, 0), ({0, 1}, None, 0)])
def test_cores_of_a_confined_process(mine, all_there_are, threads, monkeypatch):
    monkeypatch.setattr(session.sys, "platform", "linux")
    monkeypatch.setattr(session.os, "sched_getaffinity", lambda process: mine, raising=False)
    monkeypatch.setattr(session.os, "cpu_count", lambda: all_there_are)
    assert session.allotted_cores() == threads


def test_one_free_side(tmp_path):
    """Height fixed by the graph, width by the metadata."""
    import onnx

    path = write_graph(tmp_path / "m.onnx", {"o": bus((640, 384))}, dynamic=True, metadata={"imgsz": "[320, 640]"})
    model = onnx.load(path)
    model.graph.input[0].type.tensor_type.shape.dim[2].dim_value = 384
    onnx.save(model, str(path))
    assert load_detector(path).size == (640, 384)


def test_a_graph_without_end_is_given_up(tmp_path, monkeypatch):
    """A loop whose condition stays true; while it runs nothing else would, Ctrl-C included."""
    info = helper.make_tensor_value_info
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Identity", ["before"], ["after"])],
        "body",
        [
            info("turn", TensorProto.INT64, []),
            info("go", TensorProto.BOOL, []),
            info("before", TensorProto.FLOAT, None),
        ],
        [info("on", TensorProto.BOOL, []), info("after", TensorProto.FLOAT, None)],
    )
    nodes = [
        helper.make_node("Constant", [], ["true"], value=numpy_helper.from_array(np.array(True))),
        helper.make_node("Loop", ["", "true", "images"], ["o"], body=body),
    ]
    images = info("images", TensorProto.FLOAT, [1, 3, 32, 32])
    graph = helper.make_graph(nodes, "endless", [images], [info("o", TensorProto.FLOAT, None)])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, tmp_path / "m.onnx")
    monkeypatch.setattr("vision.detectors.session.LIMIT", 0.3)
    with pytest.raises(InputError, match=r"m\.onnx: the model is not done with one image after 0\.3 s"):
        load_detector(tmp_path / "m.onnx")
