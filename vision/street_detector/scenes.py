"""Random streets and cameras: the detector's training pictures."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, progress
from vision.scene import PAINTS, SIZES, Camera, Light, Scene, SceneVehicle, Street, render, truth_boxes
from vision.scene.vehicles import Pose
from vision.street_detector.model import CLASSES

Pictures = cv2.typing.MatLike
SIZE = (640, 360)  # px


@dataclass(frozen=True)
class Samples:
    """Frames with truth. Row k of every array is one frame.

    Attributes
    ----------
    frames : [n] JPEG bytes
    backgrounds : [n] JPEG bytes, the median of the frame's scene
    boxes : [n] arrays [k, 6]: x1, y1, x2, y2 (px), class index, visibility
    """

    frames: list[bytes]
    backgrounds: list[bytes]
    boxes: list[NDArray[np.float32]]

    def picture(self, k: int) -> tuple[Pictures, Pictures]:
        """Frame and background `k`, [height, width, 3] BGR."""
        return decoded(self.frames[k]), decoded(self.backgrounds[k])


def decoded(jpeg: bytes) -> Pictures:
    """JPEG bytes -> [height, width, 3] BGR."""
    return np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def encoded(picture: Pictures, quality: int) -> bytes:
    """Picture -> JPEG bytes; the loss stands for a video's."""
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())


def random_camera(rng: np.random.Generator, street: Street) -> Camera:
    """Draw a camera 4-14 m high, from the middle of the road to 22 m beside it, looking along or across it."""
    height, side = rng.uniform(4, 14), rng.choice([-1.0, 1.0])
    beside = rng.uniform(0, 22) if height > 5.5 else rng.uniform(street.curb, 16)
    ahead = rng.choice([-1.0, 1.0]) * rng.uniform(0.25, 1) * rng.uniform(20, 55)
    x = rng.uniform(20, 140)
    camera = Camera.looking_at((x, side * beside, -height), (x + ahead, rng.uniform(-5, 5)), rng.uniform(42, 92), SIZE)
    return Camera(
        camera.position, camera.yaw, camera.pitch + rng.uniform(-4, 3), camera.focal, SIZE, rng.normal(0, 1.5)
    )


def random_light(rng: np.random.Generator) -> Light:
    """Draw a light from overcast to a low, clear sun."""
    return Light(
        azimuth=rng.uniform(-180, 180),
        elevation=rng.uniform(14, 75),
        sun=float(np.clip(rng.uniform(-0.25, 1.1), 0, 1)),
        exposure=rng.uniform(0.65, 1.25),
        warmth=rng.uniform(0.94, 1.1),
        visibility=float(np.exp(rng.uniform(np.log(150), np.log(2000)))),
    )


def random_color(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw a paint near one of the usual."""
    b, g, r = np.clip(
        np.array(PAINTS[rng.integers(len(PAINTS))]) * rng.uniform(0.8, 1.15) + rng.normal(0, 8, 3), 5, 250
    )
    return float(b), float(g), float(r)


def random_vehicle(rng: np.random.Generator, street: Street, x: float, lane: int) -> SceneVehicle:
    """Draw a vehicle that is at `x` (m) in `lane` at t = 0 and keeps its own weave and speed."""
    cls = str(rng.choice(CLASSES, p=[0.42, 0.22, 0.19, 0.17]))
    usual, stretch = SIZES[cls], rng.normal(1, 0.06, 3).clip(0.85, 1.18)
    direction = 1.0 if street.lane_center(lane) > 0 else -1.0
    speed, drift = direction * rng.uniform(3, 20), rng.normal(0, 0.25)
    phase = rng.uniform(0, 6)

    def trajectory(t: float) -> Pose:
        y = street.lane_center(lane) + drift + 0.15 * np.sin(0.5 * t + phase)
        turn = 0.075 * np.cos(0.5 * t + phase) / speed
        return x + speed * t, float(y), float(turn + (np.pi if direction < 0 else 0.0))

    return SceneVehicle(
        cls,
        trajectory,
        random_color(rng),
        usual.length * stretch[0],
        usual.width * (1 + 0.5 * (stretch[1] - 1)),
        usual.height * stretch[2],
        int(rng.integers(100)),
    )


def traffic(rng: np.random.Generator, street: Street, middle: float) -> tuple[SceneVehicle, ...]:
    """Draw vehicles over 500 m about `middle` in every lane, from sparse to dense."""
    vehicles, headway = [], np.exp(rng.uniform(np.log(15), np.log(120)))
    for lane in range(street.lanes):
        x = middle - 250 + rng.uniform(0, headway)
        while x < middle + 250:
            vehicles.append(random_vehicle(rng, street, x, lane))
            x += 14 + rng.exponential(headway)
    return tuple(vehicles)


def parked(rng: np.random.Generator, street: Street, middle: float) -> tuple[SceneVehicle, ...]:
    """Draw up to eight cars parked on the sidewalks: they never move, so they are not truth."""
    found = []
    for _ in range(int(rng.integers(0, 9)) * int(rng.uniform() < 0.5)):
        pose = (middle + rng.uniform(-60, 60), rng.choice([-1, 1]) * (street.curb + 1.3), rng.choice([0, np.pi]))
        found.append(SceneVehicle("car", standing(pose), random_color(rng), style=int(rng.integers(9))))
    return tuple(found)


def standing(pose: Pose) -> Callable[[float], Pose]:
    """Return the trajectory of what stays at `pose`."""
    return lambda t: pose


def random_scene(seed: int) -> Scene:
    """Draw a whole scene; the same for the same seed."""
    rng = np.random.default_rng([seed, 2024])
    street = Street(
        lanes=int(rng.choice([2, 2, 2, 3, 4])),
        lane_width=rng.uniform(3.0, 3.8),
        shoulder=rng.uniform(0.2, 1.5),
        sidewalk=rng.uniform(1.5, 4.0),
        verge=rng.uniform(0.5, 6.0),
        dash=rng.uniform(2, 4),
        gap=rng.uniform(3, 8),
        marks=float(rng.choice([0.0, 9.0, 14.0])),
        trees=rng.uniform(0, 1),
        near_trees=rng.uniform(0, 0.5) * (rng.uniform() < 0.4),
        seed=int(rng.integers(1 << 30)),
    )
    camera = random_camera(rng, street)
    middle = camera.position[0]
    return Scene(
        camera,
        street,
        random_light(rng),
        traffic(rng, street, middle),
        parked(rng, street, middle),
        seed=int(rng.integers(1 << 30)),
        noise=rng.uniform(0.5, 6),
        flicker=rng.uniform(0, 0.04),
        shake=float(rng.choice([0.0, 0.0, 0.3, 0.8])),
    )


def photographed(scene: Scene, t: float, rng: np.random.Generator) -> bytes:
    """Frame at time `t` through a random lens blur and compression."""
    frame = render(scene, t)
    if rng.uniform() < 0.4:
        frame = cv2.GaussianBlur(frame, (0, 0), rng.uniform(0.4, 1.1))
    return encoded(frame, int(rng.integers(30, 96)))


def scene_samples(seed: int, frames: int) -> Samples:
    """Frames of one random scene at random times."""
    rng = np.random.default_rng([seed, 5])
    return sampled(random_scene(seed), rng.uniform(-9, 9, frames), rng)


def sampled(scene: Scene, times: NDArray[np.float64], rng: np.random.Generator, medians: int = 31) -> Samples:
    """Frames of a scene at `times`, s, and their background, the median of `medians` frames at random times."""
    others = [render(scene, t) for t in rng.uniform(-20, 20, medians)]
    background = encoded(np.median(others, axis=0).astype(np.uint8), int(rng.integers(60, 96)))
    rows = []
    for t in times:
        truth = truth_boxes(scene, t)
        kinds = np.array([CLASSES.index(label) for label in truth.labels], float)
        rows.append(np.column_stack([truth.boxes, kinds, truth.visibility]).astype(np.float32).reshape(-1, 6))
    frames = [photographed(scene, t, rng) for t in times]
    return Samples(frames, [background] * len(frames), rows)


def joined(parts: list[Samples]) -> Samples:
    """Chain the samples of several scenes."""
    whole = Samples([], [], [])
    for part in parts:
        whole.frames.extend(part.frames)
        whole.backgrounds.extend(part.backgrounds)
        whole.boxes.extend(part.boxes)
    return whole


def make_samples(seeds: range, frames: int, cache: Path | None = None) -> Samples:
    """Render `frames` frames of every scene in `seeds`; scenes found in the folder `cache` are read instead.

    >>> samples = make_samples(range(1), frames=1)
    >>> samples.picture(0)[0].shape
    (360, 640, 3)
    """
    parts = []
    with progress("rendering scenes", len(seeds)) as advance:
        for seed in seeds:
            parts.append(kept(seed, frames, cache) if cache else scene_samples(seed, frames))
            advance(1)
    return joined(parts)


def kept(seed: int, frames: int, cache: Path) -> Samples:
    """Samples of one scene from the folder `cache`, rendered into it at first."""
    file = cache / f"scene_{seed:05d}_{frames}.npz"
    if not file.exists():
        cache.mkdir(parents=True, exist_ok=True)
        samples = scene_samples(seed, frames)
        arrays: dict[str, Any] = {f"frame_{k}": np.frombuffer(f, np.uint8) for k, f in enumerate(samples.frames)}
        arrays |= {f"boxes_{k}": b for k, b in enumerate(samples.boxes)}
        arrays["background"] = np.frombuffer(samples.backgrounds[0], np.uint8)
        np.savez(file, **arrays)
        return samples
    with np.load(file) as data:
        if f"frame_{frames - 1}" not in data:
            raise InputError(f"{file}: not a cached scene; remove it")
        return Samples(
            [data[f"frame_{k}"].tobytes() for k in range(frames)],
            [data["background"].tobytes()] * frames,
            [data[f"boxes_{k}"] for k in range(frames)],
        )
