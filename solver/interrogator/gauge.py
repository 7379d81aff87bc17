"""Interrogator stage: the fiber's motion becomes the strain rate of a gauge."""

from torch import Tensor


def gauge_strain_rate(ahead: Tensor, behind: Tensor, gauge_length: float | Tensor) -> Tensor:
    """Strain rate of a gauge from the axial velocity of its two ends.

    Parameters
    ----------
    ahead, behind : [...], axial velocity half a gauge length ahead of and behind each channel, m/s
    gauge_length : the length strain is averaged over (not the channel spacing), m

    Returns
    -------
    [...], 1/s

    >>> import torch
    >>> gauge_strain_rate(torch.tensor(3.0), torch.tensor(1.0), 10.0).item()
    0.20000000298023224
    """
    return (ahead - behind) / gauge_length
