"""Where the model fails, in numbers: chi2 per channel, per pass, and both."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import FitResult
from solver.trajectory.vehicle_pass import Pass

BINS = 60  # most bins of channels


@dataclass(frozen=True)
class Misfit:
    """Mean squared residual in noise units, weights applied: 1 where only noise is left, NaN where no data are.

    Parameters
    ----------
    by_channel : [fitted]
    by_pass : [pass]
    edges : first channel of each bin of channels, and one beyond the last [bin + 1]
    by_pass_and_bin : [pass, bin]
    discounted : share of the measured samples that kept less than half their weight
    """

    by_channel: NDArray[np.float64]
    by_pass: NDArray[np.float64]
    edges: NDArray[np.int64]
    by_pass_and_bin: NDArray[np.float64]
    discounted: float


def ratio(square: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square / weight, NaN where there is no weight."""
    return np.divide(square, weight, out=np.full_like(square, np.nan), where=weight > 0)


def rows_of(result: FitResult, one: Pass) -> NDArray[np.int64]:
    """Which of the fitted samples belong to a pass, as indices [row]."""
    return np.flatnonzero(np.isin(result.samples, one.rows))


def bin_edges(result: FitResult, most: int = BINS) -> NDArray[np.int64]:
    """First channel of each of at most `most` bins over the fitted range, and one beyond the last."""
    first, last = int(result.fitted_channel[0]), int(result.fitted_channel[-1])
    width = -(-(last + 1 - first) // most)
    return np.arange(first, last + 1 + width, width)


def misfit_of(result: FitResult, passes: Sequence[Pass]) -> Misfit:
    """Sum up the weighted squared residuals of a fit.

    Samples that two passes share, since the vehicles meet, count for both.
    """
    residual = result.residual
    there = np.isfinite(residual)
    weight = np.where(there, result.weight, 0.0)
    square = weight * np.where(there, residual, 0.0) ** 2
    edges = bin_edges(result)
    starts = np.searchsorted(result.fitted_channel, edges[:-1])
    # [pass, fitted] sums over the samples of each pass, and [pass, bin] over the channels of each bin.
    of_pass = [np.array([part[rows_of(result, one)].sum(0) for one in passes]) for part in (square, weight)]
    binned = [np.add.reduceat(part, starts, axis=1) for part in of_pass]
    return Misfit(
        by_channel=ratio(square.sum(0), weight.sum(0)),
        by_pass=ratio(of_pass[0].sum(1), of_pass[1].sum(1)),
        edges=edges,
        by_pass_and_bin=ratio(binned[0], binned[1]),
        discounted=float((weight[there] < 0.5).mean()) if there.any() else 0.0,
    )


def whole_range(result: FitResult, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """`values` [sample, fitted] on all channels from the first fitted one to the last; NaN between."""
    column = result.fitted_channel - result.fitted_channel[0]
    out = np.full((len(values), int(column[-1]) + 1), np.nan)
    out[:, column] = values
    return out


def nearest_channel(result: FitResult, one: Pass) -> NDArray[np.float64]:
    """Channel [row] of the route point nearest to the vehicle; NaN where it is beyond the fitted ones."""
    middle = result.route[:, :2].mean(0)
    route = result.route[:, :2] - middle
    half = (route**2).sum(1) / 2
    # Of |place - route|^2 the part that differs along the route; row after row, since a drive has thousands of both.
    nearest = [int((half - route @ place).argmin()) for place in one.position - middle]
    channel = result.channel[nearest].astype(float)
    beyond = (channel <= result.fitted_channel[0]) | (channel >= result.fitted_channel[-1])
    return np.where(beyond, np.nan, channel)


def pass_label(one: Pass) -> str:
    """Name of a pass: track, class, direction along x."""
    return f"{one.track_id} · {one.vehicle_class} {'→' if one.speed > 0 else '←'}"
