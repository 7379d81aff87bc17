"""The tracker against ByteTrack of the package `trackers`, on roadside scenes of ours whose truth is known.

The scenes are made, and our tracker is run, in this project's environment; ByteTrack and the reference scores in one of
their own, which the project does not depend on:

    python benchmarks/tracker.py scenes runs/mot --seeds 8
    python benchmarks/tracker.py looks runs/mot
    python benchmarks/tracker.py ours runs/mot
    python -m venv mot && mot/bin/pip install trackers trackeval
    mot/bin/python benchmarks/tracker.py bytetrack runs/mot
    mot/bin/python benchmarks/tracker.py reference runs/mot
    python benchmarks/tracker.py score runs/mot
    python benchmarks/tracker.py speed

`scenes` writes, per seed, MOTChallenge files `gt.txt` and `det.txt` and the frames' `times.txt`; the trackers write
`NAME.txt` beside them; `score` prints MOTA, IDF1 and HOTA by `vision.quality`, `reference` the same by TrackEval: they
must agree. All trackers are scored on tracks of at least
five fixes, which is what `roadfiber track` keeps.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

FRAMES, RATE = 500, 12.5
ROWS = "%d,%d,%.2f,%.2f,%.2f,%.2f,%.4f,%d,%.3f"
SHOWN = 0.1  # visible share of a vehicle from which the truth counts it
SMALLEST = 8  # px of its box's shorter side
FEWEST_FIXES = 5
BYTETRACK = {
    "bytetrack": {},
    "bytetrack-tuned": {"track_activation_threshold": 0.4, "high_conf_det_threshold": 0.4},
}


def street_scene(seed: int) -> Any:
    """Two to four lanes with trees before them, filmed along or across; drivers who follow, stop and go."""
    from vision.scene import SIZES, Camera, Light, Scene, SceneVehicle, Street

    rng = np.random.default_rng([seed, 17])
    street = Street(lanes=int(rng.choice([2, 4])), near_trees=0.5, seed=seed)
    side, height = rng.choice([-1.0, 1.0]), rng.uniform(6, 12)
    beside, ahead = (rng.uniform(8, 14), rng.uniform(25, 45)) if seed % 2 else (rng.uniform(14, 20), rng.uniform(0, 15))
    camera = Camera.looking_at((20.0, side * beside, -height), (20.0 + ahead, 0.0), rng.uniform(55, 85))
    vehicles = []
    for lane in range(street.lanes):
        y = street.lane_center(lane)
        direction, start = (1.0, -60.0) if y > 0 else (-1.0, 160.0)
        cruise, t = rng.uniform(6, 13), rng.uniform(-10, 0)
        while t < FRAMES / RATE:
            kind = str(rng.choice(list(SIZES), p=[0.6, 0.15, 0.15, 0.1]))
            vehicles.append(SceneVehicle(kind, driver(rng, start, y, direction, cruise, t), style=int(rng.integers(9))))
            t += rng.uniform(1.5, 6.0) + SIZES[kind].length / cruise
    return Scene(camera, street, Light(), tuple(vehicles), seed=seed)


def driver(rng: np.random.Generator, start: float, y: float, direction: float, cruise: float, begin: float) -> Any:
    """Motion of one vehicle: it enters at `begin`, s, weaves a little, and slows down around the middle of the view."""
    slow, middle, phase = rng.uniform(0.0, 0.55), rng.uniform(15, 35), rng.uniform(0, 6)

    def pose(t: float) -> tuple[float, float, float]:
        way = cruise * (t - begin)
        way -= slow * cruise * 4.0 * np.tanh((t - middle) / 4.0) if t > begin else 0.0
        return start + direction * way, y + 0.2 * np.sin(0.3 * t + phase), 0.0 if direction > 0 else np.pi

    return pose


def detections(truth: Any, rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """What a detector makes of a frame [n, 5]: left, top, right, bottom (px), score.

    Edges jitter with the size of the box; what is half hidden is often missed and scores low; some vehicles are seen
    twice, and some things are taken for vehicles.
    """
    found = []
    for box, shown in zip(truth.boxes, truth.visibility, strict=True):
        side = np.sqrt(np.prod(box[2:] - box[:2]))
        if min(box[2:] - box[:2]) < SMALLEST or rng.random() > 0.96 * np.clip(2.2 * shown - 0.2, 0, 1):
            continue
        score = float(np.clip(0.25 + 0.65 * shown + rng.normal(0, 0.12), 0.05, 0.98))
        found.append([*(box + rng.normal(0, 0.03 * side + 0.7, 4)), score])
        if rng.random() < 0.03:
            found.append([*(box + rng.normal(0, 0.15 * side, 4)), 0.5 * score])
    for _ in range(rng.poisson(0.3)):
        middle, half = rng.uniform([0, 0.3 * size[1]], size), rng.uniform(8, 40, 2)
        found.append([*(middle - half), *(middle + half), float(rng.beta(2, 4))])
    return np.array(found).reshape(-1, 5)


def write_scenes(folder: Path, seeds: int) -> None:
    """Write the truth and the detections of every scene."""
    from vision.contract import progress
    from vision.scene import truth_boxes

    with progress("scenes", seeds * FRAMES) as advance:
        for seed in range(seeds):
            scene, rng = street_scene(seed), np.random.default_rng([seed, 19])
            times = np.cumsum(rng.choice([1.0, 2.0], FRAMES, p=[0.95, 0.05])) / RATE  # some frames are dropped
            true, seen = [], []
            for frame, t in enumerate(times, start=1):
                truth = truth_boxes(scene, float(t))
                for box, shown, number in zip(truth.boxes, truth.visibility, truth.index, strict=True):
                    if shown >= SHOWN and min(box[2:] - box[:2]) >= SMALLEST:
                        true.append([frame, number + 1, *box[:2], *(box[2:] - box[:2]), 1, 1, shown])
                for row in detections(truth, rng, scene.camera.size):
                    seen.append([frame, -1, *row[:2], *(row[2:4] - row[:2]), row[4], -1, -1])
                advance(1)
            place = folder / f"scene-{seed}"
            place.mkdir(parents=True, exist_ok=True)
            np.savetxt(place / "gt.txt", true, fmt=ROWS)
            np.savetxt(place / "det.txt", seen, fmt=ROWS)
            np.savetxt(place / "times.txt", times, fmt="%.6f")


def write_looks(folder: Path) -> None:
    """Write what the detections of every scene look like, in their order [n, d]."""
    from embedding import write_color_histogram

    from vision.appearance import Appearance
    from vision.contract import progress
    from vision.scene import render

    places = scenes_in(folder)
    appearance = Appearance.load(write_color_histogram(folder / "color_histogram.onnx"))
    with progress("looks", len(places) * FRAMES) as advance:
        for place in places:
            scene, looks = street_scene(int(place.name.removeprefix("scene-"))), []
            for t, boxes, _ in frames_of(place):
                looks.append(appearance.embed(render(scene, t), boxes))
                advance(1)
            np.save(place / "looks.npy", np.concatenate([found for found in looks if len(found)]).astype(np.float32))


def looks_of(place: Path, frames: list[tuple[float, np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """What the detections of every frame look like [n, d]."""
    return np.split(np.load(place / "looks.npy").astype(float), np.cumsum([len(boxes) for _, boxes, _ in frames])[:-1])


def frames_of(place: Path) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Time, s, boxes [n, 4] and scores [n] of every frame of a scene."""
    rows = np.loadtxt(place / "det.txt", delimiter=",")
    boxes = np.concatenate([rows[:, 2:4], rows[:, 2:4] + rows[:, 4:6]], axis=1)
    times = np.loadtxt(place / "times.txt")
    parts = [rows[:, 0] == frame for frame in range(1, len(times) + 1)]
    return [(float(t), boxes[part], rows[part, 6]) for t, part in zip(times, parts, strict=True)]


def write_tracks(path: Path, tracks: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Write (numbers, boxes, scores) of every frame; numbers below 1 are not tracks."""
    fixes = np.bincount(np.concatenate([np.maximum(found[0], 0) for found in tracks]).astype(int))
    rows = [
        [frame, number, *box[:2], *(box[2:] - box[:2]), score, -1, -1]
        for frame, found in enumerate(tracks, start=1)
        for number, box, score in zip(*found, strict=True)
        if number > 0 and fixes[number] >= FEWEST_FIXES
    ]
    np.savetxt(path, rows, fmt=ROWS)


def run_ours(folder: Path) -> None:
    """Track with this project's tracker, by motion alone and, where `looks` was run, by looks too."""
    from vision.tracker import Tracker

    for place in scenes_in(folder):
        tracker, frames = Tracker(), frames_of(place)
        write_tracks(place / "roadfiber.txt", [(tracker.update(*frame), frame[1], frame[2]) for frame in frames])
        if (place / "looks.npy").exists():
            seer, looks = Tracker(), looks_of(place, frames)
            found = [seer.update(*frame, look) for frame, look in zip(frames, looks, strict=True)]
            tracks = [(numbers, frame[1], frame[2]) for numbers, frame in zip(found, frames, strict=True)]
            write_tracks(place / "roadfiber-looks.txt", tracks)


def run_bytetrack(folder: Path) -> None:
    """Track with ByteTrack of `trackers`, as it comes and with our threshold."""
    import supervision
    import trackers

    for place in scenes_in(folder):
        for name, options in BYTETRACK.items():
            tracker, tracks = trackers.ByteTrackTracker(frame_rate=RATE, **options), []
            for t, boxes, scores in frames_of(place):
                found = supervision.Detections(boxes, confidence=scores, class_id=np.zeros(len(boxes), int))
                found = tracker.update(found, timestamp=t)
                numbers = np.full(len(found), -1) if found.tracker_id is None else found.tracker_id
                tracks.append((numbers + 1, found.xyxy, found.confidence))
            write_tracks(place / f"{name}.txt", tracks)


def scenes_in(folder: Path) -> list[Path]:
    """Folders of the scenes."""
    return sorted(folder.glob("scene-*"))


def names_in(folder: Path) -> list[str]:
    """Names of the trackers that were run on all scenes."""
    places = scenes_in(folder)
    known = {path.stem for path in places[0].glob("*.txt")} - {"gt", "det", "times"}
    return sorted(name for name in known if all((place / f"{name}.txt").exists() for place in places))


def score(folder: Path) -> None:
    """Print our scores of every tracker, scene by scene and in the mean."""
    import pandas as pd

    from vision.exchange import read_mot
    from vision.quality import score_tracks

    rows = [
        {"scene": place.name, "tracker": name}
        | score_tracks(read_mot(place / "gt.txt"), read_mot(place / f"{name}.txt")).rounded()
        for place in scenes_in(folder)
        for name in names_in(folder)
    ]
    table = pd.DataFrame(rows)
    print(table.pivot(index="scene", columns="tracker", values=["mota", "idf1", "hota"]).to_string())
    print(table.drop(columns="scene").groupby("tracker").mean().round(4).to_string())


def reference(folder: Path) -> None:
    """Print the scores that TrackEval gives."""
    from trackeval.metrics import CLEAR, HOTA, Identity

    silent: dict[str, Any] = {"PRINT_CONFIG": False}
    for name in names_in(folder):
        rows = []
        for place in scenes_in(folder):
            data = paired(np.loadtxt(place / "gt.txt", delimiter=","), np.loadtxt(place / f"{name}.txt", delimiter=","))
            clear, identity = (metric(silent).eval_sequence(data) for metric in (CLEAR, Identity))
            rows.append([clear["MOTA"], identity["IDF1"], HOTA().eval_sequence(data)["HOTA"].mean(), clear["IDSW"]])
            print("{} {} mota {:.4f} idf1 {:.4f} hota {:.4f} switches {:.0f}".format(place.name, name, *rows[-1]))
        print("mean {} mota {:.4f} idf1 {:.4f} hota {:.4f} switches {:.1f}".format(name, *np.mean(rows, axis=0)))


def paired(true: np.ndarray, found: np.ndarray) -> dict[str, Any]:
    """Rows of two MOTChallenge files as TrackEval takes them."""
    sides: list[list[Any]] = [[], []]
    similarity = []
    numbers = [np.unique(rows[:, 1], return_inverse=True)[1] for rows in (true, found)]
    for frame in np.union1d(true[:, 0], found[:, 0]):
        boxes = []
        for rows, number, side in zip((true, found), numbers, sides, strict=True):
            here = rows[:, 0] == frame
            side.append(number[here])
            boxes.append(np.concatenate([rows[here, 2:4], rows[here, 2:4] + rows[here, 4:6]], axis=1))
        low = np.maximum(boxes[0][:, None, :2], boxes[1][None, :, :2])
        high = np.minimum(boxes[0][:, None, 2:], boxes[1][None, :, 2:])
        common = np.maximum(high - low, 0).prod(axis=2)
        areas = [np.prod(part[:, 2:] - part[:, :2], axis=1) for part in boxes]
        similarity.append(common / (areas[0][:, None] + areas[1] - common))
    return {
        "gt_ids": sides[0],
        "tracker_ids": sides[1],
        "similarity_scores": similarity,
        "num_gt_ids": numbers[0].max() + 1,
        "num_tracker_ids": numbers[1].max() + 1,
        "num_gt_dets": len(true),
        "num_tracker_dets": len(found),
        "num_timesteps": len(similarity),
    }


def speed(boxes: int = 20, frames: int = 1000) -> None:
    """Print how many frames of 20 boxes the tracker takes per second of one core, best of three."""
    from vision.tracker import Tracker

    rng = np.random.default_rng(0)
    start, rate, lane = rng.uniform(0, 1000, boxes), rng.uniform(-200, 200, boxes), rng.uniform(50, 600, boxes)
    film = []
    for t in np.arange(frames) / 25:
        x = (start + rate * t) % 1200
        edges = np.stack([x - 20, lane - 15, x + 20, lane + 15], 1) + rng.normal(0, 1, (boxes, 4))
        film.append((float(t), edges, rng.uniform(0.2, 0.95, boxes)))
    best = 0.0
    for _ in range(3):
        tracker, begun = Tracker(), time.process_time()
        for frame in film:
            tracker.update(*frame)
        best = max(best, frames / (time.process_time() - begun))
    print(f"{best:.0f} frames of {boxes} boxes per second of one core")


def main() -> None:
    """Run one step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = {"looks": write_looks, "ours": run_ours, "bytetrack": run_bytetrack, "reference": reference, "score": score}
    parser.add_argument("step", choices=["scenes", *steps, "speed"])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("runs/mot"))
    parser.add_argument("--seeds", type=int, default=8)
    options = parser.parse_args()
    if options.step == "scenes":
        write_scenes(options.folder, options.seeds)
    elif options.step == "speed":
        speed()
    else:
        steps[options.step](options.folder)


if __name__ == "__main__":
    main()
