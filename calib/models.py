"""Models of a view of the road: a homography or a camera, each with its free parameters and their priors."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.control_points import ControlPoints
from calib.homography import Scaling, apply, divided
from calib.layout import FEWEST, flaw_of, on_a_line
from calib.lens_prior import LensPrior
from vision.camera import Parameter
from vision.lens import NAMES, Lens

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A view of the road.

    Attributes
    ----------
    to_image : [3, 3], ground (x, y, 1), m -> ideal pixels (u, v, 1), third one > 0 in front of the camera
    lens : which then distorts them, or None
    """

    to_image: Array
    lens: Lens | None

    def project(self, ground: Array) -> Array:
        """Ground [n, 2], m -> pixels [n, 2]; NaN behind the camera and beyond the lens's reach."""
        depth = ground @ self.to_image[2, :2] + self.to_image[2, 2]
        ideal = np.where(depth[:, None] > 0, apply(self.to_image, ground), np.nan)
        return ideal if self.lens is None else self.lens.distort(ideal)

    def errors(self, points: ControlPoints) -> Array:
        """Distance [point], px, of points from where they are seen; inf where they cannot be."""
        off = np.linalg.norm(self.project(points.ground) - points.pixels, axis=1)
        return np.asarray(np.where(np.isfinite(off), off, np.inf))


class GroundModel(ABC):
    """A family of views with parameters theta [p], among them those of the lens, if it has one, with their prior."""

    name: str
    prior: LensPrior | None

    @abstractmethod
    def view(self, theta: Array) -> View:
        """Return the view at theta."""

    @abstractmethod
    def slope(self, theta: Array, ground: Array) -> Array:
        """Derivative [n, 2, p] of the pixels of points on the ground [n, 2], as `View.project` has them, by theta."""

    @abstractmethod
    def penalty(self, theta: Array) -> Array:
        """Deviations from the prior, in standard deviations."""

    @abstractmethod
    def penalty_slope(self, theta: Array) -> Array:
        """Derivative [m, p] of the penalty by theta."""

    @abstractmethod
    def determined_by(self, points: ControlPoints) -> bool:
        """Whether points and prior together determine all of theta."""

    @abstractmethod
    def describe(self, theta: Array) -> dict[str, tuple[float, str]]:
        """Numbers for people: value and unit."""


@dataclass(frozen=True)
class HomographyModel(GroundModel):
    """Any homography: theta is eight parameters of `scaling`, and z of a lens that was measured, if there is one."""

    scaling: Scaling
    prior: LensPrior | None
    name: str = "homography"

    def view(self, theta: Array) -> View:
        """Return the view at theta."""
        lens = None if self.prior is None else self.prior.lens(theta[8:])
        return View(self.scaling.homography(theta[:8]), lens)

    def slope(self, theta: Array, ground: Array) -> Array:
        """Chain rule through the ideal pixels."""
        slope = self.scaling.slope(theta[:8], ground)
        if self.prior is None:
            return slope
        lens, ideal = self.prior.lens(theta[8:]), apply(self.scaling.homography(theta[:8]), ground)
        by_z = lens.by_vector(ideal) @ self.prior.slope(theta[8:])
        return np.concatenate([lens.jacobian(ideal) @ slope, by_z], 2)

    def penalty(self, theta: Array) -> Array:
        """Z."""
        return theta[8:]

    def penalty_slope(self, theta: Array) -> Array:
        """One by each z."""
        return np.eye(len(theta))[8:]

    def start(self, to_image: Array) -> Array:
        """Theta of a homography [3, 3], ground -> ideal pixels."""
        return np.append(self.scaling.parameters(to_image), np.zeros(self.prior.size if self.prior else 0))

    def determined_by(self, points: ControlPoints) -> bool:
        """Whether there are four points of which no three are on a line."""
        return len(points) >= FEWEST and flaw_of(points) is None

    def describe(self, theta: Array) -> dict[str, tuple[float, str]]:
        """Nothing: the entries of a homography mean nothing to people."""
        return {}


@dataclass(frozen=True)
class CameraModel(GroundModel):
    """A camera: theta is z of the lens, a turn [3], rad, from `base`, and the position [3], m.

    Attributes
    ----------
    prior : of the lens
    base : [3, 3], rotation from the local frame to the camera's (right, down, forward)
    height : of the camera above the road and its standard deviation, m, where it was measured
    """

    prior: LensPrior
    base: Array
    height: tuple[float, float] | None = None
    name: str = "camera"

    def rotation(self, theta: Array) -> Array:
        """Rotation [3, 3] from the local frame to the camera's."""
        turn = theta[self.prior.size : self.prior.size + 3]
        return np.asarray(rotation_by(turn) @ self.base)

    def view(self, theta: Array) -> View:
        """Return the view at theta."""
        rotation, lens = self.rotation(theta), self.prior.lens(theta[: self.prior.size])
        columns = np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ theta[-3:]])
        return View(lens.matrix @ columns, lens)

    def slope(self, theta: Array, ground: Array) -> Array:
        """Chain rule through directions in the camera and ideal pixels."""
        rotation, lens = self.rotation(theta), self.prior.lens(theta[: self.prior.size])
        place = (np.column_stack([ground, np.zeros(len(ground))]) - theta[-3:]) @ rotation.T
        away = place[:, :2] / place[:, 2:] * lens.focal
        by_ideal = lens.jacobian(away + lens.center)
        ideal_by_lens = np.zeros((len(ground), 2, len(NAMES)))
        ideal_by_lens[:, :, :2], ideal_by_lens[:, :, 2:4] = away[:, :, None] * np.eye(2), np.eye(2)
        by_lens = lens.by_vector(away + lens.center) + by_ideal @ ideal_by_lens
        by_place = by_ideal @ (np.array(lens.focal)[:, None] * divided(place))
        turned = -by_place @ crossed(place) @ turning_by(theta[self.prior.size : self.prior.size + 3])
        return np.concatenate([by_lens @ self.prior.slope(theta[: self.prior.size]), turned, -by_place @ rotation], 2)

    def penalty(self, theta: Array) -> Array:
        """z, and the height's deviation."""
        if self.height is None:
            return theta[: self.prior.size]
        return np.append(theta[: self.prior.size], (-theta[-1] - self.height[0]) / self.height[1])

    def penalty_slope(self, theta: Array) -> Array:
        """One by each z, and the height's by the last coordinate."""
        rows = np.eye(len(theta))[: self.prior.size]
        return rows if self.height is None else np.vstack([rows, -np.eye(len(theta))[-1] / self.height[1]])

    def start(self, lens: Lens, position: Array) -> Array:
        """Theta of a camera turned like `base`."""
        z = np.linalg.lstsq(self.prior.factor, lens.vector - self.prior.mean, rcond=None)[0]
        return np.concatenate([z, np.zeros(3), position])

    def determined_by(self, points: ControlPoints) -> bool:
        """Whether there are four points that are not all on a line: the lens prior determines the rest."""
        return len(points) >= FEWEST and not on_a_line(points)

    def describe(self, theta: Array) -> dict[str, tuple[float, str]]:
        """Lens, position and direction."""
        lens = self.prior.lens(theta[: self.prior.size])
        right, _, forward = self.rotation(theta)
        level = np.array([-forward[1], forward[0], 0.0])
        roll = np.arctan2(np.cross(forward, level) @ right, level @ right)
        names = ("k1", "k2", "p1", "p2", "k3")
        return {
            "focal": (lens.focal[0], "px"),
            "center_x": (lens.center[0], "px"),
            "center_y": (lens.center[1], "px"),
            **{name: (value, "") for name, value in zip(names, lens.distortion, strict=True)},
            "x": (float(theta[-3]), "m"),
            "y": (float(theta[-2]), "m"),
            "height": (-float(theta[-1]), "m"),
            "direction": (float(np.rad2deg(np.arctan2(forward[1], forward[0]))), "deg from +x toward +y"),
            "tilt": (float(np.rad2deg(np.arcsin(forward[2]))), "deg below the horizon"),
            "roll": (float(np.rad2deg(roll)), "deg"),
        }


def rotation_by(turn: Array) -> Array:
    """Rotation [3, 3] by a vector [3], rad, along its axis (Rodrigues).

    >>> rotation_by(np.array([0, 0, np.pi / 2])).round(6).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    cross, angle = crossed(turn), float(np.linalg.norm(turn))
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * cross + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * cross @ cross
    )


def turning_by(turn: Array) -> Array:
    """Derivative [3, 3] of the rotation by a vector [3], rad: d R = [J d turn] x R (Barfoot 2017, equation 7.77).

    >>> turning_by(np.zeros(3)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    cross, angle = crossed(turn), float(np.linalg.norm(turn))
    # (1 - sin(angle) / angle) / angle^2, which rounding would spoil at small angles.
    last = (1 - np.sinc(angle / np.pi)) / angle**2 if angle > 1e-3 else 1 / 6
    return np.asarray(np.eye(3) + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * cross + last * cross @ cross)


def crossed(vectors: Array) -> Array:
    """Matrices [3, 3] or [n, 3, 3] by which the cross product of vectors [3] or [n, 3] with others is taken.

    >>> (crossed(np.array([1.0, 0, 0])) @ [0, 1, 0]).tolist()
    [0.0, 0.0, 1.0]
    """
    x, y, z = vectors.T
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0] = x, y, z
    return matrices - np.swapaxes(matrices, -1, -2)


def with_sigmas(values: dict[str, tuple[float, str]], sigmas: Array) -> dict[str, Parameter]:
    """Pair values with standard deviations [n], leaving out what is fixed at zero."""
    return {
        name: Parameter(value=value, sigma=float(sigma), unit=unit)
        for (name, (value, unit)), sigma in zip(values.items(), sigmas, strict=True)
        if value != 0.0 or sigma > 0
    }
