import json

import numpy as np
import pytest
from onnx import TensorProto, helper

from tests.vision.graphs import anchors, write_graph, yolov8
from tests.vision.videos import write_video
from vision.contract.errors import InputError
from vision.detectors import LAYOUTS, load_detector
from vision.detectors.names import COCO
from vision.video import open_video

CAR, BUS, PERSON = COCO.index("car"), COCO.index("bus"), COCO.index("person")
IMAGE = np.full((312, 624, 3), 90, np.uint8)  # 2/3 fits it into 416 x 208; centered, 104 px from the top
BOX = np.array([150.0, 60, 270, 150])
CENTERED = BOX * 2 / 3 + np.array([0, 104, 0, 104])
CORNERED = BOX * 2 / 3


def center_size(box):
    return [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, box[2] - box[0], box[3] - box[1]]


def yolov8_graph(path):
    answer = yolov8()
    answer[0, :4, 7], answer[0, 4 + BUS, 7] = center_size(CENTERED), 0.8
    answer[0, :4, 9], answer[0, 4 + PERSON, 9] = center_size(CENTERED + 150), 0.9
    return write_graph(path, {"output0": answer})


def yolov10_graph(path):
    answer = np.zeros((1, 300, 6), np.float32)
    answer[0, 0] = [*CENTERED, 0.8, BUS]
    answer[0, 1] = [*(CENTERED + 150), 0.9, PERSON]
    return write_graph(path, {"output0": answer})


def yolox_answer():
    answer = np.zeros((1, anchors((416, 416)), 85), np.float32)
    grid, stride, column, row = 416 // 16, 16, 9, 4
    cell = (416 // 8) ** 2 + row * grid + column
    cx, cy, w, h = center_size(CORNERED)
    answer[0, cell, :5] = [cx / stride - column, cy / stride - row, np.log(w / stride), np.log(h / stride), 1.0]
    answer[0, cell, 5 + BUS] = 0.8
    return answer


def yolox_graph(path):
    return write_graph(path, {"output": yolox_answer()})


def yolox_decoded_graph(path):
    answer = np.zeros((1, anchors((416, 416)), 85), np.float32)
    answer[0, 5, :5], answer[0, 5, 5 + BUS] = [*center_size(CORNERED), 1.0], 0.8
    return write_graph(path, {"output": answer})


def nanodet_graph(path):
    outputs = {}
    for stride in (8, 16, 32):
        outputs[f"class_{stride}"] = np.zeros((1, (416 // stride) ** 2, 80), np.float32)
    for stride in (8, 16, 32):
        outputs[f"distance_{stride}"] = np.zeros((1, (416 // stride) ** 2, 32), np.float32)
    column, row = 4, 5
    cell = row * 13 + column
    outputs["class_32"][0, cell, BUS] = 0.8
    center = (np.array([column, row]) + 0.5) * 32
    edges = np.concatenate([center - CENTERED[:2], CENTERED[2:] - center]) / 32
    for edge, distance in enumerate(edges):  # two neighboring bins whose softmax has this mean
        low = int(distance)
        outputs["distance_32"][0, cell, edge * 8 : edge * 8 + 8] = -50
        outputs["distance_32"][0, cell, edge * 8 + low] = np.log(1 - (distance - low) + 1e-12)
        outputs["distance_32"][0, cell, edge * 8 + low + 1] = np.log(distance - low + 1e-12)
    return write_graph(path, outputs)


def deim_graph(path):
    stretched = BOX * np.array([416 / 624, 416 / 312] * 2)
    sizes = helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, ["n", 2])
    outputs = {
        "labels": np.array([[BUS, PERSON]]),
        "boxes": np.array([[stretched, stretched + 150]], np.float32),
        "scores": np.array([[0.8, 0.9]], np.float32),
    }
    return write_graph(path, outputs, extra_inputs=(sizes,))


def street_graph(path, **more):
    answer = np.zeros((1, 100, 6), np.float32)
    answer[0, 0] = [*CENTERED, 0.8, 1]
    background = helper.make_tensor_value_info("background", TensorProto.FLOAT, [1, 3, 416, 416])
    metadata = {"layout": "roadfiber-street", "names": "{0: 'car', 1: 'bus'}", "threshold": "0.35"}
    return write_graph(
        path, {"detections": answer}, image="frame", extra_inputs=(background,), metadata=metadata, **more
    )


GRAPHS = {
    "yolov8": yolov8_graph,
    "yolov10": yolov10_graph,
    "yolox": yolox_graph,
    "nanodet": nanodet_graph,
    "deim": deim_graph,
    "roadfiber-street": street_graph,
}


def test_every_layout_is_tested():
    assert set(GRAPHS) == {layout.name for layout in LAYOUTS}


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    return open_video(write_video(path, [IMAGE] * 3))


@pytest.mark.parametrize("layout", GRAPHS)
def test_layout_is_recognized_and_read(layout, tmp_path, clip):
    detector = load_detector(GRAPHS[layout](tmp_path / "m.onnx")).prepare(clip)
    assert detector.layout.name == layout
    found = detector.detect(IMAGE)
    assert found.label.tolist() == ["bus"], "the person is no vehicle"
    np.testing.assert_allclose(found.box, [BOX], atol=0.02)
    np.testing.assert_allclose(found.score, [0.8], atol=1e-6)


def test_decoded_yolox(tmp_path):
    found = load_detector(yolox_decoded_graph(tmp_path / "m.onnx")).detect(IMAGE)
    np.testing.assert_allclose(found.box, [BOX], atol=0.02)


RED = np.zeros((416, 416, 3), np.uint8)
RED[:, :, 2] = 200


def test_yolov8_sees_rgb_from_0_to_1(tmp_path):
    answer, gain = yolov8(), np.zeros_like(yolov8())
    answer[0, :4, 7], gain[0, 4 + CAR, 7] = [200, 200, 100, 100], 1.0
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, gains={"o": gain}, channel=0)
    np.testing.assert_allclose(load_detector(path).detect(RED).score, [200 / 255], rtol=1e-3)


def test_yolox_sees_bgr_from_0_to_255(tmp_path):
    answer = yolox_answer()
    answer[0, :, 5:] = 0
    gain = np.zeros_like(answer)
    gain[0, np.flatnonzero(answer[0, :, 4])[0], 5 + CAR] = 0.004
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, gains={"o": gain}, channel=2)
    np.testing.assert_allclose(load_detector(path).detect(RED).score, [0.8], rtol=1e-5)


def test_half_precision_input(tmp_path):
    answer = yolov8()
    answer[0, :4, 7], answer[0, 4 + CAR, 7] = center_size(CENTERED), 0.8
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, element=TensorProto.FLOAT16)
    assert len(load_detector(path).detect(IMAGE)) == 1


def test_dynamic_size_comes_from_the_metadata(tmp_path):
    answer = yolov8(size=(640, 384))
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, dynamic=True, metadata={"imgsz": "[384, 640]"})
    assert load_detector(path).size == (640, 384)


def test_names_of_the_model(tmp_path):
    answer = yolov8(3)
    answer[0, :4, 7], answer[0, 6, 7] = center_size(CENTERED), 0.8
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, metadata={"names": "{2: 'Motorbike', 0: 'cat', 1: 'dog'}"})
    assert load_detector(path).detect(IMAGE).label.tolist() == ["motorcycle"]
    plain = write_graph(tmp_path / "p.onnx", {"o": answer})
    assert load_detector(plain, names=["cat", "dog", "lorry"]).detect(IMAGE).label.tolist() == ["truck"]
    assert len(load_detector(plain, names=["car", "dog", "lorry"], classes=["car"]).detect(IMAGE)) == 0


def test_overlapping_classes_are_one_vehicle(tmp_path):
    answer = yolov8()
    for place, (label, score) in enumerate([(CAR, 0.7), (BUS, 0.8)]):
        answer[0, :4, place], answer[0, 4 + label, place] = center_size(CENTERED + place), score
    found = load_detector(write_graph(tmp_path / "m.onnx", {"o": answer})).detect(IMAGE)
    assert found.label.tolist() == ["bus"]


def test_a_car_as_large_as_the_image_is_none(tmp_path):
    answer = yolov8()
    answer[0, :4, 0], answer[0, 4 + CAR, 0] = [208, 208, 416, 208], 0.9
    assert len(load_detector(write_graph(tmp_path / "m.onnx", {"o": answer})).detect(IMAGE)) == 0


def test_background_is_the_median_of_the_video(tmp_path):
    images = [np.full((416, 416, 3), value, np.uint8) for value in (40, 40, 200, 40, 40)]
    video = open_video(write_video(tmp_path / "v.mp4", images))
    detector = load_detector(street_graph(tmp_path / "m.onnx")).prepare(video)
    assert detector.background.shape == (416, 416, 3) and abs(detector.background.mean() - 40) < 3
    assert detector.threshold == 0.35


def test_forced_layout(tmp_path):
    path = yolov10_graph(tmp_path / "m.onnx")
    assert load_detector(path, layout="yolov10").layout.name == "yolov10"
    with pytest.raises(InputError, match="cannot be read as deim"):
        load_detector(path, layout="deim")
    with pytest.raises(InputError, match=r"layout 'yolo99' is unknown; known are .*yolox"):
        load_detector(path, layout="yolo99")


def test_files_that_are_no_detector(tmp_path):
    with pytest.raises(InputError, match=r"no such file.*street"):
        load_detector(tmp_path / "none.onnx")
    (tmp_path / "junk.onnx").write_bytes(b"junk")
    with pytest.raises(InputError, match="not an ONNX model"):
        load_detector(tmp_path / "junk.onnx")
    classifier = write_graph(tmp_path / "c.onnx", {"logits": np.zeros((1, 1000), np.float32)})
    with pytest.raises(InputError, match=r"logits \[1, 1000\].*recognized are .*yolov8") as error:
        load_detector(classifier)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("count", "metadata", "options", "complaint"),
    [
        (3, {}, {}, "3 classes and no names"),
        (3, {"names": "{0: 'car'}"}, {}, "3 classes but 1 names"),
        (3, {"names": "{0: 'car"}, {}, "names cannot be read"),
        (2, {"names": json.dumps(["cat", "dog"])}, {}, "knows no class .*it has cat, dog"),
        (80, {}, {"classes": ["tram"]}, "knows no class tram"),
    ],
)
def test_names_that_do_not_fit(count, metadata, options, complaint, tmp_path):
    path = write_graph(tmp_path / "m.onnx", {"o": yolov8(count)}, metadata=metadata)
    with pytest.raises(InputError, match=complaint):
        load_detector(path, **options)


@pytest.mark.parametrize("model", ["yolox_nano", "nanodet_m_416", "deimv2_hgnetv2_atto_coco"])
def test_real_models_see_the_same_car(model, shared_data):
    video = open_video(shared_data / "video" / "abhishek-verma-github_highway.mp4")
    image = next(frame.image for frame in video.frames(every=100) if frame.index == 100)
    found = load_detector(shared_data / "models" / f"{model}.onnx").detect(image)
    strong = found.box[found.score > 0.55]
    near = np.abs(strong - [445, 183, 494, 227]).max(axis=1)
    assert near.min() < 6 and found.label[found.score > 0.55][near.argmin()] == "car"
