"""Bodies of the scene's vehicles, as faces."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Color = tuple[float, float, float]

PAINTS: tuple[Color, ...] = (  # blue, green, red
    (232, 232, 230), (205, 205, 202), (150, 150, 148), (92, 90, 88), (48, 46, 45), (38, 34, 150), (120, 62, 30),
    (165, 110, 50), (58, 82, 40), (70, 110, 160), (40, 150, 205), (30, 40, 95), (190, 200, 205), (60, 40, 30),
)  # fmt: skip


class Size(NamedTuple):
    """Dimensions of a class, m; `overhang` is the body ahead of the front axle."""

    length: float
    width: float
    height: float
    wheelbase: float
    overhang: float
    wheel_radius: float


SIZES = {
    "car": Size(4.4, 1.8, 1.5, 2.65, 0.88, 0.32),
    "van": Size(5.6, 2.0, 2.3, 3.40, 0.95, 0.36),
    "truck": Size(8.0, 2.4, 3.2, 4.60, 1.40, 0.48),
    "bus": Size(12.0, 2.5, 3.1, 5.90, 2.70, 0.50),
}


class Face(NamedTuple):
    """A planar polygon [k, 3] of the body frame (x ahead of the wheelbase's middle, y right, z down), m."""

    corners: Floats
    material: str
    decal: bool = False


def normal(corners: Floats) -> Floats:
    """Unit normal [3] of a polygon [k, 3] (Newell's method)."""
    area = np.cross(corners, np.roll(corners, -1, axis=0)).sum(0)
    return area / np.linalg.norm(area)


def facing(corners: Floats, inside: Floats, material: str, decal: bool = False) -> Face:
    """Return a face whose normal points away from the point `inside` [3]."""
    outward = (corners.mean(0) - inside) @ normal(corners) >= 0
    return Face(corners if outward else corners[::-1], material, decal)


class Body:
    """Collects the faces of one vehicle; positions are shares of its length (0 rear, 1 front), width and height."""

    def __init__(self, size: Size) -> None:
        self.size = size
        self.front = size.wheelbase / 2 + size.overhang
        self.faces: list[Face] = []

    def point(self, along: float, across: float, up: float) -> Floats:
        """Shares (along, across -1 left..1 right, up) -> body frame [3], m."""
        length, width, height = self.size[:3]
        return np.array([self.front - (1 - along) * length, across * width / 2, -up * height])

    def shell(self, profile: list[tuple[float, float, float, str]]) -> None:
        """Extrude a side profile of (along, up, half width share, material of the strip to the next point)."""
        inside = self.point(*np.mean([(a, 0.0, u) for a, u, *_ in profile], axis=0))
        for (a, u, w, material), (b, v, q, _) in zip(profile, profile[1:] + profile[:1], strict=True):
            strip = [self.point(a, -w, u), self.point(a, w, u), self.point(b, q, v), self.point(b, -q, v)]
            self.faces.append(facing(np.array(strip), inside, material))
        for side in (-1.0, 1.0):
            self.side([(a, u, w) for a, u, w, _ in profile], side, "paint")

    def side(self, outline: list[tuple[float, float, float]], side: float, material: str, decal: bool = False) -> None:
        """Add a polygon of (along, up, half width share) on one side (-1 left, 1 right)."""
        corners = np.array([self.point(a, side * w, u) for a, u, w in outline])
        self.faces.append(facing(corners, self.point(0.5, 0.0, 0.4), material, decal))

    def sides(self, outline: list[tuple[float, float, float]], material: str) -> None:
        """Add a decal on both sides."""
        for side in (-1.0, 1.0):
            self.side(outline, side, material, decal=True)

    def end(self, along: float, box: tuple[float, float, float, float], material: str) -> None:
        """Add a decal (left, right, bottom, top) on the front (along > 0.5) or the rear."""
        left, right, bottom, top = box
        ring = [(left, bottom), (right, bottom), (right, top), (left, top)]
        corners = np.array([self.point(along, across, up) for across, up in ring])
        self.faces.append(facing(corners, self.point(0.5, 0.0, 0.4), material, decal=True))

    def lamps(self, rear: float, front: float, up: float, height: float) -> None:
        """Add head and tail lamps and the plates."""
        for side in (-1.0, 1.0):
            inner, outer = sorted((side * 0.62, side * 0.95))
            self.end(rear, (inner, outer, up, up + height), "tail")
            self.end(front, (inner, outer, up, up + height), "lamp")
        self.end(rear, (-0.28, 0.28, up - 0.5 * height, up + 0.3 * height), "plate")
        self.end(front, (-0.55, 0.55, up - height, up + 0.2 * height), "black")

    def wheels(self, axles: tuple[float, ...]) -> None:
        """Add wheels at body positions `axles`, m ahead of the wheelbase's middle."""
        angles = np.linspace(0, 2 * np.pi, 14, endpoint=False)
        circle = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], axis=1)
        for x in axles:
            for side in (-1.0, 1.0):
                middle = np.array([x, side * self.size.width / 2, -self.size.wheel_radius])
                inside = middle * [1, 0, 1]
                for radius, material, outer in ((1.0, "tire", 0.0), (0.62, "rim", 0.01), (0.2, "black", 0.02)):
                    ring = middle + [0, side * outer, 0] + circle * radius * self.size.wheel_radius
                    self.faces.append(facing(ring, inside, material, decal=True))


def faces(cls: str, size: Size, style: int) -> list[Face]:
    """Polygons of a vehicle of class `cls`."""
    body = Body(size)
    styles = BODIES[cls]
    styles[style % len(styles)](body)
    body.wheels((size.wheelbase / 2, -size.wheelbase / 2))
    return body.faces


def hatchback(body: Body) -> None:
    """Build a compact car."""
    passenger_car(body, rear=0.05, roof=(0.20, 0.58), cowl=0.75, nose=0.50)


def sedan(body: Body) -> None:
    """Build a car with a trunk."""
    passenger_car(body, rear=0.17, roof=(0.32, 0.58), cowl=0.74, nose=0.48)


def suv(body: Body) -> None:
    """Build a tall car with a steep tailgate."""
    passenger_car(body, rear=0.02, roof=(0.10, 0.62), cowl=0.75, nose=0.54)


def passenger_car(body: Body, rear: float, roof: tuple[float, float], cowl: float, nose: float) -> None:
    """Body, cabin and lamps; `rear`, `roof`, `cowl`, `nose`: where the rear window, roof, hood begin, hood height."""
    back, ahead = roof
    belt, narrow = 0.62, 0.80
    body.shell(
        [(0.0, 0.16, 0.97, "trim"), (0.0, 0.58, 0.97, "paint"), (0.03, belt, 0.97, "paint"),
         (cowl, belt, 0.97, "paint"), (0.97, nose, 0.93, "trim"), (1.0, 0.40, 0.93, "trim"), (1.0, 0.16, 0.93, "black")]
    )  # fmt: skip
    body.shell(
        [(rear, belt, 0.95, "glass"), (back, 0.98, narrow, "paint"), (ahead, 1.0, narrow, "glass"),
         (cowl, belt, 0.95, "black")]
    )  # fmt: skip
    middle = 0.5 * (back + ahead)
    for a, b, c, d in (
        (rear + 0.06, back + 0.03, middle - 0.01, middle - 0.01),
        (middle + 0.015, middle + 0.015, ahead - 0.01, cowl - 0.06),
    ):
        ring = [(a, belt + 0.03, 0.955), (b, 0.93, 0.83), (c, 0.93, 0.83), (d, belt + 0.03, 0.955)]
        body.sides(ring, "glass")
    body.lamps(0.0, 1.0, 0.40, 0.12)
    for side in (-1.0, 1.0):
        ring = [
            (cowl - 0.06, belt, 1.08),
            (cowl - 0.03, belt, 1.08),
            (cowl - 0.03, 0.70, 1.08),
            (cowl - 0.06, 0.70, 1.08),
        ]
        body.side(ring, side, "black", decal=True)


def panel_van(body: Body) -> None:
    """Build a van with windows at the front seats only."""
    body.shell(
        [(0.0, 0.12, 0.98, "paint"), (0.0, 0.97, 0.92, "paint"), (0.02, 1.0, 0.9, "paint"), (0.68, 1.0, 0.9, "glass"),
         (0.84, 0.58, 0.96, "paint"), (0.98, 0.44, 0.93, "trim"), (1.0, 0.36, 0.93, "trim"), (1.0, 0.12, 0.93, "black")]
    )  # fmt: skip
    body.sides([(0.64, 0.60, 0.97), (0.64, 0.90, 0.93), (0.69, 0.90, 0.93), (0.80, 0.60, 0.97)], "glass")
    for side in (-0.5, 0.5):
        body.end(0.0, (side - 0.36, side + 0.36, 0.60, 0.88), "glass")
    body.lamps(0.0, 1.0, 0.30, 0.10)


def minibus(body: Body) -> None:
    """Build a van with windows all along."""
    panel_van(body)
    for a, b in ((0.05, 0.22), (0.24, 0.42), (0.44, 0.62)):
        body.sides([(a, 0.60, 0.97), (a, 0.90, 0.93), (b, 0.90, 0.93), (b, 0.60, 0.97)], "glass")


def box_truck(body: Body) -> None:
    """Build a cab-over truck with a box."""
    body.shell(
        [(0.0, 0.14, 0.7, "black"), (0.0, 0.3, 0.7, "black"), (0.75, 0.3, 0.7, "black"), (0.75, 0.14, 0.7, "black")]
    )
    body.shell(
        [(0.76, 0.12, 0.95, "trim"), (0.76, 0.80, 0.92, "trim"), (0.94, 0.80, 0.90, "glass"),
         (0.985, 0.45, 0.95, "trim"), (1.0, 0.40, 0.95, "trim"), (1.0, 0.12, 0.95, "black")]
    )  # fmt: skip
    body.sides([(0.83, 0.48, 0.96), (0.83, 0.72, 0.94), (0.93, 0.72, 0.94), (0.965, 0.48, 0.96)], "glass")
    body.shell(
        [(0.0, 0.28, 1.0, "paint"), (0.0, 1.0, 1.0, "paint"), (0.735, 1.0, 1.0, "paint"), (0.735, 0.28, 1.0, "gray")]
    )
    body.sides([(0.01, 0.28, 1.005), (0.01, 0.32, 1.005), (0.725, 0.32, 1.005), (0.725, 0.28, 1.005)], "black")
    body.end(-0.001, (-0.02, 0.02, 0.32, 0.97), "gray")
    body.lamps(0.0, 1.0, 0.22, 0.05)


def liveried_truck(body: Body) -> None:
    """Build a box truck with a stripe along its box."""
    box_truck(body)
    body.sides([(0.08, 0.50, 1.005), (0.08, 0.72, 1.005), (0.62, 0.80, 1.005), (0.62, 0.58, 1.005)], "trim")


def city_bus(body: Body) -> None:
    """Build a twelve-meter bus."""
    body.shell(
        [(0.0, 0.10, 0.98, "paint"), (0.0, 0.95, 0.96, "paint"), (0.02, 0.98, 0.92, "paint"),
         (0.97, 0.98, 0.92, "paint"), (0.99, 0.93, 0.95, "glass"), (1.0, 0.36, 0.97, "paint"),
         (1.0, 0.10, 0.97, "black")]
    )  # fmt: skip
    body.shell(
        [(0.35, 0.95, 0.6, "gray"), (0.35, 1.0, 0.55, "gray"), (0.6, 1.0, 0.55, "gray"), (0.6, 0.95, 0.6, "gray")]
    )
    panes = np.linspace(0.03, 0.97, 9)
    for a, b in zip(panes[:-1] + 0.006, panes[1:] - 0.006, strict=True):
        body.sides([(a, 0.42, 0.985), (a, 0.84, 0.975), (b, 0.84, 0.975), (b, 0.42, 0.985)], "glass")
    for a, b in ((0.42, 0.50), (0.86, 0.94)):
        body.side([(a, 0.12, 0.99), (a, 0.84, 0.98), (b, 0.84, 0.98), (b, 0.12, 0.99)], 1.0, "black", decal=True)
    body.sides([(0.02, 0.30, 0.99), (0.02, 0.34, 0.99), (0.98, 0.34, 0.99), (0.98, 0.30, 0.99)], "trim")
    body.end(-0.001, (-0.7, 0.7, 0.50, 0.82), "glass")
    body.end(1.002, (-0.6, 0.6, 0.82, 0.92), "sign")
    body.lamps(0.0, 1.0, 0.20, 0.06)


BODIES: dict[str, tuple[Callable[[Body], None], ...]] = {
    "car": (hatchback, sedan, suv),
    "van": (panel_van, minibus),
    "truck": (box_truck, liveried_truck),
    "bus": (city_bus,),
}
