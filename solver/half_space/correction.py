"""Boussinesq's response plus a tabulated correction."""

from collections.abc import Callable

import torch
from torch import Tensor

from solver.ground import Ratio, displacement, displacement_rate
from solver.half_space.table import RadialTable

#: Poisson ratio -> table.
Build = Callable[[Tensor], RadialTable]

#: Distance of the three Poisson ratios through which a correction that varies with them is interpolated.
SPREAD = 0.04


def corrected_displacement(build: Build, offset: Tensor, poisson_ratio: Ratio, length: Ratio) -> Tensor:
    """Displacement [..., 3] of the ground, 1/m, per the unit that the table has.

    Parameters
    ----------
    build : tabulates the correction for a Poisson ratio
    offset : [..., 3], ground point minus load point, m
    poisson_ratio : scalar or [...]
    length : unit of length of the table, m
    """
    square, depth = _places(offset, length)
    radial, _, vertical, _ = _interpolated(build, poisson_ratio, square, depth)
    horizontal = offset[..., :2] * (radial / length**2)[..., None]
    extra = torch.cat([horizontal, (vertical / length)[..., None]], -1)
    return displacement(offset, poisson_ratio) + extra.to(offset.dtype)


def corrected_rate(build: Build, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, length: Ratio) -> Tensor:
    """Displacement rate [..., 3] of the ground while the load moves, 1/(m s).

    With u_h = h a / L^2, u_z = b / L, t = ln(1 + r^2 / L^2) / 2: dt/dt = -(h . v) / (L^2 + r^2), dh/dt = -v_h.

    Parameters
    ----------
    build, offset, poisson_ratio, length : see `corrected_displacement`
    velocity : [..., 2], horizontal velocity of the load, m/s
    """
    x, y = offset[..., 0], offset[..., 1]
    vx, vy = velocity.unbind(-1)
    square, depth = _places(offset, length)
    radial, radial_slope, _, vertical_slope = _interpolated(build, poisson_ratio, square, depth)
    passed = -(x * vx + y * vy) / (length * length * (1 + square))
    a, grown = radial / length**2, radial_slope * passed / length**2
    extra = torch.stack([x * grown - vx * a, y * grown - vy * a, vertical_slope * passed / length], -1)
    return displacement_rate(offset, velocity, poisson_ratio) + extra.to(offset.dtype)


def _places(offset: Tensor, length: Ratio) -> tuple[Tensor, Tensor]:
    scaled = offset / length
    return scaled[..., 0] ** 2 + scaled[..., 1] ** 2, scaled[..., 2]


def _interpolated(build: Build, poisson_ratio: Ratio, square: Tensor, depth: Tensor) -> tuple[Tensor, ...]:
    nu = torch.as_tensor(poisson_ratio, dtype=torch.float64)
    if nu.numel() == 1:
        return build(nu.reshape(()))(square, depth)
    # Nearly incompressible layers are too stiff to be solved for: all three ratios stay below one half.
    middle = nu.detach().mean().clamp(max=0.49 - SPREAD)
    away = (nu - middle) / SPREAD
    weights = away * (away - 1) / 2, 1 - away * away, away * (away + 1) / 2
    parts = [build(middle + SPREAD * i)(square, depth) for i in (-1, 0, 1)]
    return tuple(sum(w * p for w, p in zip(weights, same, strict=True)) for same in zip(*parts, strict=True))
