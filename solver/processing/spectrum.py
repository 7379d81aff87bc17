"""Filters that a record went through before, as its noise and its very values show them."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: s; blocks whose spectra are averaged.
BLOCK = 25.0
#: Highest frequencies, Hz, and lowest speeds, m/s, that FK filters are tried to have kept.
HIGHEST, SLOWEST = (0.5, 0.7, 1.0, 1.4, 2.0), (1.5, 2.5, 4.0, 6.0)
#: Least wavenumber that is looked at, 1/m, and how many cells of the spectrum on each side.
LONGEST, CELLS = 0.03, 20
#: Neighbors that are compared at once: some tens of seconds, in which noise is about as loud.
PART = 500


def power(record: Array, sampling_rate: float, spacing: float) -> tuple[Array, Array, Array]:
    """Mean power [frequency, wavenumber] of a record [sample, channel], the frequencies, Hz, and wavenumbers, 1/m.

    Blocks overlap by half and fade at all edges (Welch 1967, IEEE Trans. Audio 15, 70); what was not measured is 0.

    Parameters
    ----------
    record : in any unit
    sampling_rate : Hz
    spacing : of the channels, m
    """
    rows = min(len(record), round(BLOCK * sampling_rate))
    fade = np.hanning(rows)[:, None] * np.hanning(record.shape[1])
    starts = range(0, len(record) - rows + 1, max(1, rows // 2))
    whole = np.nan_to_num(record)
    total = np.mean([np.abs(np.fft.rfft2(whole[s : s + rows] * fade)) ** 2 for s in starts], axis=0)
    frequency = np.abs(np.fft.fftfreq(rows, 1 / sampling_rate))
    return np.asarray(total), frequency, np.asarray(np.fft.rfftfreq(record.shape[1], spacing))


def fan_contrast(record: Array, sampling_rate: float, spacing: float) -> float:
    """Power of the noise within the pass band of an FK filter over that outside, for the best of some such bands.

    Compared is noise of about the same wavelengths and frequencies on either side of the highest frequency and of the
    lowest speed, the smaller contrast of the two; about 1 if nothing was filtered, nan where the sampling cannot tell.

    Parameters
    ----------
    record : [sample, channel] of noise alone, NaN where vehicles are near

    >>> rng = np.random.default_rng(0)
    >>> noise = rng.normal(size=(600, 100))
    >>> round(fan_contrast(noise, 5.0, 1.0), 1)
    1.1
    >>> import torch
    >>> from solver.processing import fk_filter
    >>> fan_contrast(fk_filter(torch.from_numpy(noise), 0.2, 1.0).numpy(), 5.0, 1.0) > 100
    True
    """
    total, frequency, wavenumber = power(record, sampling_rate, spacing)
    f, k = frequency[:, None], wavenumber[None, :]
    speed, long = f / np.maximum(k, 1e-9), k > LONGEST
    best = float("nan")
    for highest, slowest in product(HIGHEST, SLOWEST):
        near = (f > 0.6 * highest) & (f < 0.9 * highest)
        inside = near & long & (speed > 1.2 * slowest)
        fast = (f > 1.4 * highest) & long & (k < highest / slowest)
        slow = near & (speed < 0.7 * slowest)
        if min(inside.sum(), fast.sum(), slow.sum()) >= CELLS:
            # Medians: a machine hums at one frequency.
            level = [float(np.median(total[where])) for where in (inside, fast, slow)]
            best = float(np.fmax(best, level[0] / max(*level[1:], 1e-300)))
    return best


def repeated_share(record: Array) -> float:
    """Share of samples that are exactly their neighbor's in time or along the fiber, beyond what rounding explains.

    A median is one of the samples themselves, and often that of the next window too. Rounded samples agree as well, and
    then others differ by one step and by two. Differences whose density is log-concave, with shares p0, p1 and p2 of
    0, 1 and 2 steps either way, keep it when they are rounded (Prekopa 1973, Acta Scientiarum Mathematicarum 34, 335):
    p0 p2 <= p1^2. What p0 has beyond that no rounding made.

    Parameters
    ----------
    record : [sample, channel] of noise alone, NaN where vehicles are near

    >>> rng = np.random.default_rng(0)
    >>> noise = rng.normal(size=(400, 60))
    >>> from scipy.ndimage import median_filter
    >>> abs(round(repeated_share(noise), 2)), repeated_share(median_filter(noise, (3, 5))) > 0.1
    (0.0, True)
    >>> [repeated_share(step * np.rint(noise / step)) < 0.01 for step in (0.01, 0.3, 1.0, 3.0)]
    [True, True, True, True]
    """
    return max(repeated_in_time(record), repeated_in_time(record.T))


def repeated_in_time(record: Array) -> float:
    """The same for neighbors along the first axis.

    Noise that is louder at times is a mixture of densities, which is not log-concave: each channel is judged in parts
    of `PART` samples, and their mean counts.
    """
    apart = np.abs(np.diff(record, axis=0))
    apart = apart[:, (np.nan_to_num(apart) > 0).any(0)]
    if apart.size == 0:
        return 0.0
    steps = np.rint(apart / np.nanmin(np.where(apart > 0, apart, np.inf), axis=0))
    parts = np.array_split(steps, max(1, len(steps) // PART))
    none, one, two = (np.stack([(part == number).sum(0) for part in parts]) for number in range(3))
    count = np.stack([np.isfinite(part).sum(0) for part in parts])
    # Shares of both signs together: p1 = one / 2, p2 = two / 2; one more of each where there are none of two steps.
    explained = np.minimum(count, (one + 1) ** 2 / (2 * (two + 1)))
    return float((none - explained).sum() / count.sum())
