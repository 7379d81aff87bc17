"""Homographies between the road and the image: eight comparable parameters, and the best ones for given points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints

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


def _normalization(values: Array) -> Array:
    center = values.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(values - center, axis=1).mean()
    return np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1]])


def reprojection(to_image: Array, points: ControlPoints) -> Array:
    """Distance [point], px, of the points from where `to_image`, ground -> pixels, puts them."""
    return np.asarray(np.linalg.norm(apply(to_image, points.ground) - points.pixels, axis=1))


def weighted_residual(to_image: Array, points: ControlPoints) -> Array:
    """Pixel errors over their sigma, [2 * point]."""
    return np.asarray(((apply(to_image, points.ground) - points.pixels) / points.sigma[:, None]).ravel())


def refine(points: ControlPoints, to_image: Array) -> Array:
    """Minimize the reprojection error from `to_image` [3, 3], ground -> pixels, by Levenberg-Marquardt."""
    from scipy.optimize import least_squares

    scaling = Scaling.of(points)

    def error(h: Array) -> Array:
        return weighted_residual(scaling.homography(h), points)

    def jacobian(h: Array) -> Array:
        return (scaling.jacobian(h, points.ground) / points.sigma[:, None, None]).reshape(-1, 8)

    return scaling.homography(least_squares(error, scaling.parameters(to_image), jacobian, method="lm").x)


@dataclass(frozen=True)
class Scaling:
    """Eight comparable parameters of a homography: its entries between centered, scaled coordinates (Hartley 1997).

    Attributes
    ----------
    from_ground, to_pixels : [3, 3], meters -> scaled, scaled -> pixels
    """

    from_ground: Array
    to_pixels: Array

    @classmethod
    def of(cls, points: ControlPoints) -> "Scaling":
        """Center and scale to the points."""
        return cls(_normalization(points.ground), inverse(_normalization(points.pixels)))

    def parameters(self, to_image: Array) -> Array:
        """Homography [3, 3], ground -> pixels -> parameters [8]."""
        scaled = inverse(self.to_pixels) @ to_image @ inverse(self.from_ground)
        return np.asarray((scaled / scaled[2, 2]).ravel()[:8])

    def homography(self, h: Array) -> Array:
        """Parameters [8] -> homography [3, 3], ground -> pixels."""
        return np.asarray(self.to_pixels @ np.append(h, 1.0).reshape(3, 3) @ self.from_ground)

    def jacobian(self, h: Array, ground: Array) -> Array:
        """Derivative [point, 2, 8] of the pixels of `ground` [point, 2], m, by the parameters."""
        q = homogeneous(ground) @ self.from_ground.T
        image = q @ np.append(h, 1.0).reshape(3, 3).T
        q, place = q / image[:, 2:], image[:, :2] / image[:, 2:]
        zero = np.zeros_like(q)
        first = np.concatenate([q, zero, -place[:, :1] * q[:, :2]], axis=1)
        second = np.concatenate([zero, q, -place[:, 1:] * q[:, :2]], axis=1)
        return self.to_pixels[0, 0] * np.stack([first, second], axis=1)
