"""Boussinesq's response plus a tabulated correction."""

from collections.abc import Callable

import torch
from torch import Tensor

from solver.ground.blocks import double, in_blocks
from solver.ground.boussinesq import Ratio, displacement, displacement_rate
from solver.ground.corrected_motion import table_rate
from solver.ground.response_table import RadialTable, RatioTable

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


def corrected_displacement(tables: Tables, offset: Tensor, poisson_ratio: Ratio, length: Ratio) -> Tensor:
    """Displacement [..., 3] of the ground, 1/m, in the unit of the table.

    Parameters
    ----------
    tables : of the correction
    offset : [..., 3], ground point minus load point, m
    poisson_ratio : scalar or [...]
    length : scalar, the table's unit of length, m
    """

    def total(offset: Tensor, nu: Tensor, length: Tensor) -> Tensor:
        radial, _, vertical, _ = interpolate(*_places(offset, length), nu)
        horizontal = offset[..., :2] * (radial / length**2)[..., None]
        return displacement(offset, nu) + torch.cat([horizontal, (vertical / length)[..., None]], -1)

    nu, interpolate = _interpolation(tables, poisson_ratio)
    return in_blocks(total, [offset], [nu, length]).to(offset.dtype)


def corrected_rate(tables: Tables, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, length: Ratio) -> Tensor:
    """Displacement rate [..., 3] of the ground while the load moves, 1/(m s).

    With u_h = h a / L^2, u_z = b / L, t = ln(1 + r^2 / L^2) / 2: dt/dt = -(h . v) / (L^2 + r^2), dh/dt = -v_h.

    Parameters
    ----------
    tables, offset, poisson_ratio, length : see `corrected_displacement`
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

    nu, interpolate = _interpolation(tables, poisson_ratio)
    plain = table_rate(offset, velocity, nu, *interpolate.by_ratio(nu), double(length))
    return in_blocks(total, [offset, velocity], [nu, length]).to(offset.dtype) if plain is None else plain


def _places(offset: Tensor, length: Tensor) -> tuple[Tensor, Tensor]:
    x, y, z = (offset / length).unbind(-1)
    return x * x + y * y, z


def _interpolation(tables: Tables, poisson_ratio: Ratio) -> tuple[Tensor, RadialTable | RatioTable]:
    """Poisson ratio as a tensor, and the table of r^2, depth and it."""
    nu = double(poisson_ratio)
    if nu.numel() == 1:
        return nu.reshape(()), tables.at(nu)
    # The equations of nearly incompressible layers are ill-conditioned: all three ratios stay below one half.
    middle = nu.detach().mean().double().clamp(max=0.49 - SPREAD)
    return nu, tables.around(middle)
