"""Noise per channel from quiet windows: samples with no vehicle within reach."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.trajectory import Pass

REACH = 35.0
ENOUGH = 20


def quiet(samples: int, route: NDArray[np.float64], passes: Sequence[Pass], reach: float = REACH) -> NDArray[np.bool_]:
    """Samples [sample, channel] with every known vehicle more than `reach` meters from the channel.

    Parameters
    ----------
    samples : number of rows of the record
    route : [channel, 2 or 3], rough positions, m
    """
    far = np.ones((samples, len(route)), bool)
    for one in passes:
        distance = np.hypot(*(one.position[:, None, :] - route[None, :, :2]).transpose(2, 0, 1))
        far[one.rows] &= distance > reach
    return far


def noise_level(strain_rate: NDArray[np.float64], still: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Standard deviation [channel] of the noise, 1/s, by the median absolute deviation of the quiet samples.

    Where a channel has fewer than 20 of them, all its samples serve: traffic is rare enough for the median to bear it.

    Parameters
    ----------
    strain_rate : [sample, channel], 1/s; NaN where not measured
    still : [sample, channel] bool, see `quiet`

    >>> rng = np.random.default_rng(0)
    >>> rate = rng.normal(0, 2e-9, (400, 3))
    >>> noise_level(rate, np.ones_like(rate, bool)).round(10)
    array([1.9e-09, 1.9e-09, 2.0e-09])
    """
    finite = np.isfinite(strain_rate)
    use = still & finite
    use = np.where(use.sum(0) >= ENOUGH, use, finite)
    absolute = np.ma.masked_array(np.abs(strain_rate), ~use)
    return np.asarray(1.4826 * np.ma.median(absolute, axis=0).filled(np.nan))
