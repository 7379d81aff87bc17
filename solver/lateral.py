"""Widths of the responses -> how far to the side of the lanes the fiber lies, and on which side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.coupling import CouplingCurve
from solver.detections import Detections
from solver.wavelets import Array, best_scale, derivative_of_ricker

GRID = 0.1  # m, of the lateral positions tried
REACH = 15.0  # m to either side of the lanes
SLACK = 0.03  # meters to the side per meter of fiber that cost one standard deviation
SHAPE_ERROR = 0.02  # of a width: what the curve, made for one depth and a straight fiber, cannot follow
SCALE_ERROR = 0.1  # of all widths together: ground, gauge length, depth not as believed
WORST = 4.0  # standard deviations that one width may cost at most
SCALE_FACTORS = np.arange(0.85, 1.2, 0.025)


@dataclass(frozen=True)
class Widths:
    """Width of the response of each pass along the fiber.

    Parameters
    ----------
    channel : middle of each bin [bin], number
    lane : y of the vehicle beside it [pass, bin], m; NaN where it was not seen
    width, sigma : scale of the best wavelet and its standard deviation [pass, bin], m; NaN likewise
    """

    channel: Array
    lane: Array
    width: Array
    sigma: Array


@dataclass(frozen=True)
class Sides:
    """Lateral position of the fiber, and the other one that could be.

    Parameters
    ----------
    channel : [bin], number
    y, mirror : of the preferred route and of the best one on the other side of the traffic [bin], m
    evidence : by how much the widths fit the mirror worse, summed over passes and averaged over bins, in standard
        deviations; 0 where all vehicles use one lane
    width_factor : measured over modeled widths
    """

    channel: Array
    y: Array
    mirror: Array
    evidence: float
    width_factor: float


def relative_scale_error() -> float:
    """Standard deviation of ln(scale) of the best wavelet, times the amplitude SNR of the response.

    The Cramer-Rao bound for a wavelet psi of unit energy in white noise: 1 / |d psi / d ln scale|.

    >>> round(relative_scale_error(), 2)
    0.53
    """
    u = np.linspace(-8, 8, 4001)
    psi = derivative_of_ricker(u)
    psi /= np.linalg.norm(psi)
    return float(1 / np.linalg.norm(psi / 2 + u * np.gradient(psi, u)))


def binned_widths(edges: Array, detections: Sequence[Detections], scales: Array, channel_spacing: float) -> Widths:
    """Stack the correlation profiles of each pass in each bin and read its width.

    Parameters
    ----------
    edges : of the bins [bin + 1], channel numbers
    detections : of each pass, with the SNR to believe
    scales : of the bank, in channels
    channel_spacing : m
    """
    shape = (len(detections), len(edges) - 1)
    lane, width, sigma = (np.full(shape, np.nan) for _ in range(3))
    relative = relative_scale_error()
    for index, seen in enumerate(detections):
        inside = np.digitize(seen.channel, edges) - 1
        snr = 10 ** (seen.snr_db / 20)
        # Each frame counts by its SNR, not by its strength, so that one bad frame counts as one.
        profile = seen.profile / np.abs(seen.profile).max(1, keepdims=True) * snr[:, None]
        for number in np.unique(inside[(inside >= 0) & (inside < shape[1])]):
            use = inside == number
            width[index, number] = best_scale(profile[use].sum(0), scales) * channel_spacing
            error = np.hypot(SHAPE_ERROR, relative / np.linalg.norm(snr[use]))
            sigma[index, number] = width[index, number] * error
            lane[index, number] = seen.y[use].mean()
    return Widths((edges[1:] + edges[:-1]) / 2, lane, width, sigma)


def misfit(widths: Widths, curves: Sequence[CouplingCurve], grid: Array, factor: float) -> Array:
    """Misfit [bin, y] of the widths of all passes to a fiber at each y of the grid, in standard deviations."""
    total = np.zeros((len(widths.channel), len(grid)))
    for curve, lane, width, sigma in zip(curves, widths.lane, widths.width, widths.sigma, strict=True):
        seen = np.isfinite(width)
        model = factor * curve.width_at(grid - lane[seen, None])
        total[seen] += np.minimum(np.abs(width[seen, None] - model) / sigma[seen, None], WORST)
    return total


def cheapest_path(cost: Array, price: float) -> tuple[NDArray[np.int64], float]:
    """Path through columns of each row [row, column] of least cost, `price` for each column moved (dynamic program).

    >>> cheapest_path(np.array([[0.0, 9.0, 9.0], [3.0, 3.0, 0.0], [0.0, 9.0, 9.0]]), 1.0)[0].tolist()
    [0, 0, 0]
    """
    column = np.arange(cost.shape[1])
    sums = [cost[0]]
    for row in cost[1:]:
        # min over i of sums_i + price |i - j|: one sweep from the left, one from the right.
        left = np.minimum.accumulate(sums[-1] - price * column) + price * column
        right = np.minimum.accumulate((sums[-1] + price * column)[::-1])[::-1] - price * column
        sums.append(row + np.minimum(left, right))
    path = [int(sums[-1].argmin())]
    for before in sums[-2::-1]:
        path.append(int((before + price * np.abs(column - path[-1])).argmin()))
    return np.array(path[::-1]), float(sums[-1].min())


def best_route(
    widths: Widths, curves: Sequence[CouplingCurve], grid: Array, price: float, forbidden: NDArray[np.bool_]
) -> tuple[Array, float, float]:
    """Lateral position [bin], its cost and the common factor of the widths, of the cheapest allowed route."""
    routes = []
    for factor in SCALE_FACTORS:
        cost = np.where(forbidden, 1e6, misfit(widths, curves, grid, factor))
        path, total = cheapest_path(cost, price)
        belief = len(cost) * abs(factor - 1) / SCALE_ERROR
        routes.append((total + belief, factor, path))
    total, factor, path = min(routes, key=lambda route: route[0])
    return grid[path], total, float(factor)


def traffic_middle(lane: Array) -> Array:
    """Halfway between the outermost lanes [pass, bin] in each bin, m; that of the whole survey where none was seen.

    >>> traffic_middle(np.array([[0.0, 1.0, np.nan], [-3.0, np.nan, np.nan]])).tolist()
    [-1.5, 1.0, -0.25]
    """
    high, low = np.where(np.isnan(lane), -np.inf, lane).max(0), np.where(np.isnan(lane), np.inf, lane).min(0)
    seen = np.isfinite(high)
    middle = np.where(seen, (np.where(seen, high, 0.0) + np.where(seen, low, 0.0)) / 2, np.nan)
    return np.where(seen, middle, np.median(middle[seen]))


def locate_sides(widths: Widths, curves: Sequence[CouplingCurve], channel_spacing: float) -> Sides:
    """Find the lateral position of the fiber, and its best alternative on the other side of the traffic.

    One lane cannot tell left from right; of two, the one nearer to the fiber sees it narrower.

    Parameters
    ----------
    widths : of all passes
    curves : coupling curve of each pass
    channel_spacing : m
    """
    grid = np.arange(np.nanmin(widths.lane) - REACH, np.nanmax(widths.lane) + REACH, GRID)
    step = np.diff(widths.channel).mean() * channel_spacing if len(widths.channel) > 1 else 1.0
    price = GRID / (SLACK * step)
    middle = traffic_middle(widths.lane)
    free = np.zeros((len(middle), len(grid)), bool)
    y, cost, factor = best_route(widths, curves, grid, price, free)
    same_side = np.sign(grid - middle[:, None]) == np.sign(y - middle)[:, None]
    mirror, other, _ = best_route(widths, curves, grid, price, same_side)
    return Sides(widths.channel, y, mirror, max(other - cost, 0.0) / len(middle), factor)
