"""The pinhole camera that looks at the rendered street."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

NEAR = 0.5  # m; what is nearer to the image plane is not drawn

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion, in the local frame (x along the road, y to its right, z down; m).

    Pixel coordinates are those of boxes: the picture spans [0, width] x [0, height], the middle of the first pixel is
    (0.5, 0.5).

    Parameters
    ----------
    position : x, y, z of the optical center, m; z is negative above the ground
    yaw : direction of view, degrees from +x toward +y
    pitch : degrees below the horizon
    focal : focal length, px
    size : width and height of the picture, px
    roll : degrees, clockwise in the picture when the camera turns counter-clockwise

    >>> camera = Camera(position=(0.0, 0.0, -6.0), yaw=0.0, pitch=0.0, focal=500.0, size=(640, 360))
    >>> camera.project([[50.0, 5.0, 0.0]]).tolist()
    [[370.0, 240.0]]
    """

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    focal: float
    size: tuple[int, int] = (640, 360)
    roll: float = 0.0

    @cached_property
    def rotation(self) -> Floats:
        """Rotation [3, 3] from the local frame to the camera's (right, down, forward)."""
        yaw, pitch, roll = np.deg2rad([self.yaw, self.pitch, self.roll])
        forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
        right = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        down = np.cross(forward, right)
        return np.stack(
            [np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right, forward]
        )

    @cached_property
    def matrix(self) -> Floats:
        """Intrinsic matrix K [3, 3], px."""
        width, height = self.size
        return np.array([[self.focal, 0.0, width / 2], [0.0, self.focal, height / 2], [0.0, 0.0, 1.0]])

    def in_camera(self, points: ArrayLike) -> Floats:
        """Points [..., 3] of the local frame -> camera frame [..., 3] (right, down, forward), m."""
        return (np.asarray(points, float) - self.position) @ self.rotation.T

    def project(self, points: ArrayLike) -> Floats:
        """Points [..., 3], m -> pixels [..., 2]; NaN for what lies behind the image plane."""
        return self.picture(self.in_camera(points))

    def picture(self, points: Floats) -> Floats:
        """Points [..., 3] of the camera frame, m -> pixels [..., 2]; NaN behind the near plane."""
        depth = np.where(points[..., 2:] >= NEAR * 0.999, points[..., 2:], np.nan)
        return points[..., :2] / depth * self.focal + np.array(self.size) / 2

    def ground_homography(self) -> Floats:
        """Homography H [3, 3] from pixels to the ground plane z = 0: (x, y, 1) ~ H (px, py, 1), m.

        Hartley and Zisserman (2004), section 8.1: a plane's picture is K [r1 r2 -R C].

        >>> camera = Camera((0.0, -8.0, -7.0), yaw=20.0, pitch=12.0, focal=560.0)
        >>> px, py = camera.project([[40.0, 1.5, 0.0]])[0]
        >>> x, y, w = camera.ground_homography() @ [px, py, 1.0]
        >>> round(float(x / w), 6), round(float(y / w), 6)
        (40.0, 1.5)
        """
        translation = -self.rotation @ np.array(self.position)
        to_picture = self.matrix @ np.column_stack([self.rotation[:, 0], self.rotation[:, 1], translation])
        inverse = np.linalg.inv(to_picture)
        return inverse / inverse[2, 2]

    def to_ground(self, pixels: ArrayLike) -> Floats:
        """Pixels [n, 2] -> x, y on the ground [n, 2], m; NaN above the horizon."""
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        rays = np.column_stack([(pixels - np.array(self.size) / 2) / self.focal, np.ones(len(pixels))]) @ self.rotation
        down = np.where(rays[:, 2:] > 1e-6, rays[:, 2:], np.nan)
        return np.array(self.position[:2]) - self.position[2] * rays[:, :2] / down

    def scaled(self, factor: float) -> "Camera":
        """Return the same view in a picture `factor` times as large."""
        width, height = self.size
        return replace(self, focal=self.focal * factor, size=(round(width * factor), round(height * factor)))

    @classmethod
    def looking_at(
        cls,
        position: tuple[float, float, float],
        target: tuple[float, float],
        field_of_view: float = 62.0,
        size: tuple[int, int] = (640, 360),
    ) -> "Camera":
        """Point a camera at a place on the ground.

        Parameters
        ----------
        position : x, y, z of the camera, m
        target : x, y on the ground in the middle of the picture, m
        field_of_view : horizontal, degrees
        size : width and height, px

        >>> camera = Camera.looking_at((0.0, -10.0, -8.0), (40.0, 0.0))
        >>> camera.project([[40.0, 0.0, 0.0]]).round(6).tolist()
        [[320.0, 180.0]]
        """
        x, y = target[0] - position[0], target[1] - position[1]
        pitch = np.rad2deg(np.arctan2(-position[2], np.hypot(x, y)))
        focal = size[0] / 2 / np.tan(np.deg2rad(field_of_view) / 2)
        return cls(position, float(np.rad2deg(np.arctan2(y, x))), float(pitch), float(focal), size)
