"""Velocity of the ground under a moving load, Boussinesq's and a tabulated correction to it, in machine code."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from solver.ground.boussinesq import displacement_rate, forward_mode
from solver.ground.cell_values import interpolated, values_at
from solver.ground.compiled import compiled
from solver.ground.response_table import RadialTable

Array = NDArray[np.float64]


def table_rate(
    offset: Tensor, velocity: Tensor, ratio: Tensor, away: Tensor, parabolas: Tensor, table: RadialTable, length: Tensor
) -> Tensor | None:
    """Displacement rate [..., 3] of the ground while the load moves, 1/(m s), as of `Corrected.rate`.

    Differentiable once, in backward mode, with respect to offset, velocity and Poisson's ratio.

    Parameters
    ----------
    offset, velocity : [..., 3], m, and [..., 2], m/s
    ratio : [...], Poisson's
    away : [...], its distance from the middle of the table's ratios, in their spread
    parabolas : [cell, power, 32], see `looked_up`
    length : scalar, the table's unit of length, m

    Returns
    -------
    None where another derivative, or another precision, is asked for
    """
    given = offset, velocity, ratio, away
    if any(x.dtype != torch.float64 or forward_mode(x) for x in (*given, parabolas, length)):
        return None
    if parabolas.requires_grad or length.requires_grad:
        return None
    shape = np.broadcast_shapes(offset.shape[:-1], velocity.shape[:-1], ratio.shape, away.shape)
    whole = offset.expand(*shape, 3), velocity.expand(*shape, 2), ratio.expand(shape), away.expand(shape)
    found: Tensor = _TableRate.apply(*whole, (parabolas.numpy(), table.depth.numpy(), table.step), float(length))
    return found


class _TableRate(torch.autograd.Function):
    """`table_rate` for arguments that have all their axes."""

    @staticmethod
    def forward(
        ctx: Any,
        offset: Tensor,
        velocity: Tensor,
        ratio: Tensor,
        away: Tensor,
        table: tuple[Array, Array, float],
        length: float,
    ) -> Tensor:
        """The rate, with what the table gives kept for its derivatives where these are asked for."""
        shape = offset.shape[:-1]
        places = np.stack([flat(one) for one in (*offset.unbind(-1), *velocity.unbind(-1))])
        square, depth = (places[0] ** 2 + places[1] ** 2) / length**2, places[2] / length
        if any(ctx.needs_input_grad):
            value, slope = interpolated(square, depth, flat(away), *table)
            kept = places, value, slope, flat(1 - 2 * ratio)
            ctx.save_for_backward(*map(torch.from_numpy, kept))
            ctx.length = length
        else:
            value = values_at(square, depth, flat(away), *table)
        rate = np.empty((3, len(square)))
        extra_rate(places, value, length, rate)
        extra = torch.from_numpy(rate).reshape(3, *shape).movedim(0, -1)
        return displacement_rate(offset.detach(), velocity.detach(), ratio.detach()) + extra

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients by offset, velocity, ratio and `away`."""
        places, value, slope, softness = (one.numpy() for one in ctx.saved_tensors)
        shape = gradient.shape[:-1]
        wanted = np.stack([flat(one) for one in gradient.unbind(-1)])
        out = np.empty((7, wanted.shape[1]))
        pulled_back(places, value, slope, softness, wanted, ctx.length, out)
        found = torch.from_numpy(out).reshape(7, *shape)
        return found[:3].movedim(0, -1), found[3:5].movedim(0, -1), found[5], found[6], None, None


def flat(x: Tensor) -> Array:
    """Values one after the other."""
    return np.ascontiguousarray(x.detach().reshape(-1).numpy())


@compiled
def extra_rate(places: Array, value: Array, length: float, rate: Array) -> None:
    """Set the correction `rate` [3, point].

    Parameters
    ----------
    places : [5, point], offset (3), m, and velocity (2), m/s
    value : [4, point], as of `looked_up`

    Notes
    -----
    With u_h = h a / L^2, u_z = b / L, t = ln(1 + r^2 / L^2) / 2: dt/dt = -(h . v) / (L^2 + r^2), dh/dt = -v_h.
    """
    for k in range(places.shape[1]):
        x, y, vx, vy = places[0, k], places[1, k], places[3, k], places[4, k]
        passed = -(x * vx + y * vy) / (length * length + x * x + y * y)
        a, grown = value[0, k] / length**2, value[1, k] * passed / length**2
        rate[0, k] = x * grown - vx * a
        rate[1, k] = y * grown - vy * a
        rate[2, k] = value[3, k] * passed / length


@compiled
def pulled_back(
    places: Array, value: Array, slope: Array, softness: Array, gradient: Array, length: float, out: Array
) -> None:
    """Set the gradient `out` [7, point] by offset (3), velocity (2), Poisson's ratio and `away`.

    Parameters
    ----------
    places, value : as of `extra_rate`
    slope : [4, 3, point], derivatives of `value`, see `interpolated`
    softness : [point], 1 - 2 nu
    gradient : [3, point], by the rate
    """
    for k in range(places.shape[1]):
        gx, gy, gz = gradient[0, k], gradient[1, k], gradient[2, k]
        x, y, z, vx, vy = places[0, k], places[1, k], places[2, k], places[3, k], places[4, k]
        c, along, speed = x * vx + y * vy, gx * x + gy * y, gx * vx + gy * vy
        # Boussinesq's, as in `solver.ground.wheel_motion.add_wheel`: a, a' = da/dr / r, a'' = da'/dr / r; b likewise.
        i2 = 1 / (x * x + y * y + z * z)
        i = np.sqrt(i2)
        i3 = i2 * i
        s = i / (1 + z * i)
        shallow = i * s
        bulge = i * s * shallow * (2 + z * i)
        soft, lobe = softness[k] * shallow, softness[k] * bulge
        z3i5 = 3 * z * i3 * i2
        a, a1 = z * i3 - soft, lobe - z3i5
        a2 = 5 * z3i5 * i2 + soft * s * i2 * (2 * i - (2 + z * i) * (3 * i + 2 * s))
        b1 = -(z * z3i5 + (1 + softness[k]) * i3)
        b2 = i2 * (5 * z * z3i5 + 3 * (1 + softness[k]) * i3)
        a_z, b1_z = i3 + soft * s, -2 * z3i5
        a1_z = soft * s * i2 - 2 * lobe * s - 3 * i3 * i2
        inner = along * a1 + gz * b1
        outer = speed * a1 + c * (along * a2 + gz * b2)
        # The table's.
        far = 1 / (length * length + x * x + y * y)
        passed = -c * far
        level, grown = value[0, k] / length**2, value[1, k] * passed / length**2
        by_a, by_slope, by_fall = -speed / length**2, along * passed / length**2, gz * passed / length
        by_passed = along * value[1, k] / length**2 + gz * value[3, k] / length
        turned = 2 * by_passed * c * far * far
        widened = by_a * slope[0, 0, k] + by_slope * slope[1, 0, k] + by_fall * slope[3, 0, k]
        turned += 2 * widened / length**2
        out[0, k] = gx * (grown - c * a1) - x * outer - vx * (inner + by_passed * far) + x * turned
        out[1, k] = gy * (grown - c * a1) - y * outer - vy * (inner + by_passed * far) + y * turned
        deeper = by_a * slope[0, 1, k] + by_slope * slope[1, 1, k] + by_fall * slope[3, 1, k]
        out[2, k] = deeper / length - z * outer - speed * a_z - c * (along * a1_z + gz * b1_z)
        out[3, k] = -gx * (a + level) - x * (inner + by_passed * far)
        out[4, k] = -gy * (a + level) - y * (inner + by_passed * far)
        out[5, k] = 2 * (c * (along * bulge - gz * i3) - speed * shallow)
        out[6, k] = by_a * slope[0, 2, k] + by_slope * slope[1, 2, k] + by_fall * slope[3, 2, k]
