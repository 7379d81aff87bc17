"""Widths of the responses -> how far to the side of the lanes the fiber lies, and on which side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.start.coupling_curve import CouplingCurve
from solver.start.detections import Detections
from solver.start.wavelets import Array, best_scale, derivative_of_ricker

GRID = 0.1  # m, of the lateral positions tried
REACH = 15.0  # m to either side of the lanes
SLACK = 0.1  # meters to the side per meter of fiber that cost one standard deviation
SHAPE_ERROR = 0.02  # of a width: what the curve, made for one depth and a straight fiber, cannot follow
WIDTH_ERROR = 0.05  # of all widths together: ground, gauge length, wheels not as assumed
DEPTH_ERROR = 0.33  # of the depth
WORST = 4.0  # standard deviations that one width may cost at most
FARTHER = 0.02  # standard deviations per meter off the traffic's middle: what decides where widths tell nothing
FORBIDDEN = 1e6
WIDTH_FACTORS = np.arange(0.85, 1.2, 0.05)


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
    depth_factor : best depth over the prior mean
    """

    channel: Array
    y: Array
    mirror: Array
    evidence: float
    width_factor: float
    depth_factor: float


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
    detections : of each pass, with the SNR to weigh them by
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


def misfit(widths: Widths, model: Array) -> Array:
    """Misfit [bin, y] of the widths of all passes to modeled ones [pass, bin, y], in standard deviations.

    One pass costs at most four in a bin; where it was not seen it costs nothing.
    """
    off = np.abs(widths.width[:, :, None] - model) / widths.sigma[:, :, None]
    return np.asarray(np.nan_to_num(np.minimum(off, WORST)).sum(0))


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
    costs: Sequence[tuple[Array, float]], price: float, allowed: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], float, int]:
    """Cheapest allowed route through any of the `costs` [bin, y], each with a cost per bin of its own.

    Returns
    -------
    path : index of y [bin]
    total : its cost
    which : of the costs
    """
    routes = []
    for which, (cost, extra) in enumerate(costs):
        path, total = cheapest_path(np.where(allowed, cost, FORBIDDEN), price)
        routes.append((total + extra * len(cost), which, path))
    total, which, path = min(routes, key=lambda route: route[0])
    return path, total, which


def traffic_middle(lane: Array) -> Array:
    """Halfway between the outermost lanes [pass, bin] in each bin, m; that of the whole survey where none was seen.

    >>> traffic_middle(np.array([[0.0, 1.0, np.nan], [-3.0, np.nan, np.nan]])).tolist()
    [-1.5, 1.0, -0.25]
    """
    high, low = np.where(np.isnan(lane), -np.inf, lane).max(0), np.where(np.isnan(lane), np.inf, lane).min(0)
    seen = np.isfinite(high)
    middle = np.where(seen, (np.where(seen, high, 0.0) + np.where(seen, low, 0.0)) / 2, np.nan)
    return np.where(seen, middle, np.median(middle[seen]))


def locate_sides(widths: Widths, curves: Sequence[dict[float, CouplingCurve]], channel_spacing: float) -> Sides:
    """Find the lateral position of the fiber, and its best alternative on the other side of the traffic.

    One lane cannot tell left from right; of two, the one nearer to the fiber sees it narrower. The depth and a factor
    common to all widths are tried along with the positions, since both move the widths of all passes.

    Parameters
    ----------
    widths : of all passes
    curves : coupling curve by depth, in units of the prior mean, of each pass
    channel_spacing : m
    """
    grid = np.arange(np.nanmin(widths.lane) - REACH, np.nanmax(widths.lane) + REACH, GRID)
    step = np.diff(widths.channel).mean() * channel_spacing if len(widths.channel) > 1 else 1.0
    price = GRID / (SLACK * step)
    offset = np.abs(grid - widths.lane[:, :, None])
    middle = traffic_middle(widths.lane)[:, None]
    costs, factors = [], []
    for depth in curves[0]:
        model = np.stack([curve[depth].width_at(off) for curve, off in zip(curves, offset, strict=True)])
        for factor in WIDTH_FACTORS:
            unlikely = abs(factor - 1) / WIDTH_ERROR + abs(depth - 1) / DEPTH_ERROR
            costs.append((misfit(widths, factor * model) + FARTHER * np.abs(grid - middle), unlikely))
            factors.append((float(factor), depth))
    path, cost, which = best_route(costs, price, np.ones((len(middle), len(grid)), bool))
    opposite = (grid >= middle) != (grid[path][:, None] >= middle)
    mirror, other, _ = best_route(costs, price, opposite)
    evidence = max(other - cost, 0.0) / len(middle)
    return Sides(widths.channel, grid[path], grid[mirror], evidence, *factors[which])
