"""Numbers of a field along fiber or road as a random process: neighbors may be alike."""

from collections.abc import Sequence
from functools import cache

import torch
from torch import Tensor

from solver.effect import Effect
from solver.signal_path.extension import spacing_of

#: How far along fiber or road what changes gradually is alike, m: some lengths of what is laid or built in one piece.
ALIKE = 20.0


def alike(effect: Effect, counts: Sequence[int], passes: bool = False) -> Tensor | None:
    """Root [number, process] of the correlation of an effect's numbers; None where none are alike.

    Neighbors are correlated as by a once differentiable process (Matern, order 3/2; Rasmussen and Williams 2006,
    Gaussian Processes for Machine Learning, equation 4.17).

    Parameters
    ----------
    counts : how many numbers each amplitude has
    passes : whether numbers of passes are all the same
    """
    roots = [root(count, spacing_of(effect, p)) for p, count in zip(effect.amplitudes, counts, strict=True)]
    same = [passes and p.scope == "pass" for p in effect.amplitudes]
    if not any(same) and not any(spacing_of(effect, p) for p in effect.amplitudes):
        return None
    return torch.block_diag(
        *(torch.ones(len(one), 1).double() if s else one for one, s in zip(roots, same, strict=True))
    )


@cache
def root(count: int, spacing: float | None) -> Tensor:
    """Root of the correlation of so many numbers, so far apart, m; of numbers without order where None.

    >>> bool(((root(9, 5.0) @ root(9, 5.0).T).diagonal() - 1).abs().max() < 1e-12)
    True
    """
    if spacing is None:
        return torch.eye(count, dtype=torch.float64)
    place = torch.arange(count, dtype=torch.float64) * spacing
    apart = 3**0.5 * (place[:, None] - place).abs() / ALIKE
    return torch.linalg.cholesky((1 + apart) * torch.exp(-apart))
