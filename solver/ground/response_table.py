"""An axially symmetric response to a load, tabulated over distance and depth and interpolated."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.boussinesq import plain_values
from solver.ground.cell_values import interpolated, interpolated_back, values_at
from solver.ground.images import Images

#: Values and slopes at 0 and 1 (f0, f1, d0, d1) -> coefficients of 1, x, x^2, x^3.
HERMITE = torch.tensor(
    [[1, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]],
    dtype=torch.float64,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cells:
    """Kernels (W, V) at the top and bottom of every cell of depth, one-sided, so that a kink may lie between cells.

    Parameters
    ----------
    depth : [cell + 1], ascending
    top, bottom : [cell, k, 2]
    top_slope, bottom_slope : [cell, k, 2], derivatives by depth
    """

    depth: Tensor
    top: Tensor
    bottom: Tensor
    top_slope: Tensor
    bottom_slope: Tensor

    def ends(self) -> Tensor:
        """Values and slopes [cell, 4, k, 2] over the position in the cell, 0 to 1, in the order of `HERMITE`."""
        size = torch.diff(self.depth)[:, None, None]
        return torch.stack([self.top, self.bottom, size * self.top_slope, size * self.bottom_slope], 1)


@dataclass(frozen=True)
class RadialTable:
    """Bicubic Hermite interpolant of u_r / r and u_z over t = ln(1 + r^2) / 2 and depth, C1, in its own unit of length.

    Parameters
    ----------
    coefficients : [cell, 32]; cells of depth by cells of t; powers of depth, then (u_r / r, u_z), then powers of t
    depth : [cell + 1], edges of the cells of depth
    step : size of the cells of t
    """

    coefficients: Tensor
    depth: Tensor
    step: float

    @classmethod
    def of(cls, cells: Cells, images: Images) -> "RadialTable":
        """Transform kernels."""
        ends = cells.ends()
        nodes = torch.stack(
            [
                torch.einsum("nk,cpk->cpn", operator, ends[..., component])
                for component, operators in (
                    (1, (images.radial, images.radial_slope)),
                    (0, (images.vertical, images.vertical_slope)),
                )
                for operator in operators
            ]
        ).unflatten(0, (2, 2))
        value, slope = nodes[:, 0], nodes[:, 1] * images.step
        corners = torch.stack([value[..., :-1], value[..., 1:], slope[..., :-1], slope[..., 1:]])
        coefficients = torch.einsum("ip,jq,qfcpn->cnifj", HERMITE, HERMITE, corners)
        return cls(coefficients.reshape(-1, 32), cells.depth, images.step)

    def __call__(self, square: Tensor, depth: Tensor, poisson_ratio: Tensor) -> tuple[Tensor, ...]:
        """Interpolate; beyond the last node the last value holds.

        Parameters
        ----------
        square : [point], r^2
        depth : [point]
        poisson_ratio : the table's own

        Returns
        -------
        u_r / r, its derivative by t, u_z, its derivative by t : [point]
        """
        return looked_up(square, depth, *self.by_ratio(poisson_ratio))

    def by_ratio(self, poisson_ratio: Tensor) -> tuple[Tensor, Tensor, "RadialTable"]:
        """Distance from the middle of the table's ratios, coefficients of its powers, and their cells."""
        return torch.zeros_like(poisson_ratio), self.coefficients[:, None], self


@dataclass(frozen=True)
class RatioTable:
    """Tables at three Poisson's ratios, and parabolas through them.

    Parameters
    ----------
    below, middle, above : at `ratio` - `spread`, at it, and at `ratio` + `spread`
    ratio, spread : see there
    """

    below: RadialTable
    middle: RadialTable
    above: RadialTable
    ratio: Tensor
    spread: float

    def __call__(self, square: Tensor, depth: Tensor, poisson_ratio: Tensor) -> tuple[Tensor, ...]:
        """As `RadialTable` gives it, all [point]."""
        return looked_up(square, depth, *self.by_ratio(poisson_ratio))

    def by_ratio(self, poisson_ratio: Tensor) -> tuple[Tensor, Tensor, RadialTable]:
        """As of `RadialTable`."""
        return (poisson_ratio - self.ratio) / self.spread, self.parabolas, self.middle

    @cached_property
    def parabolas(self) -> Tensor:
        """Coefficients [cell, power, 32], by powers of the ratio's distance over the spread."""
        below, middle, above = (table.coefficients for table in (self.below, self.middle, self.above))
        return torch.stack([middle, (above - below) / 2, (above + below) / 2 - middle], 1)


def looked_up(square: Tensor, depth: Tensor, away: Tensor, parabolas: Tensor, table: RadialTable) -> tuple[Tensor, ...]:
    """Outputs of `RadialTable`, [point] each; `parabolas` [cell, power, 32] are coefficients of powers of `away`."""
    places = [x.to(parabolas.dtype) for x in torch.broadcast_tensors(square, depth, away)]
    if plain_values(*places, parabolas) is None:
        value = _Interpolated.apply(*places, parabolas, table.depth, table.step)[0]
    else:
        at, down, off, coefficients, edges = arrays([*places, parabolas, table.depth])
        value = torch.from_numpy(values_at(at, down, off, coefficients, edges, table.step))
    return tuple(value.to(square.dtype).unbind())


def arrays(tensors: Sequence[Tensor]) -> list[Array]:
    """Values in one memory order, so that the functions are compiled only once."""
    return [x.detach().contiguous().numpy() for x in tensors]


class _Interpolated(torch.autograd.Function):
    """`interpolated` with its derivatives; autograd through its forty operations would be several times as slow."""

    @staticmethod
    def forward(*arguments: Any) -> tuple[Tensor, Tensor]:
        *tensors, step = arguments
        square, depth, away, parabolas, edges = arrays(tensors)
        value, slope = interpolated(square, depth, away, parabolas, edges, step)
        return torch.from_numpy(value), torch.from_numpy(slope)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        *tensors, ctx.step = inputs
        ctx.mark_non_differentiable(output[1])
        ctx.save_for_backward(*tensors, output[1])
        ctx.save_for_forward(*tensors, output[1])

    @staticmethod
    def backward(ctx: Any, by_value: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        *tensors, slope = ctx.saved_tensors
        table = None
        if ctx.needs_input_grad[3]:
            square, depth, away, parabolas, edges, gradient = arrays([*tensors, by_value])
            table = torch.from_numpy(interpolated_back(square, depth, away, parabolas, edges, gradient, ctx.step))
        return (*(slope * by_value[:, None]).sum(0).unbind(), table, None, None)

    @staticmethod
    def jvp(ctx: Any, *tangents: Tensor) -> tuple[Tensor, None]:
        square, depth, away, _, edges, slope = ctx.saved_tensors
        moved = (slope * torch.stack(tangents[:3])).sum(1)
        if bool(tangents[3].any()):
            moved = moved + _Interpolated.apply(square, depth, away, tangents[3], edges, ctx.step)[0]
        return moved, None
