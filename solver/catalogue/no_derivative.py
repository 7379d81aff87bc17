"""Functions of a whole map that change with it so little, or at so few samples, that no derivative is needed."""

from typing import Any

import torch
from torch import Tensor


class NoDerivative(torch.autograd.Function):
    """A function `forward(values, number)` of a map [..., sample, channel] and a number, whose derivatives are zero.

    >>> class Doubled(NoDerivative):
    ...     @staticmethod
    ...     def forward(values, number):
    ...         return number * values
    >>> x = torch.ones(2, requires_grad=True)
    >>> (x * Doubled.apply(x, 2.0)).sum().backward()
    >>> x.grad
    tensor([2., 2.])
    """

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        """Nothing is kept."""

    @staticmethod
    def jvp(ctx: Any, values: Tensor, number: None) -> Tensor:
        """No derivative."""
        return torch.zeros_like(values)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        """No derivative."""
        return torch.zeros_like(gradient), None
