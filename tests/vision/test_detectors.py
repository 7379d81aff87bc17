"""Every layout on a synthetic graph with a known answer, what networks are shown, names, and real models."""

import json
from dataclasses import replace

import numpy as np
import pytest
from onnx import TensorProto

from tests.vision import layout_graphs as graphs
from tests.vision.graphs import anchors, center_size, write_decoded_yolox, write_graph, yolov8
from tests.vision.layout_graphs import BOX, BUS, CENTERED, GRAPHS, IMAGE, PERSON
from tests.vision.videos import write_video
from vision.contract.errors import InputError
from vision.detectors import LAYOUTS, load_detector
from vision.detectors.images import fit_image
from vision.detectors.layout import Graph
from vision.detectors.names import COCO, COCO_IDS
from vision.video import open_video

CAR = COCO.index("car")


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    return open_video(write_video(path, [IMAGE] * 3))


def assert_finds_the_bus(detector, atol=0.02):
    found = detector.detect(IMAGE)
    assert found.label.tolist() == ["bus"], "the person is not a vehicle"
    np.testing.assert_allclose(found.box, [BOX], atol=atol)
    np.testing.assert_allclose(found.score, [0.8], atol=1e-6 if atol < 0.1 else 1e-3)


def test_every_layout_is_tested():
    hidden = {"deim-imagenet", "picodet-bgr", "picodet-nms-bgr"}
    assert {layout.name for layout in LAYOUTS} - set(GRAPHS) == hidden, "which nothing shows"


@pytest.mark.parametrize("layout", GRAPHS)
def test_layout_is_recognized_and_read(layout, tmp_path, clip):
    detector = load_detector(GRAPHS[layout](tmp_path / "m.onnx")).prepare(clip)
    assert detector.layout.name == layout
    assert_finds_the_bus(detector)


@pytest.mark.parametrize("layout", GRAPHS)
def test_no_graph_fits_two_layouts(layout, tmp_path):
    detector = load_detector(GRAPHS[layout](tmp_path / "m.onnx"))
    session = detector.session
    feeds = {
        entry.name: np.ones([side if isinstance(side, int) else 1 for side in entry.shape], dtype)
        for entry in session.get_inputs()
        for dtype in [{"tensor(float)": np.float32, "tensor(uint8)": np.uint8}.get(entry.type, np.int64)]
    }
    names = tuple(entry.name.split(":")[0] for entry in session.get_outputs())
    inputs = tuple(entry.name for entry in session.get_inputs())
    graph = Graph(inputs, names, tuple(session.run(None, feeds)), detector.size)
    assert [known.name for known in LAYOUTS if known.matches(graph)] == [layout]


@pytest.mark.parametrize("layout", sorted(set(GRAPHS) - {"roadfiber-street"}))
def test_half_precision(layout, tmp_path, clip):
    more = {} if layout == "ssd" else {"element": TensorProto.FLOAT16}
    detector = load_detector(GRAPHS[layout](tmp_path / "m.onnx", half=True, **more)).prepare(clip)
    assert detector.layout.name == layout
    assert_finds_the_bus(detector, atol=0.5)


def test_class_scores_and_distances_in_either_order(tmp_path):
    assert_finds_the_bus(load_detector(graphs.nanodet_swapped(tmp_path / "m.onnx")))


@pytest.mark.parametrize("swapped", [False, True])
def test_nanodet_g_has_more_bins(swapped, tmp_path):
    detector = load_detector(graphs.nanodet_g(tmp_path / "m.onnx", swapped=swapped))
    assert detector.layout.name == "nanodet"
    assert_finds_the_bus(detector)


def test_nanodet_plus_of_three_strides_is_not_yolox(tmp_path):
    detector = load_detector(graphs.nanodet_plus(tmp_path / "m.onnx", strides=(8, 16, 32)))
    assert detector.layout.name == "nanodet-plus", "same shape as a YOLOX of 107 classes; only logits are negative"
    assert_finds_the_bus(detector)


def test_batch_axis_may_be_missing(tmp_path):
    outputs = {name: values[0] for name, values in graphs.deim_answer().items()}
    sizes = graphs.side_input("orig_target_sizes", TensorProto.INT64)
    assert_finds_the_bus(load_detector(write_graph(tmp_path / "m.onnx", outputs, extra_inputs=(sizes,))))


def test_outputs_in_another_order(tmp_path):
    outputs = dict(reversed(graphs.deim_answer().items()))
    sizes = graphs.side_input("orig_target_sizes", TensorProto.INT64)
    assert_finds_the_bus(load_detector(write_graph(tmp_path / "m.onnx", outputs, extra_inputs=(sizes,))))


def test_undecoded_heads_beside_the_table(tmp_path):
    answer = np.zeros((1, 3 * anchors((416, 416)), 85), np.float32)
    answer[0, 7, :5], answer[0, 7, 5 + BUS] = [*center_size(CENTERED), 1.0], 0.8
    outputs = {"output": answer, "350": np.zeros((1, 3, 52, 52, 85), np.float32)}
    assert_finds_the_bus(load_detector(write_graph(tmp_path / "m.onnx", outputs)))


def test_metadata_tells_shares_from_px(tmp_path):
    """A frame without vehicles, boxes of no size: only the exporter's word is left."""
    blank = np.zeros((1, 300, 6), np.float32)
    said = write_graph(tmp_path / "said.onnx", {"o": blank}, metadata={"head": "RTDETRDecoder"})
    assert load_detector(said).layout.name == "rtdetr-rows"
    assert load_detector(write_graph(tmp_path / "m.onnx", {"o": blank})).layout.name == "yolov10"


def test_answer_of_no_rows(tmp_path):
    path = write_graph(tmp_path / "m.onnx", {"o": np.zeros((1, 0, 6), np.float32)})
    assert len(load_detector(path).detect(IMAGE)) == 0


def test_two_classes_of_an_old_rtdetr_are_not_rows(tmp_path):
    answer = np.full((1, 300, 6), 0.01, np.float32)
    answer[0, 0] = [*center_size(graphs.STRETCHED / graphs.SIDE), 0.05, 0.8]
    detector = load_detector(write_graph(tmp_path / "m.onnx", {"o": answer}), names=["person", "bus"])
    assert detector.layout.name == "rtdetr"
    assert_finds_the_bus(detector)


COLORS = {  # what a graph of the layout sees of a red image, by channel of the input
    "yolov5": (200 / 255, 0, 0),
    "yolov6": (200 / 255, 0, 0),
    "yolov8": (200 / 255, 0, 0),
    "yolov10": (200 / 255, 0, 0),
    "yolox": (0, 0, 200),
    "yolox-decoded": (0, 0, 200),
    "rtdetr": (200 / 255, 0, 0),
    "rtdetr-rows": (200 / 255, 0, 0),
    "deim": (200 / 255, 0, 0),
    "rf-detr": ((200 - 123.675) / 58.395, -116.28 / 57.12, -103.53 / 57.375),
    "detr-logits": (200 / 255, 0, 0),
    "nanodet": (-103.53 / 57.375, -116.28 / 57.12, (200 - 123.675) / 58.395),
    "nanodet-plus": (-103.53 / 57.375, -116.28 / 57.12, (200 - 123.675) / 58.395),
    "picodet": ((200 - 123.675) / 58.395, -116.28 / 57.12, -103.53 / 57.375),
    "picodet-nms": ((200 - 123.675) / 58.395, -116.28 / 57.12, -103.53 / 57.375),
    "paddle-rows": (200 / 255, 0, 0),
    "ssd": (200, 0, 0),
    "roadfiber-street": (200 / 255, 0, 0),
}
RED = np.zeros((416, 416, 3), np.uint8)
RED[:, :, 2] = 200


@pytest.mark.parametrize("layout", GRAPHS)
def test_what_the_network_is_shown(layout, tmp_path, clip):
    detector = load_detector(GRAPHS[layout](tmp_path / "m.onnx")).prepare(clip)
    tensor = detector.image.tensors([RED] * len(detector.image.names), detector.layout.normalization)
    shown = tensor[detector.image.names[0]]
    assert shown.shape == ((1, 416, 416, 3) if layout == "ssd" else (1, 3, 416, 416))
    mean = shown.mean(axis=(0, 1, 2) if layout == "ssd" else (0, 2, 3), dtype=float)
    np.testing.assert_allclose(mean, COLORS[layout], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("layout", ["yolov8", "yolox", "nanodet", "ssd", "rtdetr"])
def test_images_of_several_shapes_do_not_mix(layout, tmp_path, clip):
    """Buffers are used again: what one image left beside the next must not be seen."""
    model, shown = GRAPHS[layout](tmp_path / "m.onnx"), []

    class Watched:
        def __init__(self, session):
            self.session = session

        def __getattr__(self, name):
            return getattr(self.session, name)

        def run(self, names, feeds, options):
            shown.append(next(iter(feeds.values())).copy())
            return self.session.run(names, feeds, options)

    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (*shape, 3), dtype=np.uint8) for shape in [(312, 624), (500, 300), (416, 416)]]
    used = load_detector(model).prepare(clip)
    used = replace(used, session=Watched(used.session))
    for image in [*images, *images[::-1]]:
        used.detect_all([image, image])
        canvas, _ = fit_image(image, used.size, used.layout.fitting, used.layout.fill)
        expected = used.image.tensors([canvas], used.layout.normalization)[used.image.names[0]]
        for tensor in shown:
            np.testing.assert_array_equal(tensor, expected)
        shown.clear()


@pytest.mark.parametrize("layout", ["picodet", "picodet-nms"])
def test_picodet_in_either_order_of_colors(layout, tmp_path):
    """The makers' training code feeds RGB, their demo for onnxruntime BGR."""
    model = GRAPHS[layout](tmp_path / "m.onnx")
    shown = {}
    for name in (layout, f"{layout}-bgr"):
        detector = load_detector(model, layout=name)
        assert_finds_the_bus(detector)
        tensors = detector.image.tensors([RED], detector.layout.normalization)
        shown[name] = tensors[detector.image.names[0]][0, :, 0, 0]
    np.testing.assert_allclose(shown[layout], COLORS[layout], rtol=1e-4)
    np.testing.assert_allclose(shown[f"{layout}-bgr"], COLORS[layout][::-1], rtol=1e-4)


def test_yolov8_sees_rgb_from_0_to_1(tmp_path):
    answer, gain = yolov8(), np.zeros_like(yolov8())
    answer[0, :4, 7], gain[0, 4 + CAR, 7] = [200, 200, 100, 100], 1.0
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, gains={"o": gain}, channel=0)
    np.testing.assert_allclose(load_detector(path).detect(RED).score, [200 / 255], rtol=1e-3)


@pytest.mark.parametrize("layout", ["yolov5", "yolov8"])
@pytest.mark.parametrize("strides", [(8, 16, 32, 64), (4, 8, 16, 32)])
def test_pyramids_of_four_scales(layout, strides, tmp_path):
    size = 416, 416
    if layout == "yolov5":
        answer = np.zeros((1, 3 * anchors(size, strides), 85), np.float32)
        answer[0, 7, :5], answer[0, 7, 5 + BUS] = [*center_size(CENTERED), 1.0], 0.8
    else:
        answer = np.zeros((1, 84, anchors(size, strides)), np.float32)
        answer[0, :4, 7], answer[0, 4 + BUS, 7] = center_size(CENTERED), 0.8
    detector = load_detector(write_graph(tmp_path / "m.onnx", {"o": answer}))
    assert detector.layout.name == layout
    assert_finds_the_bus(detector)


def test_yolox_sees_bgr_from_0_to_255(tmp_path):
    answer = graphs.yolox_answer()
    answer[0, :, 5:] = 0
    gain = np.zeros_like(answer)
    gain[0, np.flatnonzero(answer[0, :, 4])[0], 5 + CAR] = 0.004
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, gains={"o": gain}, channel=2)
    np.testing.assert_allclose(load_detector(path).detect(RED).score, [0.8], rtol=1e-5)


def test_names_of_the_model(tmp_path):
    answer = yolov8(3)
    answer[0, :4, 7], answer[0, 6, 7] = center_size(CENTERED), 0.8
    path = write_graph(tmp_path / "m.onnx", {"o": answer}, metadata={"names": "{2: 'Motorbike', 0: 'cat', 1: 'dog'}"})
    assert load_detector(path).detect(IMAGE).label.tolist() == ["motorcycle"]
    assert load_detector(path, classes=["motor-bike"]).detect(IMAGE).label.tolist() == ["motorcycle"]
    plain = write_graph(tmp_path / "p.onnx", {"o": answer})
    assert load_detector(plain, names=["cat", "dog", "lorry"]).detect(IMAGE).label.tolist() == ["truck"]
    assert len(load_detector(plain, names=["car", "dog", "lorry"], classes=["car"]).detect(IMAGE)) == 0


def test_coco_ids():
    assert len(COCO_IDS) == 91 and [COCO_IDS[k] for k in (1, 3, 4, 6, 8, 44, 90)] == [
        *("person", "car", "motorcycle", "bus", "truck", "bottle", "toothbrush")
    ]
    assert [name for name in COCO_IDS if name != "unused"] == list(COCO)


def test_names_that_a_file_lost_are_assumed_aloud(tmp_path, caplog):
    """A list of detections does not show how many classes there are."""
    path = graphs.yolov10(tmp_path / "m.onnx")
    detector = load_detector(path)
    assert "COCO's names are assumed" in caplog.text and "--names" in caplog.text
    assert "class names COCO's, which is assumed" in detector.taken and "RGB from 0 to 1" in detector.taken
    caplog.clear()
    assert "class names as given; follows bus, not" in load_detector(path, names=["a", "b", "c", "d", "e", "bus"]).taken
    assert caplog.text == ""
    with pytest.raises(InputError, match=r"finds class number 5 .from 0. but 3 are named"):
        load_detector(path, names=["car", "bus", "truck"])


def test_names_of_an_own_rf_detr(tmp_path):
    """Three classes and the column of no class: the logits are as wide as the boxes."""
    outputs = {"dets": graphs.share_boxes(), "labels": graphs.logits(4, [(1, 0.8), (0, 0.9)])}
    path = write_graph(tmp_path / "m.onnx", outputs)
    with pytest.raises(InputError, match="3 classes and no names"):
        load_detector(path)
    assert_finds_the_bus(load_detector(path, names=["person", "bus", "car"]))


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
    detector = load_detector(graphs.street(tmp_path / "m.onnx")).prepare(video)
    assert detector.background.shape == (416, 416, 3) and abs(detector.background.mean() - 40) < 3
    assert detector.threshold == 0.35


def test_forced_layout(tmp_path):
    path = graphs.yolov10(tmp_path / "m.onnx")
    assert load_detector(path, layout="yolov10").layout.name == "yolov10"
    with pytest.raises(InputError, match="cannot be read as deim"):
        load_detector(path, layout="deim")
    with pytest.raises(InputError, match="cannot be read as yolov8"):
        load_detector(graphs.deim(tmp_path / "d.onnx"), layout="yolov8", names=["car", "bus"])
    with pytest.raises(InputError, match=r"layout 'yolo99' is unknown; known are .*yolox"):
        load_detector(path, layout="yolo99")
    dinov3 = load_detector(graphs.deim(tmp_path / "d.onnx"), layout="deim-imagenet")
    assert dinov3.layout.normalization.mean == (123.675, 116.28, 103.53)


def test_the_model_decides_what_it_is_but_not_against_the_user(tmp_path):
    path = graphs.rtdetr_rows(tmp_path / "m.onnx", metadata={"layout": "yolov10"})
    assert load_detector(path).layout.name == "yolov10"
    assert load_detector(path, layout="rtdetr-rows").layout.name == "rtdetr-rows"
    axes = graphs.rtdetr_rows(tmp_path / "axes.onnx", metadata={"layout": "NCHW"})
    assert load_detector(axes).layout.name == "rtdetr-rows"


@pytest.mark.parametrize(
    ("count", "metadata", "options", "complaint"),
    [
        (3, {}, {}, "3 classes and no names"),
        (3, {"names": "{0: 'car'}"}, {}, "3 classes but 1 names"),
        (3, {"names": "{0: 'car"}, {}, "names cannot be read"),
        (2, {"names": json.dumps(["cat", "dog"])}, {}, "knows no class .*it has cat, dog"),
        (80, {}, {"classes": ["tram"]}, "knows no class tram; did you mean train"),
        (80, {}, {"classes": ["motorbkie", "car"]}, "knows no class motorbkie; did you mean motorcycle"),
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


def test_a_real_model_decoded_in_the_graph_sees_the_same(shared_data, tmp_path):
    model = shared_data / "models" / "yolox_nano.onnx"
    raw, decoded = load_detector(model), load_detector(write_decoded_yolox(tmp_path / "m.onnx", model, 416))
    assert (raw.layout.name, decoded.layout.name) == ("yolox", "yolox-decoded")
    for frame in open_video(shared_data / "video" / "abhishek-verma-github_highway.mp4").sample(3):
        one, other = raw.detect(frame.image), decoded.detect(frame.image)
        assert len(one) and one.label.tolist() == other.label.tolist()
        np.testing.assert_allclose(one.box, other.box, atol=1e-3)
        np.testing.assert_allclose(one.score, other.score, atol=1e-5)


def test_person_is_a_class_like_others(tmp_path):
    detector = load_detector(GRAPHS["ssd"](tmp_path / "m.onnx"), classes=["person"])
    assert detector.wanted.tolist() == [PERSON_PLACE := graphs.PERSON_ID - 1] and PERSON_PLACE == PERSON
    assert detector.detect(IMAGE).label.tolist() == ["person"]
