"""Simple changes of a model's prediction: their derivatives at zero, and their effect at any size."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from solver.run.geojson import runs

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """A family of changes of the data [sample, channel], 1/s, by one number.

    Parameters
    ----------
    by : amount -> what is added to the data
    slope : amount -> its derivative by the amount
    """

    by: Callable[[float], Array]
    slope: Callable[[float], Array]


def linear(field: Array) -> Change:
    """Amounts of a field, such as the model itself (a gain) or a constant.

    >>> linear(np.ones((1, 2))).by(0.5).tolist()
    [[0.5, 0.5]]
    """
    return Change(lambda amount: amount * field, lambda amount: field)


def shifted(values: Array, at: Array, blocks: list[slice]) -> Change:
    """A shift toward larger `at` [point] of values [point, ...] that are smooth within each block.

    Ends of blocks keep their values; blocks of fewer than four points stay as they are. Points at which nothing is
    known, NaN, part blocks; a single value that is not known counts as 0, as what was not measured weighs nothing.

    >>> at = np.arange(6.0)
    >>> shifted(at[:, None] ** 2, at, [slice(0, 6)]).by(1.0)[2:, 0].round(6).tolist()
    [-3.0, -5.0, -7.0, -9.0]
    >>> shifted(np.where(at == 1, np.nan, at)[:, None], at, [slice(0, 6)]).slope(0.0)[:, 0].round(6).tolist()
    [0.0, 0.0, -1.0, -1.0, -1.0, -1.0]
    """
    there = np.asarray(np.isfinite(values).any(axis=tuple(range(1, values.ndim))))
    values = np.nan_to_num(values)
    found = [(block.start, there[block], runs(there[block])) for block in blocks]
    parts = [slice(first + a, first + b + 1) for first, known, each in found for a, b in each if known[a]]
    smooth = [(part, CubicSpline(at[part], values[part], axis=0)) for part in parts if len(at[part]) >= 4]

    def evaluated(amount: float, derivative: int) -> Array:
        out = np.zeros_like(values)
        for block, spline in smooth:
            where = np.clip(at[block] - amount, at[block][0], at[block][-1])
            out[block] = spline(where) - values[block] if derivative == 0 else -spline(where, derivative)
        return out

    return Change(lambda amount: evaluated(amount, 0), lambda amount: evaluated(amount, 1))


def transposed(change: Change) -> Change:
    """The same change with rows and columns exchanged."""
    return Change(lambda amount: change.by(amount).T, lambda amount: change.slope(amount).T)
