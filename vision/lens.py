"""What a lens does to a picture: intrinsics and Brown-Conrady distortion, both ways, with derivatives."""

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

Array = NDArray[np.float64]
Finite = Annotated[float, Field(allow_inf_nan=False)]
NAMES = ("ln_fx", "ln_fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")  # of `Lens.vector`
ROUNDS = 40  # of Newton's method
SETTLED = 1e-10  # in focal lengths


class Lens(BaseModel):
    """Intrinsics and distortion, with the coefficients of OpenCV in OpenCV's order.

    A direction (x, y, 1) in the camera, r^2 = x^2 + y^2, is seen at the pixel center + focal * (x', y') with
    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2) and
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y (Brown 1966). Without distortion it would be
    at center + focal * (x, y): the *ideal* pixel.

    Parameters
    ----------
    focal : focal length along x and y, px
    center : principal point, px from the top left
    distortion : k1, k2, p1, p2, k3

    >>> lens = Lens(focal=(800, 800), center=(640, 360), distortion=(-0.2, 0.05, 0, 0, 0))
    >>> lens.distort([[1240, 360]]).round(2).tolist()
    [[1181.99, 360.0]]
    >>> lens.undistort([[1181.99, 360]]).round(1).tolist()
    [[1240.0, 360.0]]
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    focal: tuple[Finite, Finite]
    center: tuple[Finite, Finite]
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if min(self.focal) <= 0:
            raise ValueError(f"focal {self.focal} must be two positive numbers, px")
        return self

    @property
    def vector(self) -> Array:
        """The nine parameters `NAMES`."""
        return np.array([*np.log(self.focal), *self.center, *self.distortion])

    @classmethod
    def from_vector(cls, values: ArrayLike) -> "Lens":
        """Lens of nine parameters `NAMES`."""
        values = np.asarray(values, float)
        fx, fy = np.exp(values[:2]).tolist()
        return cls(focal=(fx, fy), center=tuple(values[2:4].tolist()), distortion=tuple(values[4:].tolist()))

    @property
    def matrix(self) -> Array:
        """Intrinsic matrix K [3, 3], px."""
        (fx, fy), (cx, cy) = self.focal, self.center
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    @cached_property
    def reach(self) -> float:
        """Largest radius r up to which the distorted radius grows with r; beyond it the polynomial folds back."""
        k1, k2, _, _, k3 = self.distortion
        if min(k1, k2, k3) >= 0:
            return np.inf
        roots = np.roots(np.trim_zeros(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]), "f"))
        folds = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        return float(np.sqrt(folds.min())) if len(folds) else np.inf

    def distort(self, ideal: ArrayLike) -> Array:
        """Ideal pixels [n, 2] -> pixels [n, 2]; NaN beyond `reach`, where the model holds for no real lens."""
        place = self._normalized(ideal)
        seen = self._seen(place) * self.focal + self.center
        return np.asarray(seen if self._unfolded(place) else np.where(self._reached(place), seen, np.nan))

    def undistort(self, pixels: ArrayLike) -> Array:
        """Pixels [n, 2] -> ideal pixels [n, 2], by Newton's method; NaN for pixels that no direction maps to."""
        target = self._normalized(pixels)
        place = target.copy()
        with np.errstate(all="ignore"):
            for _ in range(ROUNDS):
                error = self._seen(place) - target
                place = place - _solve(self._slope(place), error[..., None])[..., 0]
                if not (np.abs(error) > SETTLED).any():
                    break
            found = np.abs(self._seen(place) - target).max(axis=1, keepdims=True) < 1e-8
        return np.asarray(np.where(found & self._reached(place), place, np.nan) * self.focal + self.center)

    def jacobian(self, ideal: ArrayLike) -> Array:
        """Ideal pixels [n, 2] -> d pixel / d ideal pixel [n, 2, 2]."""
        focal = np.array(self.focal)
        return np.asarray(self._slope(self._normalized(ideal)) * focal[:, None] / focal)

    def sensitivity(self, pixels: ArrayLike) -> Array:
        """Pixels [n, 2] -> derivative [n, 2, 9] of their ideal pixels by `vector`, the pixels held.

        Of D(ideal, l) = pixel: d ideal / d l = -(dD/d ideal)^-1 dD/dl (the implicit function theorem).
        """
        ideal = self.undistort(pixels)
        return -_solve(self.jacobian(ideal), self.by_vector(ideal))

    def by_vector(self, ideal: ArrayLike) -> Array:
        """Ideal pixels [n, 2] -> derivative [n, 2, 9] of their pixels by `vector`, the ideal pixels held."""
        focal, place = np.array(self.focal), self._normalized(ideal)
        x, y = place.T
        square = x * x + y * y
        by_place = focal[:, None] * self._slope(place)
        out = np.zeros((len(place), 2, len(NAMES)))
        # By focal lengths and center: where a direction is seen, less by how much an ideal pixel's direction changes.
        seen, held = focal * self._seen(place), np.eye(2)
        out[:, :, :2] = seen[:, :, None] * held - by_place * place[:, None, :]
        out[:, :, 2:4] = held - by_place / focal
        for column, power in ((4, 1), (5, 2), (8, 3)):
            out[:, :, column] = focal * place * square[:, None] ** power
        out[:, :, 6] = focal * np.stack([2 * x * y, square + 2 * y * y], 1)
        out[:, :, 7] = focal * np.stack([square + 2 * x * x, 2 * x * y], 1)
        return out

    def _reached(self, place: Array) -> NDArray[np.bool_]:
        """Which directions [n, 2] are within `reach`, [n, 1]."""
        return np.asarray((place**2).sum(axis=1, keepdims=True) < self.reach**2)

    def _unfolded(self, place: Array) -> bool:
        """Whether all directions [n, 2] are surely within `reach`, by a cheap bound."""
        k1, k2, _, _, k3 = (min(k, 0.0) for k in self.distortion)
        square = float((place**2).sum(axis=1).max(initial=0.0))
        return 1 + square * (3 * k1 + square * (5 * k2 + square * 7 * k3)) > 0

    def _normalized(self, pixels: ArrayLike) -> Array:
        return np.asarray((np.asarray(pixels, float).reshape(-1, 2) - self.center) / self.focal)

    def _seen(self, place: Array) -> Array:
        """Directions [n, 2] -> where they are seen [n, 2], in focal lengths."""
        _, _, p1, p2, _ = self.distortion
        x, y = place.T
        square = x * x + y * y
        radial = self._radial(square)
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=1,
        )

    def _radial(self, square: Array) -> Array:
        k1, k2, _, _, k3 = self.distortion
        return np.asarray(1 + square * (k1 + square * (k2 + square * k3)))

    def _slope(self, place: Array) -> Array:
        """Derivative [n, 2, 2] of `_seen`."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = place.T
        square = x * x + y * y
        radial, steep = self._radial(square), 2 * (k1 + square * (2 * k2 + 3 * k3 * square))
        cross = x * y * steep + 2 * p1 * x + 2 * p2 * y
        rows = [
            [radial + x * x * steep + 2 * p1 * y + 6 * p2 * x, cross],
            [cross, radial + y * y * steep + 6 * p1 * y + 2 * p2 * x],
        ]
        return np.moveaxis(np.array(rows), -1, 0)


def _solve(matrix: Array, right: Array) -> Array:
    """Solve [n, 2, 2] systems for right sides [n, 2, m]; NaN or inf where one is singular."""
    (a, b), (c, d) = np.moveaxis(matrix, 0, -1)
    adjugate = np.moveaxis(np.array([[d, -b], [-c, a]]), -1, 0)
    return np.asarray(adjugate @ right / (a * d - b * c)[:, None, None])
