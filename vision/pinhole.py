"""A pinhole camera: where it stands and how it sees."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.lens import Lens

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pinhole:
    """Where a camera stands and how it sees.

    Parameters
    ----------
    focal : focal length, px
    matrix : [3, 4], (x, y, z, 1) in the local frame (m, z down) -> homogeneous pixels, third one > 0 in front
    position : (x, y, z) of the camera, m; z is negative, above the road
    lens : which distorts the picture, or None
    """

    focal: float
    matrix: Array
    position: Array
    lens: Lens | None = None

    def project(self, points: ArrayLike) -> Array:
        """Points [..., 3], m (z down) -> pixels [..., 2]; NaN behind the camera."""
        points = np.asarray(points, float)
        image = points @ self.matrix[:, :3].T + self.matrix[:, 3]
        depth = np.where(image[..., 2:] > 0, image[..., 2:], np.nan)
        ideal = image[..., :2] / depth
        return ideal if self.lens is None else self.lens.distort(ideal).reshape(ideal.shape)

    def slope(self, ideal: Array, depth: Array) -> Array:
        """Derivative [..., 2, 3], px/m, of the pixels of points by the points, which lie at `ideal` pixels [..., 2].

        Of m = P (X, 1): du/dX = (P_1 - u P_3) / m_3 (the quotient rule), with m_3 = `depth` [..., 1].
        """
        slope = (self.matrix[:2, :3] - ideal[..., None] * self.matrix[2, :3]) / depth[..., None]
        if self.lens is None:
            return np.asarray(slope)
        return np.asarray(self.lens.jacobian(ideal).reshape(*ideal.shape, 2) @ slope)


def pinhole_from_columns(focal: float, intrinsic: Array, columns: Array, lens: Lens | None) -> Pinhole:
    """The camera of a homography.

    Parameters
    ----------
    focal : focal length, px
    intrinsic : [3, 3], rays of the camera's frame -> homogeneous pixels
    columns : [3, 3], of the homography from the road, by the inverse of that: two of the rotation and the translation
    lens : which distorts the picture, or None
    """
    scale = np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    r1, r2, translation = (columns / scale).T
    # The nearest rotation, in Frobenius norm, to what the homography holds.
    u, _, vt = np.linalg.svd(np.column_stack([r1, r2, np.cross(r1, r2)]))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    # Used for the vertical only: the road must stay where the homography, fitted to control points, puts it.
    axes = np.column_stack([r1, r2, rotation[:, 2]])
    matrix = intrinsic @ np.column_stack([axes, translation])
    return Pinhole(focal=focal, matrix=matrix, position=-np.linalg.solve(axes, translation), lens=lens)
