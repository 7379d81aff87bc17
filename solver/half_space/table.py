"""A response to a load, the same in all horizontal directions, tabulated over distance and depth and interpolated."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from solver.half_space.images import Images

#: Values and slopes at 0 and 1 (f0, f1, d0, d1) -> coefficients of 1, x, x^2, x^3.
HERMITE = torch.tensor(
    [[1, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]],
    dtype=torch.float64,
)


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
        """Values and slopes [cell, 4, k, 2] by the share of the cell passed, in the order of `HERMITE`."""
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

    def __call__(self, square: Tensor, depth: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Interpolate; beyond the last node the last value holds.

        Parameters
        ----------
        square : [point], r^2
        depth : [point]

        Returns
        -------
        u_r / r, its derivative by t, u_z, its derivative by t : [point]
        """
        columns = len(self.coefficients) // (len(self.depth) - 1)
        down = depth.clamp(float(self.depth[0]), float(self.depth[-1]))
        row = torch.bucketize(down.detach(), self.depth[1:-1])
        x = (down - self.depth.index_select(0, row)) / torch.diff(self.depth).index_select(0, row)
        t = (torch.log1p(square) * (0.5 / self.step)).clamp(max=columns)
        column = t.detach().long().clamp(max=columns - 1)
        y = (t - column)[..., None]
        cubic = self.coefficients.index_select(0, row * columns + column).unflatten(-1, (4, 8)).unbind(-2)
        c0, c1, c2, c3 = _horner(cubic, x[..., None]).unflatten(-1, (2, 4)).unbind(-1)
        value = _horner((c0, c1, c2, c3), y)
        slope = _horner((c1, 2 * c2, 3 * c3), y) / self.step
        return value[..., 0], slope[..., 0], value[..., 1], slope[..., 1]


def _horner(coefficients: Sequence[Tensor], x: Tensor) -> Tensor:
    """Sum of coefficients[i] x^i."""
    total = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        total = torch.addcmul(coefficient, total, x)
    return total
