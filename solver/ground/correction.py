"""Boussinesq's response plus a tabulated correction."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from solver.ground.blocks import double, in_blocks
from solver.ground.boussinesq import Ratio, displacement, displacement_rate, plain_values
from solver.ground.corrected_motion import table_rate
from solver.ground.ground_law import Array, Law, Placed
from solver.ground.response_table import RadialTable, RatioTable
from solver.ground.table_sums import add_table, add_table_derivatives
from solver.ground.wheel_motion import Derivatives, add_derivatives, add_response

#: Distance of the three Poisson ratios through which a correction that varies with them is interpolated.
SPREAD = 0.04


class Tables:
    """Correction of a ground to Boussinesq's displacement, tabulated per Poisson's ratio on demand.

    Parameters
    ----------
    build : Poisson's ratio, scalar -> table
    """

    def __init__(self, build: Callable[[Tensor], RadialTable]):
        self.build = build
        self._at: dict[Tensor, RadialTable] = {}
        self._around: dict[float, RatioTable] = {}

    def at(self, poisson_ratio: Tensor) -> RadialTable:
        """Table for one ratio, a scalar with or without a derivative; built once per tensor."""
        if poisson_ratio not in self._at:
            self._at[poisson_ratio] = self.build(poisson_ratio.reshape(()).double())
        return self._at[poisson_ratio]

    def around(self, poisson_ratio: Tensor) -> RatioTable:
        """Tables for ratios around one scalar without a derivative; built once."""
        key = float(poisson_ratio)
        if key not in self._around:
            below, at, above = (self.build(poisson_ratio + SPREAD * i) for i in (-1, 0, 1))
            self._around[key] = RatioTable(below, at, above, poisson_ratio, SPREAD)
        return self._around[key]


@dataclass(frozen=True)
class Corrected(Law):
    """A ground that tables tell from Boussinesq's.

    Parameters
    ----------
    tables : of the correction
    length : scalar, the tables' unit of length, m
    compliance : scalar, by which the response is multiplied; None for 1
    """

    tables: Tables
    length: Ratio
    compliance: Ratio | None = None

    def displacement(self, offset: Tensor, poisson_ratio: Ratio) -> Tensor:
        """Displacement [..., 3] of the ground under a load at rest, 1/m, in the unit of the tables.

        Parameters
        ----------
        offset : [..., 3], ground point minus load point, m
        poisson_ratio : scalar or [...]
        """

        def total(offset: Tensor, nu: Tensor, length: Tensor) -> Tensor:
            radial, _, vertical, _ = interpolate(*_places(offset, length), nu)
            horizontal = offset[..., :2] * (radial / length**2)[..., None]
            return displacement(offset, nu) + torch.cat([horizontal, (vertical / length)[..., None]], -1)

        nu, interpolate = self._interpolation(poisson_ratio)
        return self._scaled(in_blocks(total, [offset], [nu, self.length]), offset)

    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """Displacement rate [..., 3] of the ground while the load moves, 1/(m s).

        With u_h = h a / L^2, u_z = b / L, t = ln(1 + r^2 / L^2) / 2: dt/dt = -(h . v) / (L^2 + r^2), dh/dt = -v_h.

        Parameters
        ----------
        offset, poisson_ratio : see `displacement`
        velocity : [..., 2], horizontal velocity of the load, m/s
        """

        def total(offset: Tensor, velocity: Tensor, nu: Tensor, length: Tensor) -> Tensor:
            (x, y, _), (vx, vy) = offset.unbind(-1), velocity.unbind(-1)
            square, depth = _places(offset, length)
            radial, radial_slope, _, vertical_slope = interpolate(square, depth, nu)
            passed = -(x * vx + y * vy) / (length * length * (1 + square))
            a, grown = radial / length**2, radial_slope * passed / length**2
            extra = torch.stack([x * grown - vx * a, y * grown - vy * a, vertical_slope * passed / length], -1)
            return displacement_rate(offset, velocity, nu) + extra

        nu, interpolate = self._interpolation(poisson_ratio)
        moved = table_rate(offset, velocity, nu, *interpolate.by_ratio(nu), double(self.length))
        if moved is None:
            moved = in_blocks(total, [offset, velocity], [nu, self.length])
        return self._scaled(moved, offset)

    def has_pass(self, derivatives: bool, uniform: bool) -> bool:
        """As of `Law`."""
        return True

    def added(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """As of `Law`."""
        table = self._table(at, poisson_ratio)
        if table is None:
            return None
        out, (arrays, sizes) = at.nothing, table
        add_table(*at[:5], *arrays, *sizes, out)
        if self.compliance is None:
            return out
        homogeneous, share = at.nothing, float(self.compliance)
        add_response(*at, homogeneous)
        return share * out + (share - 1) * homogeneous

    def derived(self, at: Placed, poisson_ratio: Tensor) -> Derivatives | None:
        """As of `Law`."""
        table = self._table(at, poisson_ratio)
        if table is None:
            return None
        out, (arrays, sizes) = Derivatives.nothing(at), table
        add_table_derivatives(*at[:5], *arrays, *sizes, SPREAD, *out)
        if self.compliance is None:
            return out
        homogeneous, share = Derivatives.nothing(at), float(self.compliance)
        add_derivatives(*at, *homogeneous)
        return out.times(share).plus(homogeneous, share - 1)

    def _table(
        self, at: Placed, poisson_ratio: Tensor
    ) -> tuple[tuple[Array, Array, Array], tuple[float, float]] | None:
        """Poisson's ratio [point, channel], cells, edges, step and length of the table, as `add_table` takes them.

        None where the law's numbers carry derivatives.
        """
        nu, interpolate = self._interpolation(poisson_ratio)
        away, parabolas, table = interpolate.by_ratio(nu)
        length, compliance = double(self.length), double(1.0 if self.compliance is None else self.compliance)
        if plain_values(away, parabolas, length, compliance) is None:
            return None
        ratio = np.ascontiguousarray(away.expand(at.softness.shape[:0:-1]).numpy().T)
        cells, edges = (one.contiguous().numpy() for one in (parabolas, table.depth))
        return (ratio, cells, edges), (table.step, float(length))

    def _scaled(self, moved: Tensor, offset: Tensor) -> Tensor:
        """A response as compliant as the ground is, as precise as the offset."""
        moved = moved.to(offset.dtype)
        return moved if self.compliance is None else moved * double(self.compliance).to(offset.dtype)

    def _interpolation(self, poisson_ratio: Ratio) -> tuple[Tensor, RadialTable | RatioTable]:
        """Poisson ratio as a tensor, and the table of r^2, depth and it."""
        nu = double(poisson_ratio)
        if nu.numel() == 1:
            return nu.reshape(()), self.tables.at(nu)
        # The equations of nearly incompressible layers are ill-conditioned: all three ratios stay below one half.
        middle = nu.detach().mean().double().clamp(max=0.49 - SPREAD)
        return nu, self.tables.around(middle)


def _places(offset: Tensor, length: Tensor) -> tuple[Tensor, Tensor]:
    x, y, z = (offset / length).unbind(-1)
    return x * x + y * y, z
