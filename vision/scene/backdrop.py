"""What stands still around the street: sky, ground, houses, trees, lamp posts, and their shadows."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vision.scene.camera import NEAR, Camera
from vision.scene.light import Light
from vision.scene.street import SHIFT, Floats, Image, Orthophoto, Street


@dataclass(frozen=True, eq=False)
class House:
    """A block: x from..to, distance of the front from the axis with its side's sign, height; m."""

    x: tuple[float, float]
    front: float
    height: float
    wall: tuple[float, float, float]
    seed: int

    depth = 9.0

    @property
    def middle(self) -> Floats:
        """Middle of the block on the ground [2], m."""
        return np.array([np.mean(self.x), self.front + np.sign(self.front) * self.depth / 2])


@dataclass(frozen=True, eq=False)
class Tree:
    """A tree: foot [2], height and radius of the crown; m."""

    middle: Floats
    height: float
    radius: float
    green: tuple[float, float, float]
    seed: int


@dataclass(frozen=True, eq=False)
class LampPost:
    """A post at `middle` [2] whose arm reaches toward the road; m."""

    middle: Floats
    height: float = 7.5


Thing = House | Tree | LampPost


def furnish(street: Street, camera: Camera) -> list[Thing]:
    """Houses, trees and posts along the street; a camera that stands back from the road has a park on its side."""
    rng = np.random.default_rng([street.seed, 3])
    things: list[Thing] = []
    for side in (-1.0, 1.0):
        own = side * camera.position[1] > 0
        set_back = side * camera.position[1] > street.building_line - 1.0
        things += park(street, camera, side, rng) if set_back else houses(street, side, rng)
        for x in np.arange(street.extent[0] + rng.uniform(0, 19), street.extent[1], 19.0):
            foot = np.array([x + rng.uniform(-3, 3), side * (street.curb + street.sidewalk + rng.uniform(0.3, 1.2))])
            clear = np.hypot(*(foot - camera.position[:2])) > 14
            if rng.uniform() < (street.near_trees if own else street.trees) and clear:
                things.append(tree(foot, rng))
        for x in np.arange(street.extent[0] + rng.uniform(5, 30), street.extent[1], 37.0):
            things.append(LampPost(np.array([x, side * (street.curb + 0.5)])))
    return things


def park(street: Street, camera: Camera, side: float, rng: np.random.Generator) -> list[Thing]:
    """Bushes behind the sidewalk, and trees farther from the road than the camera."""
    bushes = [
        Tree(np.array([x, side * rng.uniform(street.building_line - 2, street.building_line)]),
             rng.uniform(0.6, 1.1), rng.uniform(0.5, 0.9), (34.0, 74.0, 58.0), int(rng.integers(1 << 30)))
        for x in rng.uniform(*street.extent, 26)
        if np.hypot(x - camera.position[0], side * street.building_line - camera.position[1]) > 12
    ]  # fmt: skip
    beyond = abs(camera.position[1]) + 7
    grove = [
        tree(np.array([x, side * (beyond + 50 * rng.uniform() ** 1.5)]), rng)
        for x in rng.uniform(street.extent[0], street.extent[1] + 60, 60)
    ]
    return [*bushes, *grove]


def tree(foot: Floats, rng: np.random.Generator) -> Tree:
    """Return a tree at `foot` with random size and green."""
    green = np.array([38.0, 78.0, 62.0]) * rng.uniform(0.75, 1.2) + rng.uniform(-8, 12, 3)
    return Tree(foot, rng.uniform(4.5, 8.0), rng.uniform(1.5, 2.6), tuple(green), int(rng.integers(1 << 30)))


def houses(street: Street, side: float, rng: np.random.Generator) -> list[Thing]:
    """Return a row of houses along one side (-1 left, 1 right)."""
    row: list[Thing] = []
    x = street.extent[0]
    while x < street.extent[1]:
        width, gap = rng.uniform(9, 24), rng.choice([0.0, 0.0, 3.0, 9.0])
        wall = tuple(rng.uniform(105, 205) * np.array([1, 1, 1]) * rng.uniform([0.72, 0.86, 0.95], [1, 1, 1.05]))
        height = 3.1 * rng.integers(2, 6) + 0.8
        row.append(House((x, x + width), side * street.building_line, height, wall, int(rng.integers(1 << 30))))
        x += width + gap
    return row


class Painter:
    """Draws still things into one picture."""

    def __init__(self, camera: Camera, light: Light, image: Image) -> None:
        self.camera, self.light, self.image = camera, light, image

    def polygon(self, corners: ArrayLike, color: ArrayLike) -> None:
        """Fill a polygon [k, 3] (m) unless part of it is behind the camera."""
        pixels = self.camera.project(corners) - 0.5
        if np.isfinite(pixels).all() and np.abs(pixels).max() < 1e5:
            points = (pixels * 2**SHIFT).round().astype(np.int32)
            cv2.fillPoly(self.image, [points], np.clip(color, 0, 255).tolist(), cv2.LINE_8, SHIFT)

    def lit(self, color: ArrayLike, normal: ArrayLike, place: ArrayLike) -> Floats:
        """Color of a surface under this light at `place` [3] or [2], seen through the air."""
        distance = np.linalg.norm(np.asarray(self.camera.position)[: np.size(place)] - place)
        shaded = np.asarray(color, float) * self.light.shade(normal) * self.light.tint
        return self.light.through_air(shaded, distance)

    def draw(self, thing: Thing) -> None:
        """Draw one thing."""
        if isinstance(thing, House):
            self.house(thing)
        elif isinstance(thing, Tree):
            self.tree(thing)
        else:
            self.post(thing)

    def house(self, house: House) -> None:
        """Roof, end walls, then the front in bays with windows."""
        side = np.sign(house.front)
        (a, b), back = house.x, house.front + side * house.depth
        place = np.array([*house.middle, -house.height / 2])
        for x, facing in ((a, -1.0), (b, 1.0)):
            if facing * (self.camera.position[0] - x) > 0:
                wall = [(x, house.front, 0), (x, back, 0), (x, back, -house.height), (x, house.front, -house.height)]
                self.polygon(wall, self.lit(house.wall, (facing, 0, 0), place))
        ring = [(a, house.front), (b, house.front), (b, back), (a, back)]
        if -self.camera.position[2] > house.height:
            self.polygon([(x, y, -house.height) for x, y in ring], self.lit((96, 98, 104), (0, 0, -1), place))
        bays = max(round((b - a) / 3.2), 1)
        edges = np.linspace(a, b, bays + 1)
        rng = np.random.default_rng(house.seed)
        pane = rng.uniform(0.45, 0.7), rng.uniform(0.4, 0.6)
        for left, right in pairwise(edges.tolist()):
            self.bay(house, (left, right), pane, rng)

    def bay(self, house: House, x: tuple[float, float], pane: tuple[float, float], rng: np.random.Generator) -> None:
        """One bay of a front: wall, a window per floor, a door or shop window below."""
        side = float(np.sign(house.front))
        toward = (0.0, -side, 0.0)
        middle = np.array([np.mean(x), house.front, -house.height / 2])

        def rectangle(left: float, right: float, low: float, high: float, out: float = 0.0) -> list[tuple[float, ...]]:
            y = house.front - side * out
            return [(left, y, -low), (right, y, -low), (right, y, -high), (left, y, -high)]

        wall = self.lit(np.array(house.wall) * rng.uniform(0.97, 1.03), toward, middle)
        self.polygon(rectangle(*x, 0.0, house.height), wall)
        self.polygon(rectangle(*x, house.height - 0.35, house.height), wall * 0.82)
        center, half = 0.5 * (x[0] + x[1]), 0.5 * pane[0] * (x[1] - x[0])
        for floor in range(int((house.height - 0.8) / 3.1)):
            low = floor * 3.1 + (0.3 if floor == 0 else 0.9)
            high = low + (2.3 if floor == 0 else 3.1 * pane[1])
            self.polygon(rectangle(center - half - 0.1, center + half + 0.1, low - 0.1, high + 0.1), wall * 1.12)
            glass = np.array([78, 68, 58]) * rng.uniform(0.5, 1.5) + (rng.uniform() < 0.15) * np.array([40, 70, 80])
            self.polygon(rectangle(center - half, center + half, low, high), self.lit(glass, toward, middle))
            self.polygon(rectangle(center - 0.04, center + 0.04, low, high), wall)

    def tree(self, tree: Tree) -> None:
        """Trunk, then leaves as many small discs, lighter on the sunny side."""
        x, y = tree.middle
        across = 0.14 * self.camera.rotation[0]
        foot, fork = np.array([x, y, 0.0]), np.array([x, y, -0.6 * tree.height])
        trunk = self.lit((52, 62, 74), (0, 0, -1), foot)
        self.polygon([foot - across, foot + across, fork + 0.6 * across, fork - 0.6 * across], trunk)
        rng = np.random.default_rng(tree.seed)
        ball = rng.standard_normal((700, 3))
        ball *= (rng.uniform(0.25, 1, 700) ** 0.4 / np.linalg.norm(ball, axis=1))[:, None]
        ball *= 1 + 0.25 * np.sin(3 * ball[:, :1] + rng.uniform(0, 6))
        leaves = ball * [tree.radius, tree.radius, 0.9 * tree.radius] + (x, y, -tree.height + 0.3 * tree.radius)
        in_camera = self.camera.in_camera(leaves)
        order = np.argsort(-in_camera[:, 2])
        if in_camera[:, 2].min() < 2 * NEAR:
            return
        bright = 0.62 + 0.38 * self.light.sun * ball @ self.light.direction - 0.16 * ball[:, 2]
        bright = np.clip(bright + rng.normal(0, 0.1, 700), 0.2, 1.6)
        colors = np.clip(self.lit(tree.green, (0, 0, -1), foot) * bright[:, None], 0, 255)
        pixels = self.camera.picture(in_camera) - 0.5
        radii = self.camera.focal * rng.uniform(0.10, 0.26, 700) / in_camera[:, 2]
        for k in order:
            center = (pixels[k] * 2**SHIFT).round().astype(int).tolist()
            cv2.circle(self.image, center, int(radii[k] * 2**SHIFT) + 8, colors[k].tolist(), -1, cv2.LINE_8, SHIFT)

    def post(self, post: LampPost) -> None:
        """Pole and arm."""
        x, y = post.middle
        across = 0.07 * self.camera.rotation[0]
        foot, top = np.array([x, y, 0.0]), np.array([x, y, -post.height])
        arm, thick = top + np.array([0, -1.8 * np.sign(y), -0.3]), np.array([0, 0, 0.12])
        color = self.lit((98, 100, 102), (0, 0, -0.5), foot)
        self.polygon([foot - across, foot + across, top + across, top - across], color)
        self.polygon([top, arm, arm + thick, top + thick], color)


def static_shadows(ortho: Orthophoto, things: list[Thing], light: Light) -> Image:
    """Share of direct light that reaches the ground [rows, columns] of the orthophoto, 0-1."""
    dark = np.zeros(ortho.shape, np.uint8)
    for thing in things:
        if isinstance(thing, House):
            a, b = thing.x
            back = thing.front + np.sign(thing.front) * thing.depth
            ring = np.array([(a, thing.front), (b, thing.front), (b, back), (a, back)])
            top = light.cast(np.column_stack([ring, np.full(4, -thing.height)]))
            ortho.fill(dark, cv2.convexHull(np.concatenate([ring, top]).astype(np.float32))[:, 0], 255.0)
        elif isinstance(thing, Tree):
            rng = np.random.default_rng(thing.seed)
            ball = rng.standard_normal((260, 3))
            ball *= (rng.uniform(0.3, 1, 260) ** 0.5 / np.linalg.norm(ball, axis=1))[:, None] * thing.radius
            crown = np.array([*thing.middle, -thing.height + 0.3 * thing.radius])
            disc = np.array(cv2.ellipse2Poly((0, 0), (28, 28), 0, 0, 360, 40)) / 100
            for spot in light.cast(ball + crown):
                ortho.fill(dark, spot + disc, 255.0)
        else:
            foot = np.array([*thing.middle, 0.0])
            ends = light.cast(np.stack([foot, foot - [0, 0, thing.height]]))
            across = np.array([0.07, 0.0])
            ortho.fill(dark, [ends[0] - across, ends[0] + across, ends[1] + across, ends[1] - across], 200.0)
    return 1 - cv2.blur(dark, (7, 7)).astype(np.float32) / 255


def ground(camera: Camera, light: Light, ortho: Orthophoto, sunlit: Image) -> Image:
    """Sky and ground [height, width, 3] seen by `camera`; far ground from coarser copies of the orthophoto."""
    up = np.array([0.0, 0.0, -1.0])
    full, dark = light.shade(up), light.shade(up, sunlit=0.0)
    factor = cv2.merge([dark + (full - dark) * sunlit] * 3) * light.tint.astype(np.float32)
    coarser = cv2.multiply(ortho.image, factor, dtype=cv2.CV_8U)
    width, height = camera.size
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    place = camera.to_ground(pixels)
    distance = np.hypot(np.hypot(*(place - camera.position[:2]).T), camera.position[2]).reshape(height, width)
    picture = sky(camera, light)
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    for level in range(5):
        # a pixel sees about distance / focal across and more along; take the copy whose pixels are nearest to that
        low = 0.0 if level == 0 else ortho_distance(camera, level)
        near = (distance >= low) & (distance < (np.inf if level == 4 else ortho_distance(camera, level + 1)))
        scale = np.diag([coarser.shape[1] / ortho.shape[1], coarser.shape[0] / ortho.shape[0], 1])
        chain = np.linalg.inv(half) @ scale @ ortho.to_pixels @ camera.ground_homography() @ half
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(coarser, chain, camera.size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        picture[near] = np.clip(light.through_air(seen[near], distance[near]), 0, 255)
        coarser = cv2.resize(coarser, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return picture


def ortho_distance(camera: Camera, level: int) -> float:
    """Distance, m, from which the orthophoto's `level`-th halving is fine enough (footprint: geometric mean)."""
    footprint = 0.04 * 2.0 ** (level - 0.5)
    return float((footprint * camera.focal * np.sqrt(-camera.position[2])) ** (2 / 3))


def sky(camera: Camera, light: Light) -> Image:
    """A sky [height, width, 3] that is bluer above, with soft clouds and far hills."""
    width, height = camera.size
    rows = np.arange(height)[:, None] + 0.5
    elevation = np.deg2rad(-camera.pitch) + np.arctan((height / 2 - rows) / camera.focal)
    zenith = np.array([205.0, 160.0, 105.0]) if light.sun > 0.3 else np.array([190.0, 186.0, 182.0])
    mix = np.clip(elevation / 0.5, 0, 1)[..., None]
    rng = np.random.default_rng(abs(hash((light.azimuth, light.sun))) % (1 << 32))
    clouds = cv2.resize(rng.standard_normal((6, 8)).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    color = (1 - mix) * light.sky + mix * zenith + np.clip(clouds, 0, 2)[..., None] * 14
    hill = elevation < 0.025 + 0.008 * np.sin(np.arange(width) / width * 9)
    color = np.where(hill[..., None], 0.72 * light.sky, color)
    return np.clip(color * light.tint, 0, 255).astype(np.uint8)
