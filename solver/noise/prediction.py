"""Prediction filters along time: what is new in each sample of stationary noise, in units of its standard deviation."""

from dataclasses import dataclass
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
    """

    weights: Array
    order: NDArray[np.int64]
    lead: int = 0

    @classmethod
    def of(cls, covariance: Array, blocks: list[slice], lead: int = 0) -> "PredictionFilter":
        """The filter that makes noise of an autocovariance [lag] white, on blocks of samples."""
        rows = levinson(covariance)
        weights = np.zeros((len(rows), len(rows)))
        for number, row in enumerate(rows):
            weights[number, : len(row)] = row
        ages = [np.arange(block.stop - block.start) for block in blocks]
        return cls(weights, np.minimum(np.concatenate(ages), len(rows) - 1), lead)

    def __call__(self, values: Tensor) -> Tensor:
        """Filter values [..., sample, channel].

        >>> blocks = [slice(0, 2), slice(2, 3)]
        >>> PredictionFilter.of(np.array([1.0, 0.6]), blocks)(torch.ones(3, 1, dtype=torch.float64))[:, 0]
        tensor([1.0000, 0.5000, 1.0000], dtype=torch.float64)
        """
        maps = values.reshape(-1, *values.shape[-2:])
        found: Tensor = _Filtered.apply(maps, self)
        return found.reshape(*values.shape[:-2], *found.shape[1:])


class _Filtered(torch.autograd.Function):
    """Maps [map, sample, channel] filtered, and the transpose of that for gradients."""

    @staticmethod
    def forward(ctx: Any, maps: Tensor, by: PredictionFilter) -> Tensor:
        """Filter."""
        ctx.by = by
        out = maps.new_zeros(len(maps), maps.shape[1] - by.lead, maps.shape[2])
        filter_maps(maps.contiguous().numpy(), by.weights, by.order, by.lead, out.numpy())
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        """Filter the other way."""
        by, gradient = ctx.by, gradients[0].contiguous()
        out = gradient.new_zeros(len(gradient), gradient.shape[1] + by.lead, gradient.shape[2])
        filter_back(gradient.numpy(), by.weights, by.order, by.lead, out.numpy())
        return out, None


@partial(compiled, fastmath={"contract"})
def filter_maps(maps: Array, weights: Array, order: NDArray[np.int64], lead: int, out: Array) -> None:
    """Add each sample and those before it, weighted; samples of zeros, as of a vehicle that is gone, take no time.

    Parameters
    ----------
    maps : [map, sample, channel]
    weights, order, lead : as of `PredictionFilter`
    out : [map, sample after the lead, channel]
    """
    samples, channels = maps.shape[1:]
    acts = np.zeros(samples, np.bool_)
    for number in range(len(maps)):
        for s in range(samples):
            acts[s] = maps[number, s].any()
        for s in range(lead, samples):
            by, lag = weights[order[s]], 0
            while lag <= order[s]:
                # Four lags at once: what is added to is read and written a quarter as often.
                if lag + 3 <= order[s] and acts[s - lag - 3 : s - lag + 1].any():
                    for c in range(channels):
                        out[number, s - lead, c] += (
                            by[lag] * maps[number, s - lag, c]
                            + by[lag + 1] * maps[number, s - lag - 1, c]
                            + by[lag + 2] * maps[number, s - lag - 2, c]
                            + by[lag + 3] * maps[number, s - lag - 3, c]
                        )
                    lag += 4
                else:
                    if acts[s - lag]:
                        for c in range(channels):
                            out[number, s - lead, c] += by[lag] * maps[number, s - lag, c]
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
