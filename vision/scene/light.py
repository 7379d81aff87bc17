"""Sun, sky, air and exposure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Light:
    """The light on the street.

    Parameters
    ----------
    azimuth : direction of the sun, degrees from +x toward +y
    elevation : of the sun, degrees
    sun : strength of the direct light, 0 (overcast) to 1 (clear)
    exposure : factor on every value of the picture
    warmth : factor on red and its inverse on blue
    visibility : distance at which air hides 1 - 1/e of the contrast, m
    """

    azimuth: float = -115.0
    elevation: float = 42.0
    sun: float = 0.8
    exposure: float = 1.0
    warmth: float = 1.03
    visibility: float = 700.0

    @property
    def direction(self) -> Floats:
        """Unit vector [3] toward the sun."""
        azimuth, elevation = np.deg2rad([self.azimuth, self.elevation])
        return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)])

    @property
    def tint(self) -> Floats:
        """Factor on blue, green and red [3]."""
        return self.exposure * np.array([1 / self.warmth, 1.0, self.warmth])

    @property
    def sky(self) -> Floats:
        """Color [3] (BGR, 0-255) of the sky at the horizon, which is also the color of the air."""
        return (1 - self.sun) * np.array([205.0, 202.0, 198.0]) + self.sun * np.array([232.0, 214.0, 190.0])

    def shade(self, normals: ArrayLike, sunlit: float = 1.0) -> Floats:
        """Brightness [n] of surfaces with outward unit normals [n, 3]: sky from above, sun by its cosine.

        `sunlit` is the share of the direct light that reaches them.
        """
        normals = np.asarray(normals, float)
        from_sky = 0.72 - 0.18 * normals[..., 2]
        direct = 0.75 * self.sun * sunlit * np.clip(normals @ self.direction, 0, None)
        return from_sky * (1 - 0.35 * self.sun) + direct

    def cast(self, points: ArrayLike) -> Floats:
        """Shadows [n, 2] on the ground of points [n, 3], m.

        >>> Light(azimuth=0.0, elevation=45.0).cast([[10.0, 2.0, -3.0]]).round(9).tolist()
        [[7.0, 2.0]]
        """
        points = np.asarray(points, float)
        toward = self.direction
        return points[..., :2] + points[..., 2:] * toward[:2] / -toward[2]

    def through_air(self, color: ArrayLike, distance: ArrayLike) -> Floats:
        """Color [n, 3] as seen through `distance` [n], m, of air."""
        kept = np.exp(-np.asarray(distance, float) / self.visibility)[..., None]
        return kept * np.asarray(color, float) + (1 - kept) * self.sky * self.tint
