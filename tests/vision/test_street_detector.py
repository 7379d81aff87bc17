"""The embedded detector: its file, its scores on a street it has not seen, and its training."""

import json

import numpy as np
import onnx
import pytest
import torch

from vision.scene import Camera, Light, Scene, SceneVehicle, Street, constant_speed
from vision.street_detector import MODEL
from vision.street_detector.batches import CROP, crop, moved
from vision.street_detector.export import save_onnx
from vision.street_detector.loss import FULL, detection_loss, generalized_iou, log_sides, make_targets
from vision.street_detector.model import CLASSES, KEPT, STRIDE, Decoded, StreetNet, sides_to_boxes
from vision.street_detector.scenes import Samples, encoded, make_samples, random_scene, sampled
from vision.street_detector.scores import average_precision, matched, onnx_detector, score
from vision.street_detector.train import THRESHOLD, train


@pytest.fixture(scope="module")
def street() -> Samples:
    """Frames of a fresh street: no random scene of the training, both lanes, every class."""
    kinds = ["car", "bus", "van", "truck", "car", "car", "van", "car"]
    rng = np.random.default_rng(3)
    vehicles = tuple(
        SceneVehicle(cls, constant_speed(-20.0 + 21 * k, 1.75 - 3.5 * (k % 2), 9.0 - 18.0 * (k % 2)), style=k)
        for k, cls in enumerate(kinds)
    )
    scene = Scene(Camera.looking_at((-6.0, -9.0, -7.0), (32.0, 0.0)), Street(seed=77), Light(sun=0.6), vehicles, seed=1)
    return sampled(scene, np.linspace(0.0, 5.0, 8), rng)


def test_file_is_small_and_says_what_it_is():
    model = onnx.load_model(str(MODEL))
    facts = {entry.key: entry.value for entry in model.metadata_props}
    shapes = {
        i.name: [d.dim_value for d in i.type.tensor_type.shape.dim] for i in [*model.graph.input, *model.graph.output]
    }
    assert MODEL.stat().st_size < 3_000_000
    assert model.opset_import[0].version <= 17
    assert facts["layout"] == "roadfiber-street"
    assert facts["names"] == "{0: 'car', 1: 'van', 2: 'truck', 3: 'bus'}"
    assert json.loads(facts["imgsz"]) == [384, 640]
    assert float(facts["threshold"]) == THRESHOLD
    assert shapes == {"frame": [1, 3, 384, 640], "background": [1, 3, 384, 640], "detections": [1, KEPT, 6]}
    assert MODEL.with_name("CARD.md").exists()


def test_finds_the_vehicles_of_a_fresh_street(street):
    scores = score(onnx_detector(MODEL), street, THRESHOLD)
    assert scores.vehicles > 25
    assert scores.recall >= 0.9
    assert scores.precision >= 0.9
    assert scores.edge_median < 1.5
    assert scores.class_accuracy > 0.8


def test_empty_street_is_empty(street):
    _, background = street.picture(0)
    found = onnx_detector(MODEL)(background, background)
    assert not (found[:, 4] >= THRESHOLD).any()


@pytest.mark.parametrize("seed", [0, 1])
def test_random_scene_repeats_by_seed(seed):
    again = random_scene(seed)
    assert random_scene(seed).camera == again.camera
    assert random_scene(seed).light == again.light
    assert [v.pose(2.0) for v in random_scene(seed).vehicles] == [v.pose(2.0) for v in again.vehicles]
    assert random_scene(seed + 1).camera != again.camera


def test_cache_gives_back_the_same_samples(tmp_path, monkeypatch):
    first = make_samples(range(5, 6), 2, tmp_path)
    monkeypatch.setattr("vision.street_detector.scenes.scene_samples", None)  # must not render again
    second = make_samples(range(5, 6), 2, tmp_path)
    assert first.frames == second.frames
    assert first.backgrounds == second.backgrounds
    for a, b in zip(first.boxes, second.boxes, strict=True):
        np.testing.assert_array_equal(a, b)


def test_loss_falls_in_a_short_training(street):
    torch.set_num_threads(1)
    _, losses = train(street, steps=16, size=2)
    assert np.isfinite(losses).all()
    assert np.mean(losses[-5:]) < 0.85 * np.mean(losses[:3])


def test_training_repeats_by_seed(street):
    torch.set_num_threads(1)
    assert train(street, steps=2, size=1)[1] == train(street, steps=2, size=1)[1]
    assert train(street, steps=2, size=1)[1] != train(street, steps=2, size=1, seed=1)[1]


def test_exported_graph_computes_what_the_network_does(tmp_path):
    torch.manual_seed(0)
    net = StreetNet().eval()
    save_onnx(net, tmp_path / "net.onnx", 0.3)
    picture = np.random.default_rng(0).integers(0, 255, (384, 640, 3), np.uint8)
    detect = onnx_detector(tmp_path / "net.onnx", floor=0.0)
    rgb = torch.from_numpy(picture[..., ::-1].copy()).permute(2, 0, 1)[None] / 255
    with torch.no_grad():
        expected = Decoded(net)(rgb, torch.zeros_like(rgb))[0].numpy()
    found = detect(picture, np.zeros_like(picture))
    np.testing.assert_allclose(found[:20, :5], expected[:20, :5], atol=2e-2)
    assert (np.diff(found[:, 4]) <= 0).all()


def test_targets_decode_to_their_boxes():
    truth = np.float32([[40, 20, 120, 80, 3, 1.0], [200, 100, 230, 118, 0, 0.9]])
    targets = make_targets([truth], 64, 96)
    centers = np.argwhere(targets.heat[0].numpy() == 1)
    decoded = sides_to_boxes(log_sides(targets.boxes))[0].numpy()
    assert centers.tolist() == [[12, 20], [27, 53]]
    for (row, column), wanted in zip(centers, truth, strict=True):
        np.testing.assert_allclose(decoded[:, row, column], wanted[:4], atol=1e-3)
        assert targets.kinds[0, row, column] == wanted[4]
    assert float(targets.weight.sum()) == pytest.approx(1.0 + 18 / FULL, abs=1e-5)


def test_hidden_and_tiny_vehicles_are_neither_asked_nor_punished():
    truth = np.float32([[40, 20, 120, 80, 3, 0.1], [200, 100, 203, 103, 0, 1.0]])
    targets = make_targets([truth], 64, 96)
    assert targets.heat.max() == 0
    assert targets.counted[0, 10, 20] == 0
    assert targets.counted[0, 25, 50] == 0
    assert targets.counted[0, 40, 5] == 1


def test_perfect_maps_have_almost_no_loss():
    truth = np.float32([[40, 20, 120, 80, 2, 1.0]])
    targets = make_targets([truth], 64, 96)
    maps = torch.zeros(1, 9, 64, 96)
    maps[:, 0] = torch.logit(targets.heat.clamp(1e-4, 1 - 1e-4))
    maps[:, 1:5] = log_sides(targets.boxes)
    maps[:, 5 + 2] = 12.0
    worse = maps.clone()
    worse[:, 1] += 0.5
    assert float(detection_loss(maps, targets)) < 1.0
    assert float(detection_loss(worse, targets)) > float(detection_loss(maps, targets)) + 0.2


def test_generalized_iou_of_known_boxes():
    a = torch.tensor([0.0, 0.0, 2.0, 2.0]).reshape(1, 4, 1, 1)
    b = torch.tensor([4.0, 0.0, 6.0, 2.0]).reshape(1, 4, 1, 1)
    assert float(generalized_iou(a, a)) == 1.0
    assert float(generalized_iou(a, b)) == pytest.approx(-4 / 12)


def test_crops_move_boxes_with_their_pixels():
    """A white square on black stays inside its box through zoom, flip and cut."""
    frame = np.zeros((360, 640, 3), np.uint8)
    frame[100:160, 300:380] = 255
    samples = Samples([encoded(frame, 100)], [encoded(0 * frame, 100)], [np.float32([[300, 100, 380, 160, 0, 1.0]])])
    rng = np.random.default_rng(0)
    seen = 0
    for _ in range(20):
        picture, _, truth = crop(samples, 0, rng)
        if len(truth) and truth[0, 5] > 0.5:
            bright = np.argwhere(picture.mean(2) > 0.8 * picture.max())  # the gray beside the frame is darker
            ends = np.concatenate([bright.min(0)[::-1], bright.max(0)[::-1] + 1])
            np.testing.assert_allclose(ends, truth[0, :4], atol=1.6)
            seen += 1
    assert seen > 5


def test_a_box_cut_by_the_crop_counts_as_less_visible():
    move = np.array([[1.0, 0.0, -50.0], [0.0, 1.0, 0.0]])
    cut = moved(np.float32([[0, 0, 100, 50, 1, 0.8], [0, 0, 40, 40, 0, 1.0]]), move)
    assert cut.shape == (1, 6)
    np.testing.assert_allclose(cut[0], [0, 0, 50, 50, 1, 0.4], atol=1e-5)
    assert CROP[0] % (8 * STRIDE) == CROP[1] % (8 * STRIDE) == 0


def test_average_precision_of_a_known_ranking():
    hits = np.array([True, False, True])
    assert average_precision(hits, np.array([0.9, 0.8, 0.7]), 2) == pytest.approx(0.5 + 0.5 * 2 / 3)
    assert average_precision(hits[::-1], np.array([0.7, 0.8, 0.9]), 2) == pytest.approx(0.5 + 0.5 * 2 / 3)


def test_a_vehicle_is_found_once_and_hidden_ones_do_not_count():
    truth = np.array([[0, 0, 20, 20, 0, 1.0], [50, 0, 80, 20, 1, 0.2]])
    detections = np.array(
        [[0, 0, 20, 19, 0.9, 0], [0, 1, 20, 20, 0.8, 0], [50, 0, 80, 20, 0.7, 1], [200, 0, 230, 20, 0.6, 1]], float
    )
    found = matched(detections, truth)
    assert [m.truth is not None for m in found] == [True, False, False, False]
    assert [m.ignored for m in found] == [False, False, True, False]
    assert CLASSES[found[0].kind] == "car"
