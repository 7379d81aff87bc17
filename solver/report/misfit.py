"""Where the model fails, in numbers: chi2 per channel, per pass, and both."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import FitResult
from solver.trajectory import Pass


def chi2(result: FitResult) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weighted squared residual and weight of every sample, [sample, fitted]; 0 where not measured."""
    there = np.isfinite(result.residual)
    weight = np.where(there, result.weight, 0.0)
    return weight * np.where(there, result.residual, 0.0) ** 2, weight


def ratio(square: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square / weight, NaN where there is no weight."""
    return np.divide(square, weight, out=np.full_like(square, np.nan), where=weight > 0)


def by_channel(result: FitResult) -> NDArray[np.float64]:
    """Mean chi2 of each fitted channel, [fitted]; 1 where only noise is left."""
    square, weight = chi2(result)
    return ratio(square.sum(0), weight.sum(0))


def rows_of(result: FitResult, one: Pass) -> NDArray[np.bool_]:
    """Which of the fitted samples belong to a pass, [sample] bool."""
    return np.isin(result.samples, one.rows)


def bins(result: FitResult, width: int) -> NDArray[np.int64]:
    """First channel of each bin of `width` channels over the fitted range, and one beyond the last."""
    first, last = int(result.fitted_channel[0]), int(result.fitted_channel[-1])
    return np.arange(first, last + 1 + width, width)


def by_pass_and_channel(result: FitResult, passes: Sequence[Pass], edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean chi2 [pass, bin] of each pass in bins of channels that begin at `edges` [bin + 1]; NaN where no data."""
    square, weight = chi2(result)
    column = np.searchsorted(edges, result.fitted_channel, side="right") - 1
    out = np.empty((len(passes), len(edges) - 1))
    for i, one in enumerate(passes):
        rows = rows_of(result, one)
        sums = [np.bincount(column, part[rows].sum(0), len(edges) - 1).astype(float) for part in (square, weight)]
        out[i] = ratio(sums[0], sums[1])
    return out


def by_pass(result: FitResult, passes: Sequence[Pass]) -> NDArray[np.float64]:
    """Mean chi2 of each pass, [pass]; 1 where only noise is left, NaN where a pass has no fitted sample."""
    square, weight = chi2(result)
    rows = [rows_of(result, one) for one in passes]
    return np.array([ratio(square[r].sum(keepdims=True), weight[r].sum(keepdims=True)).item() for r in rows])


def discounted(result: FitResult) -> float:
    """Share of the measured samples that the robust likelihood gave less than half their weight."""
    there = np.isfinite(result.residual)
    return float((result.weight[there] < 0.5).mean()) if there.any() else 0.0
