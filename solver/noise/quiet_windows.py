"""Noise per channel from quiet windows: samples with no vehicle within reach."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import ndtri

from solver.noise.whitening import Whitener
from solver.survey.das.rounding import Rounding
from solver.survey.limits import farther
from solver.trajectory.vehicle_pass import Pass

#: m; how far from the middle of a gauge of 10 m a vehicle must be.
REACH = 35.0
ENOUGH = 20
#: Channels that are processed together.
CHANNELS = 100
#: Rounding step, as a share of the noise, up to which it does no harm; and the number of steps beyond which all values
#: count alike.
FINE, LARGEST = 0.02, 1000


def quiet(samples: int, route: NDArray[np.float64], passes: Sequence[Pass], gauge_length: float) -> NDArray[np.bool_]:
    """Samples [sample, channel] with every known vehicle too far from the channel to be sensed, by its gauge length, m.

    Parameters
    ----------
    samples : number of rows of the record
    route : [channel, 2 or 3], rough positions, m
    """
    far, reach = np.ones((samples, len(route)), bool), REACH + farther(gauge_length)
    for first in range(0, len(route), CHANNELS):
        part = route[first : first + CHANNELS, :2]
        low, high = part.min(0) - reach, part.max(0) + reach
        for one in passes:
            near = ((one.position >= low) & (one.position <= high)).all(1)
            distance = np.hypot(*(one.position[near, None, :] - part[None, :, :]).transpose(2, 0, 1))
            far[one.rows[near], first : first + CHANNELS] &= distance > reach
    return far


def noise_level(strain_rate: NDArray[np.float64], still: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Standard deviation [channel] of the noise, 1/s, by the median absolute deviation of the quiet samples.

    A channel with fewer than 20 quiet samples is estimated from all its samples: traffic is too rare to affect the
    median.

    Parameters
    ----------
    strain_rate : [sample, channel], 1/s; NaN where not measured
    still : [sample, channel] bool, see `quiet`

    >>> rng = np.random.default_rng(0)
    >>> rate = rng.normal(0, 2e-9, (400, 3))
    >>> noise_level(rate, np.ones_like(rate, bool)).round(10)
    array([1.9e-09, 1.9e-09, 2.0e-09])
    """
    level = np.full(strain_rate.shape[1], np.nan)
    for first in range(0, len(level), CHANNELS):
        part = strain_rate[:, first : first + CHANNELS]
        measured: NDArray[np.bool_] = np.asarray(np.isfinite(part).any(1), np.bool_)
        measured[:1] = True  # there may be none
        part, finite = part[measured], np.isfinite(part[measured])
        use = still[measured, first : first + CHANNELS] & finite
        use = np.where(use.sum(0) >= ENOUGH, use, finite)
        # NaN sorts last, so that the middle of the first `count` values is the median.
        ordered = np.sort(np.where(use, np.abs(part), np.nan), axis=0)
        count = use.sum(0)
        middle = [np.take_along_axis(ordered, np.maximum(at, 0)[None], 0)[0] for at in ((count - 1) // 2, count // 2)]
        level[first : first + CHANNELS] = np.where(count > 0, 1.4826 * (middle[0] + middle[1]) / 2, np.nan)
    return level


def rounded_level(
    level: NDArray[np.float64], strain_rate: NDArray[np.float64], still: NDArray[np.bool_], rounding: Rounding | None
) -> NDArray[np.float64]:
    """Standard deviation [channel] of the noise, rounding error included, 1/s.

    The median of rounded samples is a whole number of steps, and 0 if the noise is below a step. The noise before
    rounding follows from the share of quiet samples within half a step (or one and a half, and so on) of zero.

    Parameters
    ----------
    level : as `noise_level` gives it
    strain_rate, still : [sample, channel], see `noise_level`
    rounding : of these channels

    >>> rng = np.random.default_rng(0)
    >>> rate = np.rint(rng.normal(0, [0.3, 1.0, 2.0], (4000, 3)))
    >>> quiet, one = np.ones_like(rate, bool), Rounding(np.ones(3), np.ones(1))
    >>> (rounded_level(noise_level(rate, quiet), rate, quiet, one) ** 2 - 1 / 12).round(2)
    array([0.09, 1.  , 4.04])
    """
    if rounding is None:
        return level
    if not rounding.whole:
        return np.where(np.isfinite(level), np.maximum(level, rounding.deviation), level)
    level = level.copy()
    for number in np.flatnonzero(np.isfinite(level) & (rounding.step > FINE * level)):
        finite = np.isfinite(strain_rate[:, number])
        use = still[:, number] & finite
        size = np.abs(strain_rate[use if use.sum() >= ENOUGH else finite, number])
        before = unrounded(size / rounding.step[number]) * rounding.step[number]
        level[number] = np.hypot(before, rounding.deviation[number])
    return level


def unrounded(size: NDArray[np.float64]) -> float:
    """Standard deviation, before rounding, of Gaussian noise with samples of absolute `size` [sample], in steps."""
    share = np.cumsum(np.bincount(np.minimum(np.rint(size), LARGEST).astype(int))) / len(size)
    within = int(np.abs(share - 0.5).argmin())
    return float((within + 0.5) / ndtri((1 + min(share[within], 1 - 0.5 / len(size))) / 2))


def whitened_noise(
    strain_rate: NDArray[np.float64], still: NDArray[np.bool_], whiten: Whitener
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A whole record [sample, channel] whitened, and where that is noise alone, [sample, channel] bool.

    Samples that are not noise are set to 0 first, so that a vehicle near one channel does not leak into all channels
    through the common mode; samples after it are left out for as long as the whitening filter remembers it.

    Parameters
    ----------
    strain_rate : [sample, channel], 1/s; NaN where not measured
    still : [sample, channel] bool, see `quiet`
    whiten : of all its samples and channels
    """
    level = whiten.level.numpy()
    noise = still & np.isfinite(strain_rate) & (np.abs(np.nan_to_num(strain_rate)) < 7 * level)
    white = whiten(torch.from_numpy(np.where(noise, strain_rate, 0.0)).double()).numpy()
    gone = np.cumsum(np.vstack([np.zeros((1, noise.shape[1])), ~noise]), 0)
    # The oldest samples weigh least: a quarter of the filter's memory holds nearly all of its weight.
    first = np.maximum(np.arange(1, len(noise) + 1) - max(1, len(whiten.law.own) // 4), 0)
    return white, gone[1:] - gone[first] == 0
