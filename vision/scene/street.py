"""The street seen from above: layout, surveyed points, and its surface as an orthophoto."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Image = cv2.typing.MatLike

RESOLUTION = 0.04  # m per pixel of the orthophoto
HALF_WIDTH = 26.0  # m, orthophoto on either side of the road's axis
SHIFT = 4  # fractional bits of drawn coordinates


@dataclass(frozen=True)
class Street:
    """A straight street along x whose axis is y = 0 (m).

    Parameters
    ----------
    lanes : number of lanes, both directions together
    lane_width : m
    shoulder : from the outer lane's line to the curb, m
    sidewalk : width, m
    verge : from the sidewalk to the buildings, m
    extent : first and last x with detail, m
    dash, gap : lengths of the dashes of lane lines and of the gaps between, m; a dash begins at x = 0
    marks : distance between the survey marks along each curb, m; 0: none
    trees : share of tree pits with a tree, on the far side of the road
    near_trees : the same on the camera's side, where trees hide parts of the road
    seed : decides wear, patches, manholes, houses and trees

    >>> street = Street()
    >>> street.curb, street.building_line, street.lane_center(0), street.lane_center(1)
    (3.9, 9.5, -1.75, 1.75)
    """

    lanes: int = 2
    lane_width: float = 3.5
    shoulder: float = 0.4
    sidewalk: float = 2.6
    verge: float = 3.0
    extent: tuple[float, float] = (-40.0, 200.0)
    dash: float = 3.0
    gap: float = 4.5
    marks: float = 12.0
    trees: float = 0.7
    near_trees: float = 0.0
    seed: int = 0

    @property
    def curb(self) -> float:
        """Distance of the curbs from the axis, m."""
        return self.lanes * self.lane_width / 2 + self.shoulder

    @property
    def building_line(self) -> float:
        """Distance of the houses' fronts from the axis, m."""
        return self.curb + self.sidewalk + self.verge

    def lane_center(self, lane: int) -> float:
        """Return y of the middle of a lane, m; lane 0 is the leftmost seen along +x."""
        return (lane + 0.5 - self.lanes / 2) * self.lane_width

    def dashes(self) -> Floats:
        """First x of every dash of the lane lines [n], m."""
        period = self.dash + self.gap
        first, last = np.ceil(self.extent[0] / period), np.floor((self.extent[1] - self.dash) / period)
        return np.arange(first, last + 1) * period

    def manholes(self) -> Floats:
        """Middles of the manhole covers [n, 2], m."""
        rng = np.random.default_rng([self.seed, 1])
        x = np.arange(self.extent[0] + 12.0, self.extent[1], 23.0)
        x = x + rng.uniform(-4, 4, x.size)
        lane = rng.integers(0, self.lanes, x.size)
        y = (lane + 0.5 - self.lanes / 2) * self.lane_width + rng.uniform(-0.5, 0.5, x.size)
        return np.column_stack([x, y])

    def survey_marks(self) -> Floats:
        """Middles of the chequered survey marks on both curbs' sides [n, 2], m."""
        if not self.marks:
            return np.empty((0, 2))
        x = np.arange(np.ceil(self.extent[0] / self.marks), self.extent[1] / self.marks) * self.marks
        y = self.curb + 0.9
        return np.concatenate([np.column_stack([x, 0 * x - y]), np.column_stack([x + self.marks / 2, 0 * x + y])])


def control_targets(street: Street) -> list[tuple[str, float, float]]:
    """Name, x and y (m) of every drawn point a surveyor would use.

    Dash ends on the axis (or the first lane line right of it), manhole covers, survey marks.

    >>> sorted({name.split("_")[0] for name, _, _ in control_targets(Street())})
    ['dash', 'manhole', 'mark']
    """
    line = 0.0 if street.lanes % 2 == 0 else street.lane_width / 2
    dashes = [(f"dash_{x:+.0f}", float(x), line) for x in street.dashes()] if street.lanes > 1 else []
    manholes = [(f"manhole_{k}", float(x), float(y)) for k, (x, y) in enumerate(street.manholes())]
    marks = [(f"mark_{k}", float(x), float(y)) for k, (x, y) in enumerate(street.survey_marks())]
    return dashes + manholes + marks


class Orthophoto:
    """The street's surface as a picture with `RESOLUTION` m per pixel; row 0 is the left side (-y)."""

    def __init__(self, street: Street) -> None:
        self.street = street
        self.rng = np.random.default_rng([street.seed, 2])
        self.shape = (round(2 * HALF_WIDTH / RESOLUTION), round((street.extent[1] - street.extent[0]) / RESOLUTION))
        self.image = self.surface()
        self.markings()
        self.furniture()

    @property
    def to_pixels(self) -> Floats:
        """Homography [3, 3] from x, y (m) to the orthophoto's pixel coordinates (edges, not centers)."""
        return np.array(
            [
                [1 / RESOLUTION, 0, -self.street.extent[0] / RESOLUTION],
                [0, 1 / RESOLUTION, HALF_WIDTH / RESOLUTION],
                [0, 0, 1],
            ]
        )

    def noise(self, cells: tuple[float, float], shape: tuple[int, int] | None = None) -> Image:
        """Smooth noise with unit spread; `cells` are its grain across and along the street, m."""
        rows, columns = shape or self.shape
        grid = (
            max(int(rows * RESOLUTION / cells[0]), 2),
            max(int(columns * RESOLUTION / cells[1]), 2),
        )
        return cv2.resize(
            self.rng.standard_normal(grid).astype(np.float32), (columns, rows), interpolation=cv2.INTER_LINEAR
        )

    def rows(self, left: float, right: float) -> slice:
        """Rows between two y, m."""
        a, b = np.clip(((np.array([left, right]) + HALF_WIDTH) / RESOLUTION).round(), 0, self.shape[0])
        return slice(int(a), int(b))

    def surface(self) -> Image:
        """Asphalt, sidewalks and verges."""
        street, rng = self.street, self.rng
        base = np.empty((*self.shape, 3), np.float32)
        green = rng.uniform(0, 1) < 0.6
        base[:] = rng.uniform(0.8, 1.15) * np.array([52, 92, 84] if green else [112, 120, 126], np.float32)
        walk = street.curb + street.sidewalk
        base[self.rows(-walk, walk)] = rng.uniform(130, 165) * np.array([0.96, 1.0, 1.03], np.float32)
        base[self.rows(-street.curb, street.curb)] = rng.uniform(72, 112)
        for side in (-1, 1):
            inner, outer = sorted((side * (street.curb - 0.02), side * (street.curb + 0.22)))
            base[self.rows(inner, outer)] = (172, 176, 178)
        large = self.noise((3.0, 9.0)) * 4 + self.noise((0.7, 1.1)) * 3
        grain = rng.standard_normal((512, 512)).astype(np.float32) * 6
        tiles = np.tile(grain, (self.shape[0] // 512 + 1, self.shape[1] // 512 + 1))
        base += (large + tiles[: self.shape[0], : self.shape[1]])[..., None]
        self.tracks(base)
        return np.clip(base, 0, 255).astype(np.uint8)

    def tracks(self, base: Image) -> None:
        """Darken where wheels roll and oil drips; joints of the sidewalk's slabs."""
        street = self.street
        for lane in range(street.lanes):
            for offset, width, depth in ((-0.8, 0.5, 7), (0.8, 0.5, 7), (0.0, 0.4, 5)):
                y = street.lane_center(lane) + offset
                base[self.rows(y - width / 2, y + width / 2)] -= depth
        joints = slice(0, self.shape[1], round(1.5 / RESOLUTION))
        for side in (-1, 1):
            inner, outer = sorted((side * (street.curb + 0.22), side * (street.curb + street.sidewalk)))
            base[self.rows(inner, outer), joints] -= 30

    def fill(self, image: Image, outline: ArrayLike, color: float | tuple[float, ...]) -> None:
        """Fill a convex polygon [k, 2], m."""
        points = np.asarray(outline, float)
        pixels = (points - [self.street.extent[0], -HALF_WIDTH]) / RESOLUTION - 0.5
        # fillPoly also fills the pixels that its outline touches: draw the outline half a pixel further in
        pixels -= 0.5 * np.sign((pixels - pixels.mean(0)).round(6))
        cv2.fillPoly(image, [(pixels * 2**SHIFT).round().astype(np.int32)], color, cv2.LINE_8, SHIFT)

    def stripe(self, image: Image, x: tuple[float, float], y: float, width: float) -> None:
        """Fill an axis-parallel stripe with full paint."""
        low, high = y - width / 2, y + width / 2
        self.fill(image, [(x[0], low), (x[1], low), (x[1], high), (x[0], high)], 255.0)

    def markings(self) -> None:
        """Lane lines, edge lines and survey marks, worn."""
        street = self.street
        paint = np.zeros(self.shape, np.uint8)
        for line in range(1, street.lanes):
            y = (line - street.lanes / 2) * street.lane_width
            for x in street.dashes():
                self.stripe(paint, (x, x + street.dash), y, 0.15)
        for side in (-1, 1):
            self.stripe(paint, street.extent, side * street.lanes * street.lane_width / 2, 0.12)
        wear = np.clip(0.86 + 0.16 * self.noise((0.3, 0.5)), 0.35, 1) / 255 * paint
        mixed = self.image * (1 - wear[..., None]) + wear[..., None] * np.array([222, 228, 230], np.float32)
        self.image = mixed.astype(np.uint8)
        for x, y in street.survey_marks():
            self.chequer(x, y)

    def chequer(self, x: float, y: float, half: float = 0.45) -> None:
        """Draw a quartered survey mark about (x, y)."""
        square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
        self.fill(self.image, square * half * 1.12 + (x, y), (245.0, 245.0, 245.0))
        for quarter in ((-0.5, -0.5), (0.5, 0.5)):
            self.fill(self.image, (square * 0.5 + quarter) * half + (x, y), (20.0, 20.0, 20.0))

    def furniture(self) -> None:
        """Manhole covers, repaired patches and cracks."""
        street, rng = self.street, self.rng
        angles = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        for _ in range(14):
            x, y = rng.uniform(*street.extent), rng.uniform(-street.curb + 1, street.curb - 1)
            columns = slice(max(int((x - street.extent[0]) / RESOLUTION), 0), None)
            window = self.image[self.rows(y, y + rng.uniform(0.6, 1.6)), columns][:, : rng.integers(25, 150)]
            window[:] = np.clip(window * rng.uniform(0.8, 1.08), 0, 255)
        for x, y in street.manholes():
            self.fill(self.image, (x, y) + 0.42 * circle, (120.0, 122.0, 124.0))
            self.fill(self.image, (x, y) + 0.34 * circle, (48.0, 48.0, 50.0))
        for _ in range(10):
            steps = np.column_stack([rng.uniform(0.1, 0.5, 14), rng.normal(0, 0.15, 14)])
            start = np.array([rng.uniform(*street.extent), rng.uniform(-street.curb, street.curb)])
            way = np.cumsum(steps, axis=0) + start
            pixels = (way - [street.extent[0], -HALF_WIDTH]) / RESOLUTION
            cv2.polylines(self.image, [pixels.astype(np.int32)], False, (52.0, 52.0, 54.0), 1)
