"""Homographies between the road and the image, by eight parameters of comparable scale."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def inverse(matrix: Array) -> Array:
    """Invert a matrix [n, n]."""
    return np.asarray(np.linalg.inv(matrix), float)


def homogeneous(values: Array) -> Array:
    """Points [n, 2] -> [n, 3] with 1 appended."""
    return np.column_stack([values, np.ones(len(values))])


def apply(homography: Array, values: Array) -> Array:
    """Map points [n, 2] by a homography [3, 3].

    >>> apply(np.diag([2.0, 2.0, 1.0]), np.array([[1.0, 3.0]]))
    array([[2., 6.]])
    """
    mapped = homogeneous(values) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def divided(values: Array) -> Array:
    """Derivative [n, 2, 3] of (x, y) / z by (x, y, z), at values [n, 3].

    >>> divided(np.array([[2.0, 4.0, 2.0]])).tolist()
    [[[0.5, 0.0, -0.5], [0.0, 0.5, -1.0]]]
    """
    slope = np.zeros((len(values), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1 / values[:, 2]
    slope[:, :, 2] = -values[:, :2] / values[:, 2:] ** 2
    return slope


def _normalization(values: Array) -> Array:
    center = values.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(values - center, axis=1).mean()
    return np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1]])


@dataclass(frozen=True)
class Scaling:
    """Eight parameters of comparable scale: a homography's entries between centered, scaled coordinates (Hartley 1997).

    Attributes
    ----------
    from_ground, to_pixels : [3, 3], meters -> scaled, scaled -> pixels
    """

    from_ground: Array
    to_pixels: Array

    @classmethod
    def of(cls, ground: Array, pixels: Array) -> "Scaling":
        """Center and scale to points [n, 2], m and px."""
        return cls(_normalization(ground), inverse(_normalization(pixels)))

    def parameters(self, to_image: Array) -> Array:
        """Homography [3, 3], ground -> pixels -> parameters [8]."""
        scaled = inverse(self.to_pixels) @ to_image @ inverse(self.from_ground)
        return np.asarray((scaled / scaled[2, 2]).ravel()[:8])

    def homography(self, h: Array) -> Array:
        """Parameters [8] -> homography [3, 3], ground -> pixels."""
        return np.asarray(self.to_pixels @ np.append(h, 1.0).reshape(3, 3) @ self.from_ground)

    def slope(self, h: Array, ground: Array) -> Array:
        """Derivative [n, 2, 8] of the pixels of points on the ground [n, 2] by the parameters."""
        scaled = homogeneous(ground) @ self.from_ground.T
        # Of homogeneous pixels [n, 3] by each entry of the scaled homography [3, 3], whose last one is 1.
        by_entry = np.einsum("ki,nj->nkij", self.to_pixels, scaled).reshape(len(scaled), 3, 9)[:, :, :8]
        return divided(homogeneous(ground) @ self.homography(h).T) @ by_entry
