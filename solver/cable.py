"""Cable stage: the fiber's route, a curve in three dimensions parametrised by its length."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from torch import Tensor

DEGREE = 3


class Basis(Protocol):
    """Functions of the distance along the fiber whose sums are routes."""

    def at(self, distance: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]:
        """Matrix [distance, coefficient] of their values, or of a derivative by distance."""


@dataclass(frozen=True)
class SplineBasis:
    """Cubic B-splines on equal knots over a stretch of fiber: local support, three dimensions alike.

    A route is `basis.at(s) @ coefficients` with coefficients [knot, 3] (x, y, z), m.

    Parameters
    ----------
    start, stop : ends of the stretch, distance along the fiber, m
    spacing : knot spacing wanted, m; the nearest that divides the stretch is taken

    >>> basis = SplineBasis(0.0, 100.0, 10.0)
    >>> basis.size
    13
    >>> basis.at(np.array([50.0])).sum().round(12)
    np.float64(1.0)
    """

    start: float
    stop: float
    spacing: float

    @property
    def intervals(self) -> int:
        """Number of knot intervals."""
        return max(1, round((self.stop - self.start) / self.spacing))

    @property
    def size(self) -> int:
        """Number of coefficients per dimension."""
        return self.intervals + DEGREE

    @property
    def step(self) -> float:
        """Knot spacing, m."""
        return (self.stop - self.start) / self.intervals

    @property
    def knots(self) -> NDArray[np.float64]:
        """Knots [intervals + 7], m, three beyond either end."""
        return np.asarray(self.start + self.step * np.arange(-DEGREE, self.intervals + DEGREE + 1), float)

    def at(self, distance: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]:
        """Basis matrix [distance, coefficient], or its derivative with respect to distance."""
        spline = BSpline(self.knots, np.eye(self.size), DEGREE, extrapolate=True)
        return np.asarray(spline(distance, nu=derivative))

    def interpolate(self, distance: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coefficients [coefficient, 3] of the smoothest route near points [point, 3] at those distances, m.

        A stiff penalty on curvature settles what the points leave open.
        """
        grid = np.linspace(self.start, self.stop, 4 * self.size)
        bending = 1e-3 * self.step**2 * self.at(grid, 2)
        matrix = np.vstack([self.at(distance), bending])
        target = np.vstack([points, np.zeros((len(grid), 3))])
        return np.asarray(np.linalg.lstsq(matrix, target, rcond=None)[0], float)


@dataclass(frozen=True)
class GaugeEnds:
    """Basis matrices at the two ends of every channel's gauge.

    Parameters
    ----------
    ahead, behind : [channel, coefficient], positions half a gauge length ahead and behind
    ahead_slope, behind_slope : [channel, coefficient], derivatives with respect to distance, 1/m
    gauge_length : m
    """

    ahead: Tensor
    behind: Tensor
    ahead_slope: Tensor
    behind_slope: Tensor
    gauge_length: float

    @classmethod
    def of(cls, basis: Basis, distance: NDArray[np.float64], gauge_length: float) -> "GaugeEnds":
        """Gauge ends of channels centered at `distance` [channel], m."""
        ahead, behind = distance + gauge_length / 2, distance - gauge_length / 2
        return cls(
            torch.from_numpy(basis.at(ahead)),
            torch.from_numpy(basis.at(behind)),
            torch.from_numpy(basis.at(ahead, 1)),
            torch.from_numpy(basis.at(behind, 1)),
            gauge_length,
        )


def unit(vectors: Tensor) -> Tensor:
    """Vectors [..., 3] scaled to length 1.

    >>> unit(torch.tensor([3.0, 0.0, 4.0])).tolist()
    [0.6000000238418579, 0.0, 0.800000011920929]
    """
    return vectors / vectors.norm(dim=-1, keepdim=True)


def axial(motion: Tensor, tangent: Tensor) -> Tensor:
    """Part of a motion [..., 3] along the fiber's unit tangent [..., 3].

    >>> axial(torch.tensor([1.0, 2.0, 3.0]), torch.tensor([0.0, 1.0, 0.0])).item()
    2.0
    """
    return (motion * tangent).sum(-1)
