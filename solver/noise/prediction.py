"""Prediction filters along time: what is new in each sample of stationary noise, in units of its standard deviation."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.compiled import compiled

Array = NDArray[np.float64]


def levinson(covariance: Array) -> list[Array]:
    """Predictors of every order up to the longest (Levinson 1947; Durbin 1960).

    Parameters
    ----------
    covariance : [lag], autocovariance from lag 0 on

    Returns
    -------
    whitening coefficients of order 0, 1, ... [order + 1]: the sum of the newest and past samples weighted by them has
    unit variance

    >>> [row.round(3).tolist() for row in levinson(np.array([1.0, 0.5, 0.25]))]
    [[1.0], [1.155, -0.577], [1.155, -0.577, 0.0]]
    """
    error = covariance[0]
    predictor = np.array([1.0])
    rows = [predictor / np.sqrt(error)]
    for lag in range(1, len(covariance)):
        reflection = -float(predictor @ covariance[lag:0:-1]) / error
        padded = np.append(predictor, 0.0)
        predictor = padded + reflection * padded[::-1]
        error *= 1 - reflection**2
        rows.append(predictor / np.sqrt(error))
    return rows


@dataclass(frozen=True)
class PredictionFilter:
    """Filter along time with predictors of growing order, each block from its own start.

    Parameters
    ----------
    weights : [order, lag], of the newest and past samples
    order : [sample], which predictor a sample has
    lead : how many of the first samples only feed the filter
    direction : [channel], a unit vector along which weights are others; none where empty
    more : [order, lag], how much larger they are there
    before, after : [1 or sample, 1 or channel], what values are multiplied by first, and what comes of them
    """

    weights: Array
    order: NDArray[np.int64]
    lead: int = 0
    direction: Array = field(default_factory=lambda: np.zeros(0))
    more: Array = field(default_factory=lambda: np.zeros((0, 0)))
    before: Array = field(default_factory=lambda: np.ones((1, 1)))
    after: Array = field(default_factory=lambda: np.ones((1, 1)))

    @classmethod
    def of(cls, covariance: Array, blocks: list[slice], lead: int = 0) -> "PredictionFilter":
        """The filter that makes noise of an autocovariance [lag] white, on blocks of samples."""
        rows = levinson(covariance)
        weights = np.zeros((len(rows), len(rows)))
        for number, row in enumerate(rows):
            weights[number, : len(row)] = row
        ages = [np.arange(block.stop - block.start) for block in blocks]
        return cls(weights, np.minimum(np.concatenate(ages), len(rows) - 1), lead)

    def along(self, direction: Array, other: "PredictionFilter") -> "PredictionFilter":
        """The same with another filter along a unit vector [channel]."""
        return replace(self, direction=direction, more=other.weights - self.weights)

    def between(self, before: Tensor | None, after: Tensor | None) -> "PredictionFilter":
        """The same between factors [(sample,) channel]; before it of all samples, after it of those after the lead."""
        return replace(self, before=factors(before), after=factors(after))

    def __call__(self, values: Tensor) -> Tensor:
        """Filter values [..., sample, channel].

        >>> blocks = [slice(0, 2), slice(2, 3)]
        >>> PredictionFilter.of(np.array([1.0, 0.6]), blocks)(torch.ones(3, 1, dtype=torch.float64))[:, 0]
        tensor([1.0000, 0.5000, 1.0000], dtype=torch.float64)
        """
        maps = values.double().reshape(-1, *values.shape[-2:])
        found: Tensor = _Filtered.apply(maps, self)
        return found.reshape(*values.shape[:-2], *found.shape[1:])


def factors(some: Tensor | None) -> Array:
    """Factors [1 or sample, 1 or channel], 1 where there are none."""
    return np.ones((1, 1)) if some is None else np.atleast_2d(some.double().numpy())


def of_channels(some: Array, channels: int) -> Array:
    """Factors [1 or sample, channel]."""
    return np.ascontiguousarray(np.broadcast_to(some, (len(some), channels)))


class _Filtered(torch.autograd.Function):
    """Maps [map, sample, channel] filtered, and the transpose of that for gradients."""

    @staticmethod
    def forward(ctx: Any, maps: Tensor, by: PredictionFilter) -> Tensor:
        """Filter."""
        ctx.by = by
        out = maps.new_zeros(len(maps), maps.shape[1] - by.lead, maps.shape[2])
        before, after = (of_channels(some, maps.shape[2]) for some in (by.before, by.after))
        around = before, after, by.direction
        filter_maps(maps.contiguous().numpy(), by.weights, by.more, by.order, by.lead, *around, out.numpy())
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        """Filter the other way."""
        by = ctx.by
        gradient = (gradients[0] * torch.from_numpy(by.after)).contiguous()
        size = len(gradient), gradient.shape[1] + by.lead
        out = gradient.new_zeros(*size, gradient.shape[2])
        filter_back(gradient.numpy(), by.weights, by.order, by.lead, out.numpy())
        if len(by.direction):
            direction = torch.from_numpy(by.direction)
            common, shared = gradient.new_zeros(*size, 1), (gradient @ direction)[..., None]
            filter_back(shared.contiguous().numpy(), by.more, by.order, by.lead, common.numpy())
            out += common * direction
        return out * torch.from_numpy(by.before), None


@partial(compiled, fastmath={"contract"})
def filter_maps(
    maps: Array,
    weights: Array,
    more: Array,
    order: NDArray[np.int64],
    lead: int,
    before: Array,
    after: Array,
    direction: Array,
    out: Array,
) -> None:
    """Each sample and those before it, weighted; where nothing acts, as of a vehicle that is gone, it takes no time.

    Parameters
    ----------
    maps : [map, sample, channel]
    weights, more, order, lead, direction : as of `PredictionFilter`
    before, after : the same, [1 or sample, channel]
    out : [map, sample after the lead, channel], zero
    """
    samples, channels = maps.shape[1:]
    count, shared = np.zeros(samples + 1, np.int64), np.zeros(samples)
    scaled, own = np.zeros((samples, channels)), np.zeros(channels)
    for number in range(len(maps)):
        low, high = extent(maps[number], count)
        scale_map(maps[number], before, direction, low, high, count, scaled, shared)
        for s in range(lead, samples):
            if count[s + 1] == count[s - order[s]]:
                continue
            own[: high - low] = 0
            add_past(scaled, weights[order[s]], count, s, order[s], high - low, own)
            to, by = out[number, s - lead], after[min(s - lead, len(after) - 1)]
            if len(direction):
                common = 0.0
                for lag in range(order[s] + 1):
                    common += more[order[s], lag] * shared[s - lag]
                for c in range(channels):
                    to[c] = common * direction[c]
            here = to[low:high]
            for c in range(len(here)):
                here[c] += own[c]
            for c in range(channels):
                to[c] *= by[c]


@compiled
def extent(rows: Array, count: NDArray[np.int64]) -> tuple[int, int]:
    """First column and that after the last in which rows [row, column] are not all zero.

    Parameters
    ----------
    count : [row + 1], is set to how many rows before each are not all zero
    """
    low, high = rows.shape[1], 0
    for s in range(len(rows)):
        row, first, last = rows[s], 0, rows.shape[1]
        while first < last and row[first] == 0:
            first += 1
        count[s + 1] = count[s] + (first < last)
        if first < last:
            while row[last - 1] == 0:
                last -= 1
            low, high = min(low, first), max(high, last)
    return min(low, high), high


@partial(compiled, fastmath={"contract"})
def scale_map(
    rows: Array,
    before: Array,
    direction: Array,
    low: int,
    high: int,
    count: NDArray[np.int64],
    scaled: Array,
    shared: Array,
) -> None:
    """Multiply rows [row, column] from column `low` to `high`, into the first columns of `scaled` [row, column].

    `shared` [row] becomes their part in the direction; the others are as of `filter_maps` and `extent`.
    """
    part = direction[low:high]
    for s in range(len(rows)):
        row, by, to, total = rows[s, low:high], before[min(s, len(before) - 1), low:high], scaled[s], 0.0
        if count[s + 1] == count[s]:
            to[: high - low] = 0
        else:
            for c in range(len(row)):
                to[c] = row[c] * by[c]
            for c in range(len(part)):
                total += to[c] * part[c]
        shared[s] = total


@partial(compiled, fastmath={"contract"})
def add_past(scaled: Array, by: Array, count: NDArray[np.int64], s: int, order: int, width: int, to: Array) -> None:
    """Add to the first columns `to` [column] those of row `s` and of rows before it, weighted."""
    lag = 0
    while lag <= order:
        # Eight lags at once: what is added to is read and written an eighth as often.
        if lag + 7 <= order:
            if count[s - lag + 1] > count[s - lag - 7]:
                for c in range(width):
                    to[c] += (
                        by[lag] * scaled[s - lag, c]
                        + by[lag + 1] * scaled[s - lag - 1, c]
                        + by[lag + 2] * scaled[s - lag - 2, c]
                        + by[lag + 3] * scaled[s - lag - 3, c]
                        + by[lag + 4] * scaled[s - lag - 4, c]
                        + by[lag + 5] * scaled[s - lag - 5, c]
                        + by[lag + 6] * scaled[s - lag - 6, c]
                        + by[lag + 7] * scaled[s - lag - 7, c]
                    )
            lag += 8
        else:
            for c in range(width):
                to[c] += by[lag] * scaled[s - lag, c]
            lag += 1


@compiled
def filter_back(gradient: Array, weights: Array, order: NDArray[np.int64], lead: int, out: Array) -> None:
    """The transpose of `filter_maps`: of gradients [map, sample after the lead, channel], to [map, sample, channel]."""
    samples, channels = out.shape[1:]
    for number in range(len(out)):
        for s in range(lead, samples):
            for lag in range(order[s] + 1):
                weight = weights[order[s], lag]
                for c in range(channels):
                    out[number, s - lag, c] += weight * gradient[number, s - lead, c]
