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
from solver.ground.compiled import compiled
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

    def __call__(self, square: Tensor, depth: Tensor) -> tuple[Tensor, ...]:
        """Interpolate; beyond the last node the last value holds.

        Parameters
        ----------
        square : [point], r^2
        depth : [point]

        Returns
        -------
        u_r / r, its derivative by t, u_z, its derivative by t : [point]
        """
        return looked_up(square, depth, torch.zeros_like(square), self.coefficients[:, None], self)


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
        return looked_up(square, depth, (poisson_ratio - self.ratio) / self.spread, self.parabolas, self.middle)

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


@compiled
def placed(square: float, depth: float, edges: Array, columns: int, step: float) -> tuple[int, float, float, float]:
    """Cell, position in it (0 to 1) in depth and in t, and the derivative of t, in steps, by `square`."""
    row = min(max(int(np.searchsorted(edges, depth, side="right")) - 1, 0), len(edges) - 2)
    x = min(max((depth - edges[row]) / (edges[row + 1] - edges[row]), 0.0), 1.0)
    t = np.log1p(square) * (0.5 / step)
    column = min(int(t), columns - 1)
    passed = 0.5 / (step * (1 + square)) if t <= columns else 0.0
    return row * columns + column, x, min(t, float(columns)) - column, passed


@compiled
def values_at(square: Array, depth: Array, away: Array, parabolas: Array, edges: Array, step: float) -> Array:
    """Values [4, point], see `looked_up`: half the work of `interpolated`."""
    columns, powers = len(parabolas) // (len(edges) - 1), parabolas.shape[1]
    value, by_t = np.empty((4, len(square))), np.empty(4)
    for point in range(len(square)):
        number, x, y, _ = placed(square[point], depth[point], edges, columns, step)
        cell, a = parabolas[number], away[point]
        for which in range(2):
            for power in range(4):
                height = 0.0
                for x_power in range(3, -1, -1):
                    at = 8 * x_power + 4 * which + power
                    here = cell[powers - 1, at]
                    for a_power in range(powers - 2, -1, -1):
                        here = cell[a_power, at] + a * here
                    height = here + x * height
                by_t[power] = height
            c0, c1, c2, c3 = by_t[0], by_t[1], by_t[2], by_t[3]
            value[2 * which, point] = c0 + y * (c1 + y * (c2 + y * c3))
            value[2 * which + 1, point] = (c1 + y * (2 * c2 + y * 3 * c3)) / step
    return value


@compiled
def interpolated(
    square: Array, depth: Array, away: Array, parabolas: Array, edges: Array, step: float
) -> tuple[Array, Array]:
    """Values [4, point], see `looked_up`, and their derivatives [4, 3, point] by the first three arguments."""
    columns, powers = len(parabolas) // (len(edges) - 1), parabolas.shape[1]
    value, slope = np.zeros((4, len(square))), np.zeros((4, 3, len(square)))
    by_t = np.empty((2, 4, 3))  # u_r / r and u_z; powers of t; value, derivative by depth, by away
    for point in range(len(square)):
        number, x, y, passed = placed(square[point], depth[point], edges, columns, step)
        row = number // columns
        within = 1 / (edges[row + 1] - edges[row]) if edges[0] <= depth[point] <= edges[-1] else 0.0
        cell, a = parabolas[number], away[point]
        for which in range(2):
            for power in range(4):
                height, down, turned = 0.0, 0.0, 0.0
                for x_power in range(3, -1, -1):
                    at = 8 * x_power + 4 * which + power
                    here, by_away = cell[powers - 1, at], 0.0
                    for a_power in range(powers - 2, -1, -1):
                        by_away = here + a * by_away
                        here = cell[a_power, at] + a * here
                    down = height + x * down
                    height = here + x * height
                    turned = by_away + x * turned
                by_t[which, power, 0], by_t[which, power, 1], by_t[which, power, 2] = height, down * within, turned
        for which in range(2):
            for way in range(3):
                c0, c1, c2, c3 = by_t[which, 0, way], by_t[which, 1, way], by_t[which, 2, way], by_t[which, 3, way]
                height = c0 + y * (c1 + y * (c2 + y * c3))
                rise = c1 + y * (2 * c2 + y * 3 * c3)
                if way == 0:
                    value[2 * which, point], value[2 * which + 1, point] = height, rise / step
                    slope[2 * which, 0, point] = rise * passed
                    slope[2 * which + 1, 0, point] = (2 * c2 + y * 6 * c3) / step * passed
                else:
                    slope[2 * which, way, point], slope[2 * which + 1, way, point] = height, rise / step
    return value, slope


@compiled
def interpolated_back(
    square: Array, depth: Array, away: Array, parabolas: Array, edges: Array, by_value: Array, step: float
) -> Array:
    """Gradient [cell, power, 32] by `parabolas`, from the gradient by the values, `by_value` [4, point]."""
    columns, out = len(parabolas) // (len(edges) - 1), np.zeros_like(parabolas)
    for point in range(len(square)):
        number, x, y, _ = placed(square[point], depth[point], edges, columns, step)
        for a_power in range(parabolas.shape[1]):
            for x_power in range(4):
                share = away[point] ** a_power * x**x_power
                for which in range(2):
                    value, rise = by_value[2 * which, point], by_value[2 * which + 1, point] / step
                    at = 8 * x_power + 4 * which
                    out[number, a_power, at] += share * value
                    out[number, a_power, at + 1] += share * (y * value + rise)
                    out[number, a_power, at + 2] += share * (y * y * value + 2 * y * rise)
                    out[number, a_power, at + 3] += share * (y**3 * value + 3 * y * y * rise)
    return out
