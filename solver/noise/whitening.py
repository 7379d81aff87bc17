"""Noise that is correlated in time and across channels: its law, and the linear map that makes it white.

The record's noise, in units of each channel's level, is modeled as the sum of each channel's own noise and a common
mode that all channels share (laser phase noise, trains, a vibrating instrument). Both are stationary in time; own noise
may also be correlated between neighboring channels, as overlapping gauges make it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.noise.law import NoiseLaw
from solver.noise.prediction import PredictionFilter
from solver.noise.sample_runs import blocks_of

Array = NDArray[np.float64]

#: Longest correlation of the noise in time that is estimated, s, and samples.
MEMORY, LONGEST = 8.0, 40
#: A record with a larger share of rows near a sample is taken as it is, gaps included.
DENSE = 0.8
#: Correlations between channels below this are within the scatter of their estimate.
SPATIAL_FLOOR = 0.04
#: Range of correlated neighbors: at least so many channels, and so many gauge lengths. The noise of overlapping gauges
#: correlates over one gauge length; lags twice as large are needed, as the farther half is tapered.
NEIGHBORS, GAUGES = 24, 2.4


def positive(covariance: Array) -> Array:
    """The nearest autocovariance [lag] whose spectrum is nowhere below 2 % of its mean, its older half tapered to 0."""
    age = np.clip(2 * np.arange(len(covariance)) / len(covariance) - 1, 0, None)
    taper = 0.5 * (1 + np.cos(np.pi * age))
    size = 8 * len(covariance)
    spectrum = np.fft.rfft(np.concatenate([covariance * taper, np.zeros(size), (covariance * taper)[:0:-1]])).real
    floor = np.maximum(spectrum, 0.02 * covariance[0])
    return np.asarray(np.fft.irfft(floor, size + 2 * len(covariance) - 1)[: len(covariance)])


def noise_law(
    record: Array,
    still: NDArray[np.bool_],
    sampling_rate: float,
    gauge: float = 1.0,
    rounding: Array | None = None,
) -> NoiseLaw:
    """Estimate the noise from quiet samples.

    Parameters
    ----------
    record : [sample, channel], measured strain rate in units of each channel's noise level; NaN = not measured
    still : [sample, channel] bool, no vehicle near
    sampling_rate : Hz
    gauge : gauge length, channels
    rounding : autocovariance [lag] of the error of rounding, in units of the noise level squared

    Notes
    -----
    Products of quiet samples are averaged over pairs of channels at every lag: pairs of distant channels contain the
    common mode alone, pairs within one channel contain both parts. Samples beyond 5 sigma are left out.
    """
    lags = int(np.clip(round(MEMORY * sampling_rate), 4, LONGEST)) + 1
    lags = min(lags, max(1, len(record) // 8))
    some = measured_rows(record, lags)
    record, still = record[some], still[some]
    use = still & np.isfinite(record) & (np.abs(np.nan_to_num(record)) < 5)
    value = np.where(use, np.nan_to_num(record), 0.0)
    count = use.astype(float)
    number = count.sum(1)
    reach = reach_of(value.shape[1], gauge)
    far, far_count = beyond_neighbors(value, reach), beyond_neighbors(count, reach)
    both, common = np.zeros(lags), np.zeros(lags)
    for lag in range(lags):
        ahead, behind = slice(lag, None), slice(None, len(value) - lag)
        alone, pairs = (value[ahead] * value[behind]).sum(), (count[ahead] * count[behind]).sum()
        crossed, cross_pairs = (value[ahead] * far[behind]).sum(), (count[ahead] * far_count[behind]).sum()
        both[lag] = alone / max(pairs, 1.0)
        common[lag] = crossed / max(cross_pairs, 1.0)
    hidden = np.array([0.0])
    if rounding is not None and rounding[0] > 0:
        hidden = min(max(1.0 - both[0], 0.0), float(rounding[0])) * rounding[:lags] / rounding[0]
    if both[0] <= 0 or use.sum() < 50 * lags:
        return replace(NoiseLaw.white(), hidden=hidden)
    # What too few quiet samples cannot distinguish from zero is set to zero.
    moments = max(1.0, float((number > 1).sum()))
    common = np.where(common[0] > 3 / np.sqrt(moments) * both[0] / max(number.mean(), 1.0), common, 0.0)
    own = both - common
    own[: len(hidden)] += hidden
    common = positive(common) if common[0] > 0 else common
    return NoiseLaw(positive(own), common, across(value, count, common[0], reach), hidden)


def measured_rows(record: Array, lags: int) -> slice | NDArray[np.int64]:
    """Rows of a record [row, channel] with samples, and `lags` more after them; a slice of all if few have none.

    Between what is kept of two spans, gaps stay longer than any lag, so that no product reaches across one.

    >>> measured_rows(np.array([1.0, np.nan, np.nan, np.nan, np.nan, np.nan, 2.0, 3.0])[:, None], 2).tolist()
    [0, 1, 2, 6, 7]
    """
    measured = np.isfinite(record).any(1)
    number = np.arange(len(record))
    since = number - np.maximum.accumulate(np.where(measured, number, -len(record)))
    near = since <= lags
    return slice(None) if near.mean() > DENSE else np.flatnonzero(near)


def reach_of(channels: int, gauge: float) -> int:
    """Neighbors on either side that noise may correlate with, given the counts of channels in all and per gauge.

    >>> reach_of(116, 9.8), reach_of(400, 40.0), reach_of(40, 40.0)
    (24, 96, 10)
    """
    return min(max(NEIGHBORS, round(GAUGES * gauge)), channels // 4)


def beyond_neighbors(value: Array, reach: int) -> Array:
    """Sum [sample, channel] over all channels except each one and its neighbors.

    >>> beyond_neighbors(np.ones((1, 8)), 2).tolist()
    [[5.0, 4.0, 3.0, 3.0, 3.0, 3.0, 4.0, 5.0]]
    """
    channels = value.shape[1]
    summed = np.pad(np.cumsum(value, 1), ((0, 0), (1, 0)))
    at = np.arange(channels)
    near = summed[:, np.minimum(at + reach + 1, channels)] - summed[:, np.maximum(at - reach, 0)]
    return np.asarray(summed[:, -1:] - near)


def across(value: Array, count: Array, common: float, reach: int) -> Array:
    """Correlation [lag] of the own noise between channels; (1,) if neighbors are independent."""
    variance = float((value**2).sum() / max(count.sum(), 1.0)) - common
    result = np.ones(1)
    for lag in range(1, reach + 1):
        pairs = (count[:, lag:] * count[:, :-lag]).sum()
        mean = (value[:, lag:] * value[:, :-lag]).sum() / max(pairs, 1.0)
        result = np.append(result, (mean - common) / variance)
    return positive(result) if len(result) > 1 and np.abs(result[1:]).max() > SPATIAL_FLOOR else np.ones(1)


@dataclass(frozen=True)
class Whitener:
    """Linear map of [sample, channel, ...] to unit, uncorrelated noise.

    Parameters
    ----------
    level : [channel], standard deviation of each channel's noise
    samples : [sample], rows of the record, ascending
    position : [channel], number of each channel; neighbors differ by 1
    law : of the noise
    lead : how many of the first samples only feed the filter and are left out of the result
    """

    level: Tensor
    samples: NDArray[np.int64]
    position: NDArray[np.int64]
    law: NoiseLaw
    lead: int = 0

    @property
    def memory(self) -> int:
        """How many past samples the filter uses."""
        return len(self.law.own) - 1

    @cached_property
    def _parts(self) -> tuple[Tensor, PredictionFilter]:
        """Mixing of channels, and the filter after it.

        The common mode's direction holds both parts; all other directions hold own noise only.
        """
        spatial, blocks = torch.from_numpy(self._spatial()), blocks_of(self.samples)
        own = PredictionFilter.of(self.law.own, blocks, self.lead)
        if not self.law.common[0] > 0:
            return spatial, own
        ones = spatial.sum(1).numpy()
        size = float(np.linalg.norm(ones))
        both = PredictionFilter.of(self.law.own + size**2 * self.law.common, blocks, self.lead)
        return spatial, own.along(ones / size, both)

    def _spatial(self) -> Array:
        """Inverse square root [channel, channel] of the correlation between channels."""
        lag = np.abs(self.position[:, None] - self.position[None, :])
        known = np.append(self.law.across, 0.0)
        matrix = known[np.minimum(lag, len(known) - 1)]
        if len(self.law.across) == 1:
            return np.eye(len(matrix))
        values, vectors = np.linalg.eigh(matrix)
        return np.asarray(vectors / np.sqrt(np.maximum(values, 0.02)) @ vectors.T)

    def __call__(self, values: Tensor) -> Tensor:
        """Whiten maps [..., sample, channel], in the record's unit; 0 where not measured.

        The first `lead` samples feed the filter and are left out of the result.
        """
        return self.weighing()(values)

    def weighing(self, good: Tensor | None = None, scale: Tensor | None = None) -> Callable[[Tensor], Tensor]:
        """The same of maps that are multiplied by something first, and in the end.

        Parameters
        ----------
        good : [sample, channel], of the maps
        scale : [sample after the lead, channel], of the result
        """
        spatial, filtered = self._parts
        if len(self.law.across) == 1:
            return filtered.between((1.0 if good is None else good) / self.level, scale)
        mixing, last = (spatial / self.level).T, filtered.between(None, scale)
        return lambda values: last((values if good is None else values * good) @ mixing)
