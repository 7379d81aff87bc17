"""Cable stage: the fiber's route, a curve in three dimensions parametrised by its length."""

from dataclasses import dataclass, fields
from functools import lru_cache
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

    def part(self, first: int, last: int) -> "SplineBasis":
        """The same functions over the intervals `first` to `last`: of the coefficients from number `first` on.

        >>> basis = SplineBasis(0.0, 100.0, 10.0)
        >>> at = np.array([37.0])
        >>> bool(np.allclose(basis.part(3, 5).at(at), basis.at(at)[:, 3:8]))
        True
        """
        return SplineBasis(self.start + first * self.step, self.start + last * self.step, self.step)

    def along(
        self, coefficients: NDArray[np.float64], distance: NDArray[np.float64], derivative: int = 0
    ) -> NDArray[np.float64]:
        """Points [distance, ...] of the route with `coefficients` [coefficient, ...], without the whole matrix."""
        return np.asarray(BSpline(self.knots, coefficients, DEGREE, extrapolate=True)(distance, nu=derivative))

    def at(self, distance: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]:
        """Basis matrix [distance, coefficient], or its derivative with respect to distance."""
        spline = BSpline(self.knots, np.eye(self.size), DEGREE, extrapolate=True)
        return np.asarray(spline(distance, nu=derivative))

    def weights(self, distance: Tensor, derivative: int = 0) -> Tensor:
        """The same [..., coefficient] at a tensor of distances [...], differentiable; straight on beyond the ends."""
        inside = distance.clamp(self.start, self.stop)
        phase = ((inside - self.start) / self.step)[..., None] - torch.arange(-1, self.size - 1, dtype=distance.dtype)
        x = phase.abs()
        near, far = x < 1, x < 2

        def pieces(center: Tensor, flank: Tensor) -> Tensor:
            return torch.where(near, center, torch.where(far, flank, torch.zeros_like(x)))

        if derivative == 2:
            bent = pieces(3 * x - 2, 2 - x) / self.step**2
            return torch.where((inside == distance)[..., None], bent, torch.zeros_like(bent))
        slope = phase.sign() * pieces(1.5 * x**2 - 2 * x, -0.5 * (2 - x) ** 2) / self.step
        if derivative == 1:
            return slope
        value = pieces(2 / 3 - x**2 + 0.5 * x**3, (2 - x) ** 3 / 6)
        return value + (distance - inside)[..., None] * slope

    def interpolate(self, distance: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coefficients [coefficient, 3] of the smoothest route near points [point, 3] at those distances, m.

        A stiff penalty on curvature settles what the points leave open. Banded normal equations: linear in length.
        """
        from scipy.linalg import solveh_banded
        from scipy.sparse import diags_array, vstack

        grid = np.linspace(self.start, self.stop, 4 * self.size)
        design = BSpline.design_matrix(distance, self.knots, DEGREE, extrapolate=True)
        # The second derivative of a cubic spline is piecewise linear between second differences of its coefficients.
        bends = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(self.intervals + 1, self.size))
        between = BSpline.design_matrix(grid, self.knots[2:-2], 1, extrapolate=True)
        matrix = vstack([design, 1e-3 * between @ bends]).tocsr()
        target = np.vstack([points, np.zeros((len(grid), points.shape[1]))])
        normal = (matrix.T @ matrix).todia()
        band = np.array([normal.diagonal(-k).tolist() + [0.0] * k for k in range(DEGREE + 1)])
        return np.asarray(solveh_banded(band, matrix.T @ target, lower=True), float)


#: Length of fiber, m, for which one station within a gauge stands: so a bend of a few meters within a long gauge is
#: seen; and how many there are at least.
PER_STATION, FEWEST_STATIONS = 2.5, 4


def stations_within(gauge_length: float) -> int:
    """How many stations an integral along a gauge takes.

    >>> stations_within(10.0), stations_within(50.0)
    (4, 20)
    """
    return max(FEWEST_STATIONS, round(gauge_length / PER_STATION))


@lru_cache
def stations(count: int) -> tuple[Tensor, Tensor]:
    """Gauss-Legendre stations: offsets in gauge lengths from a gauge's middle, and weights that sum to 1, [station].

    >>> offsets, weights = stations(4)
    >>> round(float(weights @ offsets**2), 6)  # 1 / 12
    0.083333
    """
    offsets, weights = np.polynomial.legendre.leggauss(count)
    return torch.from_numpy(offsets / 2), torch.from_numpy(weights / 2)


@dataclass(frozen=True)
class Coil:
    """Fiber that seems to lie coiled, as in a manhole, and the straight road beside which the rest lies.

    Parameters
    ----------
    place : distance along the fiber of its middle, m
    length : m
    origin, slope : x = origin + slope (distance - length) beyond it, and without that length before it, m and 1
    lateral, depth : of the fiber, m
    """

    place: float
    length: float
    origin: float
    slope: float
    lateral: float
    depth: float

    def route(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Straight route [distance, 3], m, of a fiber of which half of the coil counts on either side of its middle.

        >>> Coil(50.0, 20.0, 0.0, 1.0, 4.0, 0.9).route(np.array([60.0])).tolist()
        [[50.0, 4.0, 0.9]]
        """
        x = self.origin + self.slope * (distance - self.length / 2)
        return np.column_stack([x, np.full(len(x), self.lateral), np.full(len(x), self.depth)])


@dataclass(frozen=True)
class PerGauge:
    """Something at the ends of every gauge, its slope there, and the same within and where a loose length is held.

    What is not wanted is None.
    """

    ahead: Tensor
    behind: Tensor
    ahead_slope: Tensor
    behind_slope: Tensor
    inner: Tensor | None = None
    inner_slope: Tensor | None = None
    inner_bend: Tensor | None = None
    first: Tensor | None = None
    last: Tensor | None = None
    first_slope: Tensor | None = None
    last_slope: Tensor | None = None

    def present(self) -> dict[str, Tensor]:
        """The fields that are there, by name."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}


@dataclass(frozen=True)
class GaugeEnds(PerGauge):
    """Basis matrices at the two ends of every channel's gauge, and within it where they are wanted.

    Parameters
    ----------
    ahead, behind : [channel, coefficient], positions half a gauge length ahead and behind
    ahead_slope, behind_slope : [channel, coefficient], derivatives with respect to distance, 1/m
    inner, inner_slope, inner_bend : [channel, station, coefficient], within the gauge and two derivatives, or None
    first, last : [1, coefficient], positions of the two ends of a length that slips, or None
    first_slope, last_slope : [1, coefficient], derivatives with respect to distance, 1/m, or None
    """

    @classmethod
    def of(cls, basis: Basis, distance: NDArray[np.float64], gauge_length: float, inner: bool = False) -> "GaugeEnds":
        """Gauge ends of channels centered at `distance` [channel], m; with the `inner` stations if wanted."""
        ahead, behind = distance + gauge_length / 2, distance - gauge_length / 2
        matrices = [basis.at(where, order) for order in (0, 1) for where in (ahead, behind)]
        if inner:
            offsets, _ = stations(stations_within(gauge_length))
            within = distance[:, None] + offsets.numpy() * gauge_length
            matrices += [basis.at(within, order) for order in range(3)]
        return cls(*(torch.from_numpy(matrix) for matrix in matrices))

    @classmethod
    def at(
        cls,
        basis: SplineBasis,
        distance: Tensor,
        gauge_length: Tensor | float,
        inner: int,
        held: tuple[Tensor, Tensor] | None = None,
    ) -> "GaugeEnds":
        """The same, differentiable by distances [channel] and gauge lengths, m; with so many `inner` stations.

        `held` is where, along the route, m, both ends of a length that slips are.
        """
        ahead, behind = (distance + sign * torch.as_tensor(gauge_length) / 2 for sign in (1, -1))
        ends = [basis.weights(where, order) for order in (0, 1) for where in (ahead, behind)]
        more: list[Tensor | None] = [None] * 3
        if inner:
            within = distance[:, None] + stations(inner)[0] * torch.as_tensor(gauge_length)[..., None]
            more = [basis.weights(within, order) for order in range(3)]
        if held is not None:
            more += [basis.weights(where[None], order) for order in (0, 1) for where in held]
        return cls(*ends, *more)


@dataclass(frozen=True)
class Fiber(PerGauge):
    """The ends of every gauge and the fiber's direction there.

    Parameters
    ----------
    ahead, behind : [..., channel, 3], positions, m
    ahead_slope, behind_slope : [..., channel, 3], derivative of position with distance
    inner, inner_slope, inner_bend : [..., channel, station, 3], positions within the gauge and their first and second
        derivatives; None where the strain of a gauge is the motion of its ends alone
    first, last, first_slope, last_slope : [..., 1 or channel, 3], likewise where a loose length is held, or None
    """

    @classmethod
    def of(cls, ends: GaugeEnds, coefficients: Tensor) -> "Fiber":
        """Ends of a spline route with `coefficients` [knot, 3], m."""
        return cls(**{name: matrix @ coefficients for name, matrix in ends.present().items()})


def length(vectors: Tensor) -> Tensor:
    """Length [...] of vectors [..., 2 or 3], by components: several times as fast as a norm over a short axis.

    >>> length(torch.tensor([3.0, 0.0, 4.0])).item()
    5.0
    """
    return axial(vectors, vectors).sqrt()


def unit(vectors: Tensor) -> Tensor:
    """Vectors [..., 2 or 3] scaled to length 1.

    >>> unit(torch.tensor([3.0, 0.0, 4.0])).tolist()
    [0.6000000238418579, 0.0, 0.800000011920929]
    """
    return vectors / length(vectors)[..., None]


def axial(motion: Tensor, tangent: Tensor) -> Tensor:
    """Part of a motion [..., 2 or 3] along the fiber's unit tangent, likewise.

    >>> axial(torch.tensor([1.0, 2.0, 3.0]), torch.tensor([0.0, 1.0, 0.0])).item()
    2.0
    """
    first, *others = (motion * tangent).unbind(-1)
    return sum(others, first)


def turning(slope: Tensor, bend: Tensor) -> Tensor:
    """Derivative [..., 3] of the unit tangent by distance, of a curve with first and second derivatives [..., 3].

    >>> turning(torch.tensor([2.0, 0.0, 0.0]), torch.tensor([5.0, 1.0, 0.0])).tolist()
    [0.0, 0.5, 0.0]
    """
    tangent = unit(slope)
    return (bend - axial(bend, tangent)[..., None] * tangent) / length(slope)[..., None]


def between_channels(values: Tensor, distance: Tensor, place: Tensor) -> Tensor:
    """Values [channel] at ascending distances [channel], m, as they are at places [place]: linear, constant beyond.

    >>> between_channels(torch.tensor([0.0, 4.0]), torch.tensor([10.0, 20.0]), torch.tensor([5.0, 15.0])).tolist()
    [0.0, 2.0]
    """
    after = torch.searchsorted(distance, place.contiguous()).clamp(1, len(distance) - 1)
    share = ((place - distance[after - 1]) / (distance[after] - distance[after - 1])).clamp(0, 1)
    return (1 - share) * values[after - 1] + share * values[after]
