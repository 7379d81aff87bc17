"""Bias and sigma of the reference point, against the renderer's truth.

    python benchmarks/ground.py --vehicles 40
    python benchmarks/ground.py --vehicles 8 --model nanodet --model yolox_nano.onnx

The scene's vehicles are meshes (several bodies a class, sizes drawn from the class's spread), so neither their outlines
nor their sizes are those the fit assumes. Boxes are their pictures' bounds, cut at the image's border, with edges that
jitter from frame to frame and, for every vehicle, lie off by the same few percent, as detectors draw them. Prints per
view and class: bias and standard deviation of the ground point along and across the way, m; the median sigma stated;
the root mean square of error / sigma (1 is honest); and the root mean square error of the middle of the box's lower
edge, which is what most tools take. With `--model`, boxes are those that detectors draw on the rendered frames, 5 a
second, and the table is by the face that is seen; along is positive where a vehicle is put ahead of where it is.
"""

import argparse

import numpy as np
import pandas as pd

from vision.body_fit import OUT
from vision.boxes import overlap
from vision.camera import Calibration
from vision.detectors import Detector, load_detector
from vision.ground_track import ground_tracks
from vision.interpolate import BOX
from vision.scene import SIZES, Camera, Light, Scene, SceneVehicle, render
from vision.scene.drawing import seen_faces
from vision.scene.render import present
from vision.vehicles import SHAPES

SIZE = (1280, 720)
VIEWS = {
    "across, mast": Camera.looking_at((20.0, 18.0, -13.0), (24.0, 0.0), 80.0, SIZE),
    "oblique, mast": Camera.looking_at((0.0, 16.0, -12.0), (35.0, 0.0), 65.0, SIZE),
    "along, bridge": Camera.looking_at((-20.0, 3.0, -8.0), (30.0, 0.0), 50.0, SIZE),
}
RATE, SECONDS = 25.0, 8.0
JITTER, PIXEL = 0.015, 0.7  # sd of an edge from frame to frame, sizes of the box and px
HABIT, GROWN = 0.04, 0.04  # and of what an edge, and what all edges together, have in all frames of a vehicle, sizes
LOOKS = 5  # of every so many frames one is rendered for a detector
FOUND = 0.4  # overlap of a box that is the vehicle's


def drive(
    camera: Camera,
    kind: str,
    rng: np.random.Generator,
    size: list[float] | None = None,
    detector: Detector | None = None,
) -> pd.DataFrame:
    """Boxes of one vehicle that drives by, with its true ground point; its size, m, is one of its class if None.

    They err as a detector's do, or are those that a detector draws.
    """
    shape, direction = SHAPES[kind], rng.choice([-1.0, 1.0])
    size = rng.normal(shape.size, shape.deviation) if size is None else np.array(size)
    scale = np.array(SIZES[kind][:3]) / shape.size * size
    speed, y = direction * rng.uniform(6, 14), direction * rng.uniform(1.4, 2.1)
    start = -15.0 if direction > 0 else 65.0

    def pose(t: float) -> tuple[float, float, float]:
        return start + speed * t, y, 0.0 if direction > 0 else np.pi

    vehicle = SceneVehicle(kind, pose, length=scale[0], width=scale[1], height=scale[2], style=int(rng.integers(9)))
    scene = Scene(camera, light=Light(), vehicles=(vehicle,))
    rows = []
    for frame in range(round(SECONDS * RATE)):
        for _, _, place in present(scene, frame / RATE):
            faces = seen_faces(camera, scene.light, vehicle, place, 1.0).outlines
            corners = np.concatenate([outline for outline in faces if len(outline) > 2] or [np.zeros((1, 2))])
            box = np.clip(np.concatenate([corners.min(0), corners.max(0)]), 0, [*SIZE, *SIZE])
            if min(box[2:] - box[:2]) > 12:
                rows.append([frame, *box, place[0], place[1]])
    table = pd.DataFrame(rows, columns=["frame", *BOX, "x_true", "y_true"]).assign(
        track_id=1, confidence=0.9, interpolated=False, way=direction, **{"class": kind}
    )
    table["time"] = table["frame"] / RATE
    if detector:
        return drawn(detector, scene, table[table["frame"] % LOOKS == 0].reset_index(drop=True))
    boxes = table[BOX].to_numpy()
    side = np.sqrt(np.prod(boxes[:, 2:] - boxes[:, :2], axis=1))[:, None]
    habit = rng.normal(0, HABIT, 4) + rng.normal(0, GROWN) * OUT
    error = rng.normal(0, 1, boxes.shape) * (JITTER * side + PIXEL) + habit * side
    inside = (boxes > 0) & (boxes < np.tile(SIZE, 2))
    table[BOX] = boxes + error * inside
    return table


def drawn(detector: Detector, scene: Scene, table: pd.DataFrame) -> pd.DataFrame:
    """Rows of a vehicle that a detector finds in the rendered frames, with the boxes that it draws."""
    found = [detector.detect(render(scene, time)).box for time in table["time"]]
    near = [overlap(box[None], boxes)[0] for box, boxes in zip(table[BOX].to_numpy(float), found, strict=True)]
    seen = np.array([share.max(initial=0.0) >= FOUND for share in near], bool)
    best = [boxes[share.argmax()] for boxes, share, here in zip(found, near, seen, strict=True) if here]
    return table[seen].assign(**dict(zip(BOX, np.reshape(best, (-1, 4)).T, strict=True))).reset_index(drop=True)


def errors(camera: Camera, kind: str, seed: int, detector: Detector | None = None) -> pd.DataFrame:
    """Errors of one vehicle's fixes along and across its way, m, their sigmas, and those of the box's lower edge."""
    view = Calibration(image_size=SIZE, homography=camera.ground_homography())
    table = drive(camera, kind, np.random.default_rng([seed, 23]), detector=detector)
    found, _ = ground_tracks(table, view)
    lower = np.stack([(found[BOX[0]] + found[BOX[2]]) / 2, found[BOX[3]]], axis=1)
    edge = view.to_ground(lower) - found[["x_true", "y_true"]]
    return pd.DataFrame(
        {
            "vehicle": seed,
            "face": np.where(found["way"] > 0, "rear", "front"),
            "along": (found["x"] - found["x_true"]) * found["way"],
            "across": (found["y"] - found["y_true"]) * found["way"],
            "sigma_along": found["sigma_x"],
            "sigma_across": found["sigma_y"],
            "edge_along": edge["x_true"] * found["way"],
            "edge_across": edge["y_true"] * found["way"],
        }
    )


def summary(found: pd.DataFrame) -> dict[str, float]:
    """Bias, spread, stated sigma and honesty."""
    result = {}
    for axis in ("along", "across"):
        result |= {
            f"{axis}: bias": found[axis].mean(),
            "sd": found[axis].std(),
            "sigma": found[f"sigma_{axis}"].median(),
            "rms/sigma": np.sqrt(((found[axis] / found[f"sigma_{axis}"]) ** 2).mean()),
            "lower edge": np.sqrt((found[f"edge_{axis}"] ** 2).mean()),
        }
        result = {name if ":" in name else f"{axis}: {name}": value for name, value in result.items()}
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=40, help="of each class in each view")
    parser.add_argument("--model", action="append", default=[], help="built-in detector or .onnx file")
    options = parser.parse_args()
    models = {name: load_detector(name) for name in options.model}
    parts = [
        errors(camera, kind, seed, detector).assign(**{"view": view, "class": kind, "boxes": name})
        for name, detector in (models or {"as detectors err": None}).items()
        for view, camera in VIEWS.items()
        for kind in SIZES
        for seed in range(options.vehicles)
    ]
    by = ["boxes", "class", "face"] if options.model else ["view", "class"]
    rows = {key: summary(found) for key, found in pd.concat(parts).groupby(by, sort=False)}
    print(pd.DataFrame(rows).T.rename_axis(by).round(3).to_string())


if __name__ == "__main__":
    main()
