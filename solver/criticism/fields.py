"""Numbers of a field along fiber or road as a random process: neighbors may be alike."""

from collections.abc import Sequence
from functools import cache

import torch
from torch import Tensor

from solver.effect import Effect
from solver.signal_path.extension import spacing_of

#: How far along fiber or road what changes gradually is alike, m: some lengths of what is laid or built in one piece.
ALIKE = 20.0


def alike(effect: Effect, counts: Sequence[int]) -> Tensor | None:
    """Root [number, number] of the correlation of an effect's numbers; None where none are along fiber or road.

    Neighbors are correlated as by a once differentiable process (Matern, order 3/2; Rasmussen and Williams 2006,
    Gaussian Processes for Machine Learning, equation 4.17).

    Parameters
    ----------
    counts : how many numbers each amplitude has
    """
    spacings = [spacing_of(effect, parameter) for parameter in effect.amplitudes]
    if not any(spacings):
        return None
    return torch.block_diag(*(root(count, spacing) for count, spacing in zip(counts, spacings, strict=True)))


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
