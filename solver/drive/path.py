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
    """The path along the points of a map [vertex, 2], m.

    >>> path = path_of(np.array([[0.0, 0.0], [100.0, 0.0]]))
    >>> path.length, path.nearest(np.array([[40.0, 3.0]]))[1].round(2).tolist()
    (100.0, [3.0])
    """
    from scipy.ndimage import gaussian_filter1d

    step = np.hypot(*np.diff(vertices, axis=0).T)
    length = float(step.sum())
    arc = np.concatenate([[0.0], np.cumsum(step)])
    ends = (vertices[1] - vertices[0]) / step[0], (vertices[-1] - vertices[-2]) / step[-1]
    arc = np.concatenate([[-BEYOND], arc, [length + BEYOND]])
    whole = np.concatenate([[vertices[0] - BEYOND * ends[0]], vertices, [vertices[-1] + BEYOND * ends[1]]])
    at = np.arange(-BEYOND, length + BEYOND, STEP)
    points = np.stack([np.interp(at, arc, column) for column in whole.T], -1)
    points = gaussian_filter1d(points, ROUNDED / STEP, axis=0, mode="nearest")
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return Path(points, along, round(BEYOND / STEP), length)
