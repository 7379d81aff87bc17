"""2-D median filter: spikes go, edges stay."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.record import DASRecord
from vision.contract import InputError, progress

Array = NDArray[np.float64]

#: Samples and channels of the window.
SIZE = (3, 3)
BLOCK = 2_000_000  # values that are sorted at once


def median_filtered(record: DASRecord, size: tuple[int, int] = SIZE) -> DASRecord:
    """Replace every sample of a record by the median of the window around it (Tukey 1977).

    y[t, c] = median of x[t + i, c + j] over |i| <= size[0] // 2, |j| <= size[1] // 2

    What is not measured does not count in a window and stays NaN; at the ends the window is cut. The filter is not
    linear, so a model can only be filtered alike where it is nearly noise-free.

    Parameters
    ----------
    record : strain rate
    size : samples and channels of the window, odd

    Raises
    ------
    InputError
        If a size is not odd and positive.

    Examples
    --------
    >>> spiky = np.zeros((5, 5))
    >>> spiky[2, 2], spiky[4, 0] = 9.0, np.nan
    >>> number = np.arange(5)
    >>> time = number / 5.0
    >>> record = DASRecord(spiky, time, np.datetime64(0, "ns"), number * 1.0, number, 10.0, 1.0, 5.0, (), {})
    >>> median_filtered(record).strain_rate[[2, 4], [2, 0]].tolist()
    [0.0, nan]
    """
    if any(extent < 1 or extent % 2 == 0 for extent in size):
        raise InputError(f"median filter: size is {list(size)}; give odd numbers of samples and channels")
    values = record.strain_rate
    half = size[0] // 2
    rows = max(1, BLOCK // (values.shape[1] * size[0] * size[1]))
    filtered = np.empty_like(values)
    padded = np.pad(values, [(extent // 2, extent // 2) for extent in size], constant_values=np.nan)
    with progress("median filter", len(values)) as advance:
        for first in range(0, len(values), rows):
            block = padded[first : first + rows + 2 * half]
            filtered[first : first + rows] = windows_median(block, size)
            advance(min(rows, len(values) - first))
    filtered[~np.isfinite(values)] = np.nan
    done = f"{size[0]} samples by {size[1]} channels"
    return replace(record, strain_rate=filtered, provenance=record.provenance | {"median_filtered": done})


def windows_median(padded: Array, size: tuple[int, int]) -> Array:
    """Median, NaN left out, of every window within `padded` [row, channel]; NaN for a window of NaN.

    >>> windows_median(np.array([[1.0, np.nan, 5.0, np.nan, np.nan, np.nan]]), (1, 3)).tolist()
    [[3.0, 5.0, 5.0, nan]]
    """
    windows = np.lib.stride_tricks.sliding_window_view(padded, size)
    # NaN sort last, so the finite ones are the first `count`.
    ordered = np.sort(windows.reshape(*windows.shape[:2], -1), axis=-1)
    count = np.isfinite(ordered).sum(-1, keepdims=True)
    low, high = (
        np.take_along_axis(ordered, np.maximum(place, 0), -1)[..., 0] for place in ((count - 1) // 2, count // 2)
    )
    return np.asarray((low + high) / 2)
