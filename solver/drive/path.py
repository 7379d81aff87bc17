"""The operator's map as a path: points at every meter, and which of them a place is next to."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: m between points of the path.
STEP = 1.0
#: m of straight path added at both ends: cable that the map does not show.
BEYOND = 600.0
#: m from the map within which the car may be heard: offset of the map, width of the road, distance of the cable.
BESIDE = 40.0
#: m over which corners of the map are rounded: nobody bends a cable sharper.
ROUNDED = 6.0
#: m from a vertex of the map within which a road bends; rad, by which it turns at once at street corners.
BENDS, CORNER = 60.0, 1.0
#: m between points of a curve.
FINE = 0.25
#: How x and y of a whole file come out wrong, as what would be right, and the matrix that turns one into the other.
MISTAKES = {
    "y had the other sign (y is to the right of x)": ((1.0, 0.0), (0.0, -1.0)),
    "x had the other sign": ((-1.0, 0.0), (0.0, 1.0)),
    "x and y had the other sign (as x_azimuth off by 180 degrees gives)": ((-1.0, 0.0), (0.0, -1.0)),
    "x and y were exchanged": ((0.0, 1.0), (1.0, 0.0)),
}


@dataclass(frozen=True)
class Path:
    """A path.

    Parameters
    ----------
    points : [cell, 2], m, `STEP` apart, `BEYOND` before and after the map included
    along : [cell, 2], unit vectors
    first : cell at which the map begins
    length : of the map, m
    """

    points: Array
    along: Array
    first: int
    length: float

    @property
    def across(self) -> Array:
        """Unit vectors [cell, 2] to the right of `along`."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], -1)

    @cached_property
    def turn(self) -> Array:
        """Change of heading per meter [cell], rad/m, without its sign."""
        heading = np.unwrap(np.arctan2(self.along[:, 1], self.along[:, 0]))
        return np.abs(np.gradient(heading, STEP))

    def heading_at(self, cell: Array, step: float) -> Array:
        """By how much the heading changes over the `step` cells before each cell [channel], rad."""
        heading = np.unwrap(np.arctan2(self.along[:, 1], self.along[:, 0]))
        number = np.arange(len(heading))
        return np.asarray(np.interp(cell, number, heading) - np.interp(cell - step, number, heading))

    def spread_of_heading(self, sigma: float) -> Array:
        """Standard deviation of the heading [cell], rad, where the path may be off by `sigma`, m, along itself."""
        from scipy.ndimage import gaussian_filter1d

        heading = np.unwrap(np.arctan2(self.along[:, 1], self.along[:, 0]))
        mean, square = (gaussian_filter1d(one, sigma / STEP, mode="nearest") for one in (heading, heading**2))
        return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)))

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree

        return KDTree(self.points)

    def nearest(self, place: Array) -> tuple[NDArray[np.int64], Array]:
        """Cell next to each place [..., 2], and how far it is, m."""
        far, cell = self._tree.query(place)
        return np.asarray(cell, np.int64), np.asarray(far)

    def at(self, cell: Array, lateral: Array | float = 0.0) -> Array:
        """Points [..., 2] at cells, fractions included, moved to the right, m."""
        number = np.arange(len(self.points))
        x, y = (np.interp(cell, number, column) for column in self.points.T)
        nx, ny = (np.interp(cell, number, column) for column in self.across.T)
        return np.stack([x + lateral * nx, y + lateral * ny], -1)

    def turned(self) -> "Path":
        """The same from its other end."""
        first = len(self.points) - 1 - self.first - round(self.length / STEP)
        return Path(self.points[::-1].copy(), -self.along[::-1], first, self.length)


def path_of(vertices: Array) -> Path:
    """The path along the points of a map [vertex, 2], m, which it joins by curves.

    >>> path = path_of(np.array([[0.0, 0.0], [100.0, 0.0]]))
    >>> path.length, path.nearest(np.array([[40.0, 3.0]]))[1].round(2).tolist()
    (100.0, [3.0])
    """
    from scipy.ndimage import gaussian_filter1d

    step = np.diff(vertices, axis=0)
    step /= np.hypot(*step.T)[:, None]
    whole = np.concatenate([[vertices[0] - BEYOND * step[0]], vertices, [vertices[-1] + BEYOND * step[-1]]])
    fine = curved(whole)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(fine, axis=0).T))])
    at = np.arange(0.0, arc[-1], STEP)
    points = np.stack([np.interp(at, arc, column) for column in fine.T], -1)
    points = gaussian_filter1d(points, ROUNDED / STEP, axis=0, mode="nearest")
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return Path(points, along, round(BEYOND / STEP), float(arc[-1]) - 2 * BEYOND)


def curved(vertices: Array) -> Array:
    """Points [point, 2], some per meter, of a road through vertices [vertex, 2]: chords of a map cut its bends.

    Cubics between vertices, with slopes as of Akima (1970, J. ACM 17, 589), by vectors: a map that is straight stays
    straight. Roads bend within `BENDS` m of a vertex; where a map turns by more than `CORNER`, it has a street corner.

    >>> curved(np.array([[0.0, 0.0], [60.0, 0.0], [120.0, 15.0], [180.0, 45.0]])).max(0).round(1).tolist()
    [180.0, 45.0]
    """
    length = np.hypot(*np.diff(vertices, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(length)])
    # Points on long chords, beyond which they are straight.
    straight = np.concatenate([arc[:-1][length > 2.2 * BENDS] + BENDS, arc[1:][length > 2.2 * BENDS] - BENDS])
    knots = np.unique(np.concatenate([arc, straight]))
    places = np.stack([np.interp(knots, arc, column) for column in vertices.T], -1)
    chord = np.diff(places, axis=0) / np.diff(knots)[:, None]
    chords = np.concatenate([chord[:1], chord[:1], chord, chord[-1:], chord[-1:]])
    bend = np.hypot(*np.diff(chords, axis=0).T)
    after, before = bend[2:, None], bend[:-2, None]
    share = np.where(after + before > 1e-9, after / np.maximum(after + before, 1e-9), 0.5)
    slope = share * chords[1:-2] + (1 - share) * chords[2:-1]
    slope /= np.maximum(np.hypot(*slope.T), 1e-9)[:, None]
    corner = (bend[1:-1] > 2 * np.sin(CORNER / 2))[:, None]
    begins, ends = np.where(corner, chords[2:-1], slope), np.where(corner, chords[1:-2], slope)
    at = np.linspace(0.0, arc[-1], int(np.ceil(arc[-1] / FINE)) + 1)
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(chord) - 1)
    size = np.diff(knots)[piece, None]
    u = (at - knots[piece])[:, None] / size
    bow = u * (1 - u) * size * ((1 - u) * (begins[piece] - chord[piece]) - u * (ends[piece + 1] - chord[piece]))
    return np.asarray(places[piece] + u * size * chord[piece] + bow)
