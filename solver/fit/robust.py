"""Weights that keep bad samples from deciding."""

import torch
from torch import Tensor

HUBER = 4.0
#: Times the scale of the residual beyond which a sample is no noise.
SPIKE = 7.0


def scale_of(residual: Tensor, measured: Tensor) -> Tensor:
    """Robust standard deviation [] of a residual [...] where it was measured, at least 1."""
    return torch.clamp(1.4826 * residual[measured].abs().median(), min=1.0)


def huber(residual: Tensor, measured: Tensor) -> Tensor:
    """Weights [...] that bound the pull of single bad samples (Huber 1964), on the scale of the residual itself.

    >>> huber(torch.tensor([0.5, -1.0, 40.0]), torch.ones(3, dtype=torch.bool)).tolist()[:2]
    [1.0, 1.0]
    """
    return (HUBER * scale_of(residual, measured) / residual.abs().clamp_min(1e-12)).clamp(max=1.0)


def near_noise(residual: Tensor, measured: Tensor) -> Tensor:
    """1 where a residual [...] may be noise, 0 for spikes: a filter must not smear them over their neighbors.

    >>> near_noise(torch.tensor([0.5, -1.0, 40.0]), torch.ones(3, dtype=torch.bool)).tolist()
    [1.0, 1.0, 0.0]
    """
    return (residual.abs() < SPIKE * scale_of(residual, measured)).double()
