"""Film vehicles whose motion is known: the video, and the control points a surveyor would measure in it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.contract import writing
from vision.scene.bodies import PAINTS
from vision.scene.camera import Camera
from vision.scene.light import Light
from vision.scene.render import Scene
from vision.scene.street import Street
from vision.scene.truth import control_point_card, control_points
from vision.scene.vehicles import Pose, SceneVehicle
from vision.scene.video import write_video

FPS = 12.5
CLICK = 0.5  # px; how well a person reads a control point off a picture
PLACE = 0.01  # m; accuracy of the marks' places, which are written to the centimeter
# On a mast beside the road: half a meter per pixel or better from x = 18 to 60 m, in both lanes.
MAST = Camera.looking_at((16.0, 18.0, -13.0), (42.0, 0.0), field_of_view=85.0)


@dataclass(frozen=True)
class Driver:
    """A vehicle and its motion as functions of time.

    Attributes
    ----------
    vehicle_class : "car", "van", "truck" or "bus"
    length, width : m
    position, velocity : t [n], s -> [n, 2] m and m/s; the ground point under the middle of the wheelbase
    """

    vehicle_class: str
    length: float
    width: float
    position: Callable[[Sequence[float]], NDArray[np.float64]]
    velocity: Callable[[Sequence[float]], NDArray[np.float64]]

    def pose(self, t: float) -> Pose:
        """Ground point and heading at time `t`, s."""
        (x, y), (along, across) = self.position([t])[0], self.velocity([t])[0]
        return float(x), float(y), float(np.arctan2(across, along))


def street_scene(drivers: Sequence[Driver], seed: int, camera: Camera = MAST) -> Scene:
    """Put the drivers on a two-lane street under a moderate sun."""
    rng = np.random.default_rng([seed, 11])
    vehicles = tuple(
        SceneVehicle(
            driver.vehicle_class,
            driver.pose,
            PAINTS[int(rng.integers(len(PAINTS)))],
            driver.length,
            driver.width,
            style=int(rng.integers(100)),
        )
        for driver in drivers
    )
    return Scene(camera, Street(seed=seed), Light(azimuth=float(rng.uniform(-60, 60))), vehicles, seed=seed)


def film(scene: Scene, folder: Path, duration: float, seed: int) -> None:
    """Write `street.mp4`, `control_points.csv` (read off with `CLICK` px of error) and `control_points.png`.

    Parameters
    ----------
    scene : what to film
    folder : where to
    duration : s
    seed : of the reading errors
    """
    points = control_points(scene)
    error = np.random.default_rng([seed, 13]).normal(0, CLICK, (len(points), 2))
    rows = [
        f"{point.name},{point.px + du:.1f},{point.py + dv:.1f},{point.x:.2f},{point.y:.2f},{CLICK},{PLACE}"
        for point, (du, dv) in zip(points, error, strict=True)
    ]
    with writing(folder / "control_points.csv") as path:
        path.write_text("\n".join(["name,px,py,x,y,sigma,sigma_xy", *rows]) + "\n", encoding="utf-8")
    with writing(folder / "control_points.png") as path:
        path.write_bytes(cv2.imencode(".png", control_point_card(scene, points))[1].tobytes())
    write_video(scene, folder / "street.mp4", FPS, duration)
