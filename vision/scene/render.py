"""Frames of the street with its vehicles."""

from dataclasses import dataclass, field
from functools import cached_property, cmp_to_key, lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from vision.scene.backdrop import LampPost, Painter, Thing, Tree, furnish, ground, static_shadows
from vision.scene.camera import Camera
from vision.scene.drawing import cast_shadow, draw_faces, seen_faces
from vision.scene.light import Light
from vision.scene.street import HALF_WIDTH, RESOLUTION, Image, Orthophoto, Street
from vision.scene.vehicles import Pose, SceneVehicle

FAR = 400.0  # m; vehicles beyond are not drawn
FINER = 2  # the picture is drawn this many times finer and averaged: smooth edges


@dataclass(frozen=True)
class Scene:
    """A street, the camera that looks at it, its light and its vehicles.

    Parameters
    ----------
    camera, street, light : see there
    vehicles : those that move
    parked : those that stand still the whole time (part of the background, not of the truth)
    seed : decides noise, flicker and shake
    noise : standard deviation of the sensor noise, levels of 255
    flicker : relative size of slow changes of the light
    shake : standard deviation of the camera's shake, px
    """

    camera: Camera
    street: Street = field(default_factory=Street)
    light: Light = field(default_factory=Light)
    vehicles: tuple[SceneVehicle, ...] = ()
    parked: tuple[SceneVehicle, ...] = ()
    seed: int = 0
    noise: float = 2.5
    flicker: float = 0.01
    shake: float = 0.0

    @cached_property
    def still(self) -> "Still":
        """What does not move, drawn once for all scenes that share it."""
        return still_street(self.camera, self.street, self.light, self.parked)

    @cached_property
    def grain(self) -> Image:
        """Sensor noise, see `noise_tile`."""
        return noise_tile(self)

    def wave(self, t: float, stream: int) -> float:
        """Smooth noise of unit spread at time `t`, s: four sines of random phase and rate (0.05-3 Hz)."""
        rng = np.random.default_rng([self.seed, 7, stream])
        rates, phases = np.geomspace(0.05, 3, 4) * rng.uniform(0.7, 1.3, 4), rng.uniform(0, 2 * np.pi, 4)
        return float(np.sin(2 * np.pi * rates * t + phases).sum() / np.sqrt(2))

    def shift(self, t: float) -> tuple[float, float]:
        """Displacement of the picture by the camera's shake, px."""
        return self.shake * self.wave(t, 1), self.shake * self.wave(t, 2)


@dataclass(frozen=True)
class Still:
    """Everything that stands still, at the finer scale: picture, what hides vehicles, sunlit ground."""

    picture: Image
    foreground: Image
    sunlit: Image


@lru_cache(maxsize=4)
def still_street(camera: Camera, street: Street, light: Light, parked: tuple[SceneVehicle, ...]) -> Still:
    """Draw the street without moving vehicles."""
    camera = camera.scaled(FINER)
    ortho = Orthophoto(street)
    things = furnish(street, camera)
    sunlit = static_shadows(ortho, things, light) if light.sun else np.ones(ortho.shape, np.float32)
    picture = ground(camera, light, ortho, sunlit)
    painter = Painter(camera, light, picture)
    inside = abs(camera.position[1]) < street.curb
    things.sort(key=lambda thing: -np.hypot(*(thing.middle - camera.position[:2])))
    for thing in things:
        if inside or not hides_road(thing, camera):
            painter.draw(thing)
    for vehicle in sorted(parked, key=lambda v: -np.hypot(*(np.array(v.pose(0)[:2]) - camera.position[:2]))):
        cast_shadow(picture, camera, light, vehicle, vehicle.pose(0.0), 1.0)
        draw_faces(picture, seen_faces(camera, light, vehicle, vehicle.pose(0.0), 1.0))
    bare = picture.copy()
    for thing in things:
        if not inside and hides_road(thing, camera):
            painter.draw(thing)
    return Still(picture, 255 * (picture != bare).any(2).astype(np.uint8), sunlit)


def hides_road(thing: Thing, camera: Camera) -> bool:
    """Whether a thing may stand between the camera and the road: posts and trees on the camera's side."""
    return isinstance(thing, Tree | LampPost) and bool(thing.middle[1] * camera.position[1] > 0)


def noise_tile(scene: Scene) -> Image:
    """Sensor noise about 128 [height + 64, width + 64, 3], shared by the frames at random offsets."""
    width, height = scene.camera.size
    rng = np.random.default_rng([scene.seed, 5])
    common = rng.standard_normal((height + 64, width + 64, 1))
    own = rng.standard_normal((height + 64, width + 64, 3))
    return np.clip(128.5 + scene.noise * (0.8 * common + 0.6 * own), 0, 255).astype(np.uint8)


class Present(NamedTuple):
    """A vehicle in front of the camera at one time."""

    number: int
    vehicle: SceneVehicle
    pose: Pose


def present(scene: Scene, t: float) -> list[Present]:
    """Vehicles that may be in the picture, in drawing order: hidden ones first."""
    found = []
    camera = scene.camera
    for index, vehicle in enumerate(scene.vehicles):
        pose = vehicle.pose(t)
        depth = camera.in_camera([pose[0], pose[1], 0.0])[2]
        if -vehicle.size.length < depth < FAR:
            found.append(Present(index, vehicle, pose))

    def order(a: Present, b: Present) -> int:
        return nearer(a, b, camera)

    return sorted(found, key=cmp_to_key(order))


def nearer(a: Present, b: Present, camera: Camera) -> int:
    """Positive where `a` hides `b`: the lane nearer to the camera wins, then the nearer place along the lane."""
    apart = abs(a.pose[1] - b.pose[1]) > 0.5 * (a.vehicle.size.width + b.vehicle.size.width)
    axis = 1 if apart else 0
    farther, closer = abs(b.pose[axis] - camera.position[axis]), abs(a.pose[axis] - camera.position[axis])
    return int(np.sign(farther - closer))


def sunlit_at(scene: Scene, pose: Pose) -> float:
    """Share of direct light at a place of the street, 0-1."""
    rows, columns = scene.still.sunlit.shape
    row = int((pose[1] + HALF_WIDTH) / RESOLUTION)
    column = int((pose[0] - scene.street.extent[0]) / RESOLUTION)
    return float(scene.still.sunlit[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)])


def render(scene: Scene, t: float) -> Image:
    """Draw the frame at time `t`.

    Parameters
    ----------
    scene : what to draw
    t : s

    Returns
    -------
    Picture [height, width, 3], BGR, the same for the same scene and time.

    >>> camera = Camera.looking_at((-5.0, -9.0, -7.0), (40.0, 0.0), size=(160, 90))
    >>> render(Scene(camera), 0.0).shape
    (90, 160, 3)
    """
    camera, still = scene.camera.scaled(FINER), scene.still
    canvas = still.picture.copy()
    vehicles = present(scene, t)
    for _, vehicle, pose in vehicles:
        cast_shadow(canvas, camera, scene.light, vehicle, pose, sunlit_at(scene, pose))
    for _, vehicle, pose in vehicles:
        draw_faces(canvas, seen_faces(camera, scene.light, vehicle, pose, sunlit_at(scene, pose)))
    if vehicles:
        cv2.copyTo(still.picture, still.foreground, canvas)
    return expose(scene, cv2.resize(canvas, scene.camera.size, interpolation=cv2.INTER_AREA), t)


def expose(scene: Scene, frame: Image, t: float) -> Image:
    """Shake, flicker and sensor noise."""
    width, height = scene.camera.size
    if scene.shake:
        dx, dy = scene.shift(t)
        move = np.array([[1, 0, dx], [0, 1, dy]])
        frame = cv2.warpAffine(frame, move, (width, height), borderMode=cv2.BORDER_REPLICATE)
    gain = 1 + scene.flicker * scene.wave(t, 0)
    rng = np.random.default_rng([scene.seed, 11, round((t + 1e4) * 1e4)])
    row, column = rng.integers(0, 64, 2)
    noise = scene.grain[row : row + height, column : column + width]
    return cv2.addWeighted(frame, gain, noise, 1.0, -128.0)
