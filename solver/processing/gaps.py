"""What a filter must know of a record: where it is whole."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def runs(measured: NDArray[np.bool_]) -> list[slice]:
    """Stretches of rows without a gap.

    Parameters
    ----------
    measured : [row], false in gaps

    >>> runs(np.array([False, True, True, False, True]))
    [slice(1, 3, None), slice(4, 5, None)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], measured, [False]]).astype(int)))
    return [slice(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def interpolated(strain_rate: Array) -> Array:
    """Fill NaN linearly along the channels of each row [row, channel]; a row of NaN becomes 0.

    >>> interpolated(np.array([[1.0, np.nan, 3.0, np.nan]])).tolist()
    [[1.0, 2.0, 3.0, 3.0]]
    """
    filled = strain_rate.copy()
    place = np.arange(strain_rate.shape[1])
    finite = np.isfinite(strain_rate)
    for row in np.flatnonzero(~finite.all(1)):
        known = finite[row]
        filled[row] = np.interp(place, place[known], strain_rate[row, known]) if known.any() else 0.0
    return filled
