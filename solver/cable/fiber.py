"""Cable stage: the fiber's route, a curve in three dimensions parametrised by its length."""

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from math import factorial
from typing import Protocol

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline
from torch import Tensor

DEGREE = 3


class Basis(Protocol):
    """Functions of the distance along the fiber whose sums are routes."""

    def at(self, distance: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]:
        """Matrix [distance, coefficient] of their values, or of a derivative by distance."""


@dataclass(frozen=True)
class SplineBasis:
    """Cubic B-splines over a stretch of fiber: local support, three dimensions alike.

    A route is `basis.at(s) @ coefficients` with coefficients [knot, 3] (x, y, z), m.

    Parameters
    ----------
    knots : ascending distances along the fiber, m, three of them beyond either end of the stretch

    >>> basis = SplineBasis.even(0.0, 100.0, 10.0)
    >>> basis.size
    13
    >>> SplineBasis.of([0.0, 10.0, 12.0, 20.0]).at(np.array([11.0])).sum().round(12)
    np.float64(1.0)
    """

    knots: tuple[float, ...]

    @classmethod
    def of(cls, breaks: ArrayLike) -> "SplineBasis":
        """On knots at the `breaks`, two at least; beyond either end they go on at the spacing there."""
        breaks, beyond = np.asarray(breaks, float), np.arange(1, DEGREE + 1)
        first, last = breaks[1] - breaks[0], breaks[-1] - breaks[-2]
        return cls(
            tuple(np.concatenate([breaks[0] - first * beyond[::-1], breaks, breaks[-1] + last * beyond]).tolist())
        )

    @classmethod
    def even(cls, start: float, stop: float, spacing: float) -> "SplineBasis":
        """On equal knots, of the spacing nearest to the one wanted, m, that divides the stretch."""
        return cls.of(np.linspace(start, stop, max(1, round((stop - start) / spacing)) + 1))

    @property
    def breaks(self) -> NDArray[np.float64]:
        """Knots from end to end of the stretch, m: between two of them a route is one cubic."""
        return np.array(self.knots[DEGREE:-DEGREE])

    @property
    def start(self) -> float:
        """Where the stretch begins, m."""
        return self.knots[DEGREE]

    @property
    def stop(self) -> float:
        """Where it ends, m."""
        return self.knots[-1 - DEGREE]

    @property
    def intervals(self) -> int:
        """Number of knot intervals."""
        return len(self.knots) - 2 * DEGREE - 1

    @property
    def size(self) -> int:
        """Number of coefficients per dimension."""
        return self.intervals + DEGREE

    def interval(self, distance: ArrayLike) -> NDArray[np.int64]:
        """Number of the interval that each distance lies in; beyond the ends that of the end."""
        found = np.searchsorted(self.breaks, distance, side="right") - 1
        return np.asarray(np.clip(found, 0, self.intervals - 1), np.int64)

    def part(self, first: int, last: int) -> "SplineBasis":
        """The same functions over the intervals `first` to `last`: of the coefficients from number `first` on.

        >>> basis = SplineBasis.even(0.0, 100.0, 10.0)
        >>> at = np.array([37.0])
        >>> bool(np.allclose(basis.part(3, 5).at(at), basis.at(at)[:, 3:8]))
        True
        """
        return SplineBasis(self.knots[first : last + 2 * DEGREE + 1])

    def along(
        self, coefficients: NDArray[np.float64], distance: NDArray[np.float64], derivative: int = 0
    ) -> NDArray[np.float64]:
        """Points [distance, ...] of the route with `coefficients` [coefficient, ...], without the whole matrix."""
        return np.asarray(BSpline(self.knots, coefficients, DEGREE, extrapolate=True)(distance, nu=derivative))

    def at(self, distance: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]:
        """Basis matrix [distance, coefficient], or its derivative with respect to distance."""
        spline = BSpline(self.knots, np.eye(self.size), DEGREE, extrapolate=True)
        return np.asarray(spline(distance, nu=derivative))

    @cached_property
    def cubics(self) -> Tensor:
        """Polynomials [interval, power, function], highest power first, of the four functions on each interval."""
        spline = BSpline(self.knots, np.eye(self.size), DEGREE)
        powers = [spline(self.breaks[:-1], nu=power) / factorial(power) for power in range(DEGREE, -1, -1)]
        rows = np.arange(self.intervals)[:, None]
        return torch.from_numpy(np.stack([one[rows, rows + np.arange(DEGREE + 1)] for one in powers], 1))

    def weights(self, distance: Tensor, derivative: int = 0) -> Tensor:
        """The same [..., coefficient] at a tensor of distances [...], differentiable; straight on beyond the ends."""
        inside = distance.clamp(self.start, self.stop)
        number = torch.from_numpy(self.interval(inside.detach().numpy()))
        u = (inside - torch.from_numpy(self.breaks)[number].to(distance.dtype))[..., None]
        a, b, c, d = self.cubics[number].unbind(-2)
        slope = (3 * a * u + 2 * b) * u + c
        if derivative == 2:
            values = torch.where((inside == distance)[..., None], 6 * a * u + 2 * b, 0.0)
        elif derivative == 1:
            values = slope
        else:
            values = ((a * u + b) * u + c) * u + d + (distance - inside)[..., None] * slope
        every = torch.zeros(*values.shape[:-1], self.size, dtype=values.dtype)
        return every.scatter(-1, number[..., None] + torch.arange(DEGREE + 1), values)

    def interpolate(self, distance: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coefficients [coefficient, 3] of the smoothest route near points [point, 3] at those distances, m.

        A stiff penalty on curvature settles what the points leave open. Banded normal equations: linear in length.
        """
        from scipy.linalg import solveh_banded
        from scipy.sparse import diags_array, vstack

        grid = np.interp(np.linspace(0, self.intervals, 4 * self.size), np.arange(self.intervals + 1), self.breaks)
        design = BSpline.design_matrix(distance, self.knots, DEGREE, extrapolate=True)
        # The second derivative of a cubic spline is linear between coefficients of its own (de Boor 2001, X.15).
        knots, differences = np.array(self.knots), None
        for degree in (DEGREE, DEGREE - 1):
            inner = knots[DEGREE + 1 - degree : len(knots) - (DEGREE + 1 - degree)]
            scale = degree / (inner[degree:] - inner[:-degree])
            count = len(scale)
            step = diags_array([-scale, scale], offsets=[0, 1], shape=(count, count + 1))
            differences = step if differences is None else step @ differences
        between = BSpline.design_matrix(grid, knots[2:-2], 1, extrapolate=True)
        matrix = vstack([design, 1e-3 * np.median(np.diff(self.breaks)) ** 2 * between @ differences]).tocsr()
        target = np.vstack([points, np.zeros((len(grid), points.shape[1]))])
        normal = (matrix.T @ matrix).todia()
        band = np.array([normal.diagonal(-k).tolist() + [0.0] * k for k in range(DEGREE + 1)])
        return np.asarray(solveh_banded(band, matrix.T @ target, lower=True), float)


#: Length of fiber, m, for which one station within a gauge stands: so a bend of a few meters within a long gauge is
#: seen; and how many there are at least.
PER_STATION, FEWEST_STATIONS = 2.5, 4


def stations_within(gauge_length: float, basis: Basis) -> int:
    """How many stations an integral along a gauge takes, on a route of some basis: one per knot at least.

    >>> even, fine = SplineBasis.even(0.0, 100.0, 10.0), SplineBasis.even(0.0, 100.0, 1.0)
    >>> stations_within(10.0, even), stations_within(50.0, even), stations_within(10.0, fine)
    (4, 20, 10)
    """
    closest = float(np.diff(basis.breaks).min()) if isinstance(basis, SplineBasis) else PER_STATION
    return max(FEWEST_STATIONS, round(gauge_length / min(PER_STATION, closest)))


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
            offsets, _ = stations(stations_within(gauge_length, basis))
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
