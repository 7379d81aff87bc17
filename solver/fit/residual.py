"""What a model leaves of a measurement: the one place where a fit takes their difference."""

import torch
from torch import Tensor


def unexplained(measured: Tensor, model: Tensor, there: Tensor) -> Tensor:
    """Measured - model [...], 1/s; exactly 0, and of no derivative, where nothing was measured.

    Parameters
    ----------
    measured, model : [...], 1/s; any number, or NaN, where there is no measurement
    there : [...] bool, where there is one

    >>> measured = torch.tensor([3.0, torch.nan])
    >>> unexplained(measured, torch.tensor([1.0, 1.0]), measured.isfinite()).tolist()
    [2.0, 0.0]
    """
    return torch.where(there, measured - model, 0.0)
