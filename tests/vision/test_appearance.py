import cv2
import numpy as np
import pandas as pd
import pytest
from onnx import TensorProto, checker, helper, save

from benchmarks.embedding import write_color_histogram
from vision.appearance import Appearance
from vision.contract import InputError
from vision.interpolate import BOX
from vision.quality import score_tracks
from vision.scene import Camera, Light, Scene, SceneVehicle, Street, render, truth_boxes
from vision.tracker import Tracker

RED, BLUE = (30, 30, 220), (220, 60, 30)


def write_mean_color(path, batch=1, shape=(16, 32), rank=2):
    """An embedding that answers the mean color of the image."""
    nodes = [helper.make_node("GlobalAveragePool", ["image"], ["pooled"])]
    nodes.append(
        helper.make_node("Flatten", ["pooled"], ["v"]) if rank == 2 else helper.make_node("Relu", ["pooled"], ["v"])
    )
    out = helper.make_tensor_value_info("v", TensorProto.FLOAT, [batch, 3] if rank == 2 else [batch, 3, 1, 1])
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [batch, 3, *shape])
    model = helper.make_model(
        helper.make_graph(nodes, "g", [image], [out]), opset_imports=[helper.make_opsetid("", 17)]
    )
    model.ir_version = 8
    checker.check_model(model)
    save(model, path)
    return path


def street(*cars):
    """A gray image with cars of (left, color), and their boxes."""
    image = np.full((120, 700, 3), 90, np.uint8)
    boxes = np.array([[left, 40.0, left + 60, 80.0] for left, _ in cars]).reshape(-1, 4)
    for left, color in cars:
        cv2.rectangle(image, (round(left), 40), (round(left) + 60, 80), color, -1)
    return image, boxes


@pytest.mark.parametrize(("batch", "shape"), [(1, (16, 32)), ("n", ("h", "w"))])
def test_colors_are_told_apart(tmp_path, batch, shape):
    looks = Appearance.load(write_mean_color(tmp_path / "m.onnx", batch, shape))
    image, boxes = street((20, RED), (200, BLUE), (400, RED))
    found = looks.embed(image, np.concatenate([boxes, [[690.0, 0, 900, 50], [-80, 0, -2, 50]]]))
    np.testing.assert_allclose(np.linalg.norm(found[:4], axis=1), 1.0)
    likeness = found @ found.T
    assert likeness[0, 2] > 0.999 and likeness[0, 1] < 0.3
    assert (found[4] == 0).all(), "nothing of it is inside the image"
    red, green, blue = (np.array(RED[::-1]) / 255 - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    expected = np.array([red, green, blue])
    np.testing.assert_allclose(found[0], expected / np.linalg.norm(expected), atol=0.03)


def test_nothing_to_look_at(tmp_path):
    looks = Appearance.load(write_mean_color(tmp_path / "m.onnx"))
    assert len(looks.embed(np.zeros((50, 50, 3), np.uint8), np.zeros((0, 4)))) == 0


def follow(appearance):
    """A red car goes behind a wall for 2 s; a blue one comes out where it would, then the red one, slower."""
    tracker, numbers = Tracker(), {"red": [], "blue": []}
    for k in range(200):
        t = k * 0.04
        cars = []
        if t < 2:
            cars.append(("red", 20 + 60 * t, RED))
        if 4 < t < 6:
            cars.append(("blue", 20 + 60 * t, BLUE))
        if t > 4.3:
            cars.append(("red", 20 + 60 * (t - 0.9), RED))
        image, boxes = street(*((left, color) for _, left, color in cars))
        looks = appearance.embed(image, boxes) if appearance else None
        for (name, *_), number in zip(cars, tracker.update(t, boxes, np.full(len(boxes), 0.9), looks), strict=True):
            numbers[name].append(int(number))
    return {name: sorted(set(found)) for name, found in numbers.items()}


def test_a_hidden_vehicle_is_known_again_by_its_looks(tmp_path):
    assert follow(None) == {"red": [1, 3], "blue": [2]}
    assert follow(Appearance.load(write_mean_color(tmp_path / "m.onnx"))) == {"red": [1], "blue": [2]}


HIDDEN = (24.0, 34.0)  # m along the road, behind a truck that is parked before the camera, say


def waiting(begin):
    """Drive at 9 m/s, but stand for 1.2 s where nobody sees it."""

    def pose(t):
        way = 9 * (t - begin)
        return 4 + way - np.clip(way - 25, 0, 10.8), 1.75, 0.0

    return pose


def leaving(begin):
    """Set out from a place where nobody sees it."""
    return lambda t: (29 + 9 * max(t - begin, 0.0), 1.75, 0.0)


def test_rendered_vehicles_are_known_again_behind_an_occlusion(tmp_path):
    """Whoever comes out where one that went in was expected is another; that one comes later."""
    looks = Appearance.load(write_color_histogram(tmp_path / "m.onnx"))
    red, blue, white, green = (30, 30, 190), (170, 70, 20), (225, 225, 225), (60, 150, 40)
    vehicles = (
        SceneVehicle("car", waiting(0.0), red),
        SceneVehicle("car", leaving(2.8), blue),
        SceneVehicle("van", waiting(4.0), white),
        SceneVehicle("car", leaving(6.8), green),
    )
    camera = Camera.looking_at((29.0, -30.0, -8.0), (29.0, 2.0), 70.0, (480, 270))
    scene = Scene(camera, Street(), Light(), vehicles, seed=3)
    rows = {name: [] for name in ("truth", "motion", "looks")}
    trackers = {"motion": Tracker(), "looks": Tracker()}
    for frame in range(130):
        t = frame * 0.08
        truth, image = truth_boxes(scene, t), render(scene, t)
        seen = (truth.ground[:, 0] < HIDDEN[0]) | (truth.ground[:, 0] > HIDDEN[1])
        boxes, whole = truth.boxes[seen], truth.visibility[seen] > 0.4
        boxes = boxes[whole]
        rows["truth"] += [[frame, name, *box] for name, box in zip(truth.index[seen][whole], boxes, strict=True)]
        for name, tracker in trackers.items():
            vectors = looks.embed(image, boxes) if name == "looks" else None
            numbers = tracker.update(t, boxes, np.full(len(boxes), 0.9), vectors)
            rows[name] += [[frame, number, *box] for number, box in zip(numbers, boxes, strict=True)]
    tables = {name: pd.DataFrame(found, columns=["frame", "track_id", *BOX]) for name, found in rows.items()}
    scores = {name: score_tracks(tables["truth"], tables[name]).rounded()["idf1"] for name in trackers}
    assert scores["motion"] < 0.85 and scores["looks"] > 0.95


def test_what_is_not_an_embedding_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Appearance.load(tmp_path / "none.onnx")
    with pytest.raises(InputError, match=r"answers \[1, 3, 1, 1\]"):
        Appearance.load(write_mean_color(tmp_path / "m.onnx", rank=4))
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(InputError, match="not an ONNX model"):
        Appearance.load(tmp_path / "text.onnx")
