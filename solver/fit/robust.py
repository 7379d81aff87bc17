"""Weights that limit the pull of bad samples, and amplitudes of vehicles that hardly show."""

from collections.abc import Sequence

import torch
from torch import Tensor

HUBER = 4.0
#: Times the scale of the residual beyond which a sample is not noise.
SPIKE = 7.0
#: Share of that within which a sample that was left out counts again: where a model explains its record badly, samples
#: would come and go with each step, and no fit would converge.
AGAIN = 0.7


def scale_of(residual: Tensor, measured: Tensor) -> Tensor:
    """Robust standard deviation [] of a residual [...] where it was measured, at least 1."""
    return torch.clamp(1.4826 * residual[measured].abs().median(), min=1.0)


def huber(residual: Tensor, measured: Tensor, scale: Tensor | None = None) -> Tensor:
    """Weights [...] that bound the pull of single bad samples (Huber 1964), on a scale, the residual's own where None.

    >>> huber(torch.tensor([0.5, -1.0, 40.0]), torch.ones(3, dtype=torch.bool)).tolist()[:2]
    [1.0, 1.0]
    """
    scale = scale_of(residual, measured) if scale is None else scale
    return (HUBER * scale / residual.abs().clamp_min(1e-12)).clamp(max=1.0)


def near_noise(residual: Tensor, scale: Tensor, before: Tensor | None = None) -> Tensor:
    """1 where a residual [...] of some scale may be noise, 0 for spikes: a filter must not smear them around.

    Parameters
    ----------
    before : the same a step before, 0 also where not measured; None where there was none

    >>> near_noise(torch.tensor([0.5, -6.0, 40.0]), torch.tensor(1.0)).tolist()
    [1.0, 1.0, 0.0]
    >>> near_noise(torch.tensor([0.5, -6.0, 3.0]), torch.tensor(1.0), torch.tensor([1.0, 0.0, 0.0])).tolist()
    [1.0, 0.0, 1.0]
    """
    most = SPIKE if before is None else torch.where(before > 0, SPIKE, AGAIN * SPIKE)
    return (residual.abs() < most * scale).double()


def joint_scale(residuals: Sequence[Tensor], measured: Sequence[Tensor]) -> Tensor:
    """`scale_of` several residuals together, each where it was measured.

    >>> all_there = torch.ones(2, dtype=torch.bool)
    >>> round(float(joint_scale([torch.tensor([3.0, -3.0]), torch.tensor([3.0, 3.0])], [all_there, all_there])), 4)
    4.4478
    """
    together = torch.cat([residual[there] for residual, there in zip(residuals, measured, strict=True)])
    return scale_of(together, torch.ones_like(together, dtype=torch.bool))


def solved_amplitudes(matrix: Tensor, right: Tensor) -> Tensor:
    """Amplitudes [pass] from their normal equations; a vehicle that no channel records keeps one near zero."""
    return torch.linalg.solve(matrix + 1e-12 * matrix.diagonal().max() * torch.eye(len(matrix)).double(), right)
