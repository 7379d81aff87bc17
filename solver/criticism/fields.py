"""Numbers of a field along fiber, road or tracks as a random process: neighbors may be alike."""

from collections.abc import Sequence
from functools import cache

import torch
from torch import Tensor

from solver.effect import Effect, Parameter
from solver.signal_path.extension import spacing_of

#: How far along fiber or road what changes gradually is alike, m: some lengths of what is laid or built in one piece.
ALIKE = 20.0
#: How long along a track what changes gradually is alike, s: errors of a camera's tracks last for some seconds.
LASTING = 2.0


def alike(effect: Effect, counts: Sequence[int], tracks: Sequence[int], passes: bool = False) -> Tensor | None:
    """Root [number, process] of the correlation of an effect's numbers; None where none are alike.

    Neighbors are correlated as by a once differentiable process (Matern, order 3/2; Rasmussen and Williams 2006,
    Gaussian Processes for Machine Learning, equation 4.17).

    Parameters
    ----------
    counts : how many numbers each amplitude has
    tracks : how many each track has of one that is smooth along tracks
    passes : whether numbers of passes are all the same
    """
    kinds = list(zip(effect.amplitudes, counts, strict=True))
    if not any((passes and p.scope == "pass") or spacing_of(effect, p) for p, _ in kinds):
        return None

    def root_of(p: Parameter, count: int) -> Tensor:
        if p.scope == "track":
            return torch.block_diag(*(root(each, spacing_of(effect, p), LASTING) for each in tracks))
        if passes and p.scope == "pass":
            return torch.ones(count, 1, dtype=torch.float64)
        return root(count, spacing_of(effect, p))

    return torch.block_diag(*(root_of(p, count) for p, count in kinds))


@cache
def root(count: int, spacing: float | None, reach: float = ALIKE) -> Tensor:
    """Root of the correlation of so many numbers, so far apart, of what is alike over `reach`, both in m, or in s.

    Numbers without order, whose spacing is None, are each by themselves.

    >>> bool(((root(9, 5.0) @ root(9, 5.0).T).diagonal() - 1).abs().max() < 1e-12)
    True
    """
    if spacing is None:
        return torch.eye(count, dtype=torch.float64)
    place = torch.arange(count, dtype=torch.float64) * spacing
    apart = 3**0.5 * (place[:, None] - place).abs() / reach
    return torch.linalg.cholesky((1 + apart) * torch.exp(-apart))
