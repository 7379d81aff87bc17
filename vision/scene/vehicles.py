"""Vehicles as polygon meshes: bodies, windows, wheels, lamps."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vision.scene.bodies import SIZES, Color, Face, Floats, Size, faces, normal

Pose = tuple[float, float, float]  # x, y (m), heading (rad from +x toward +y)


MATERIALS: dict[str, Color] = {
    "glass": (62, 52, 44),
    "black": (30, 29, 28),
    "tire": (34, 33, 33),
    "rim": (150, 148, 146),
    "lamp": (235, 240, 242),
    "tail": (40, 35, 190),
    "plate": (190, 225, 230),
    "sign": (40, 190, 240),
    "gray": (120, 118, 116),
}


@dataclass(frozen=True)
class SceneVehicle:
    """A vehicle and its way through the scene.

    Parameters
    ----------
    cls : "car", "van", "truck" or "bus"
    trajectory : t (s) -> x, y (m; ground point under the middle of the wheelbase), heading (rad from +x toward +y)
    color : paint, blue, green, red, 0-255
    length, width, height : m; None: the class's
    style : which body of the class (any whole number; taken modulo the number of bodies)

    >>> SceneVehicle("bus", constant_speed(x=0.0, y=1.75, speed=10.0)).pose(2.0)
    (20.0, 1.75, 0.0)
    """

    cls: str
    trajectory: Callable[[float], Pose]
    color: Color = (205, 205, 202)
    length: float | None = None
    width: float | None = None
    height: float | None = None
    style: int = 0

    def pose(self, t: float) -> Pose:
        """Ground point and heading at time `t`, s."""
        x, y, heading = self.trajectory(t)
        return float(x), float(y), float(heading)

    @cached_property
    def size(self) -> Size:
        """Dimensions; wheelbase and overhang keep their share of the length."""
        usual = SIZES[self.cls]
        length = self.length or usual.length
        share = length / usual.length
        return Size(
            length,
            self.width or usual.width,
            self.height or usual.height,
            usual.wheelbase * share,
            usual.overhang * share,
            usual.wheel_radius,
        )

    @cached_property
    def mesh(self) -> "Mesh":
        """The body as polygons."""
        return Mesh.of(faces(self.cls, self.size, self.style), self.color)


@dataclass(frozen=True)
class Mesh:
    """Polygons of one body: corners [n, 3] m, the first corner of each polygon, outward normals, colors."""

    corners: Floats
    starts: NDArray[np.intp]
    normals: Floats
    centers: Floats
    colors: Floats
    glossy: NDArray[np.bool_]
    decal: NDArray[np.bool_]

    @classmethod
    def of(cls, polygons: list[Face], paint: Color) -> "Mesh":
        """Pack polygons into arrays; `paint` colors the material "paint"."""
        colors = {**MATERIALS, "paint": paint, "trim": tuple(0.55 * c for c in paint)}
        return cls(
            np.concatenate([f.corners for f in polygons]),
            np.cumsum([0] + [len(f.corners) for f in polygons]),
            np.array([normal(f.corners) for f in polygons]),
            np.array([f.corners.mean(0) for f in polygons]),
            np.array([colors[f.material] for f in polygons], float),
            np.array([f.material == "glass" for f in polygons]),
            np.array([f.decal for f in polygons]),
        )


def constant_speed(x: float, y: float, speed: float) -> Callable[[float], Pose]:
    """Return the trajectory of a vehicle at `x` (m) at t = 0 that keeps `y` (m) and `speed` (m/s, signed along +x)."""
    heading = 0.0 if speed >= 0 else np.pi
    return lambda t: (x + speed * t, y, heading)
