"""Response of gauges to forces that push along the road or change, on a homogeneous half-space, in machine code."""

from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from solver.ground.boussinesq import forward_mode
from solver.ground.compiled import compiled
from solver.ground.lanes import LANES, add, put
from solver.ground.wheel_motion import packed

Array = NDArray[np.float64]


def forces_response(
    point: Tensor,
    weight: Tensor,
    place: Tensor,
    share_rate: Tensor,
    thrust: Tensor,
    thrust_rate: Tensor,
    velocity: Tensor,
    ratio: Tensor,
) -> Tensor | None:
    """Sum over points and wheels of weight . velocity of the ground, as forces on the road push and change.

    Of a change of the vertical force (`solver.ground.boussinesq.displacement`), of a push that moves on and of its
    change (`solver.ground.tangential`). Differentiable once, in backward mode, with respect to all arguments; each may
    have fewer axes or axes of size 1.

    Parameters
    ----------
    point, weight : [row, channel, point, 3], m and 1/m
    place : [row, channel, wheel, 2], m
    share_rate : [row, channel, wheel], 1/s
    thrust, thrust_rate : [row, channel, wheel, 2], and 1/s
    velocity : [row, channel, 2], m/s
    ratio : [row, channel, point], Poisson's

    Returns
    -------
    [row, channel], 1/(m^2 s) per unit weight; None if places differ by channel, or a forward derivative is needed

    >>> from solver.ground.tangential import tangential_displacement_rate
    >>> at, v = torch.tensor([[[[3.0, 1.0, 0.9]]]]).double(), torch.tensor([[[10.0, 0.0]]]).double()
    >>> push, none = torch.tensor([[[[0.2, 0.1]]]]).double(), torch.zeros(1, 1, 1, 2).double()
    >>> nu = torch.tensor(0.25).double()
    >>> found = forces_response(at, at, none, none[..., 0], push, none, v, nu)
    >>> bool(torch.allclose(found, (at * tangential_displacement_rate(at, v[0, 0], nu, push)).sum((-1, -2))))
    True
    """
    shape = np.broadcast_shapes(point.shape[:-1], weight.shape[:-1], (*place.shape[:2], 1), ratio.shape)
    rows, channels, _ = shape
    given = (
        point.expand(*shape, 3),
        weight.expand(*shape, 3),
        place.expand(rows, channels, -1, 2),
        share_rate.expand(rows, channels, -1),
        thrust.expand(rows, channels, -1, 2),
        thrust_rate.expand(rows, channels, -1, 2),
        velocity.expand(rows, channels, 2),
        ratio.expand(shape),
    )
    same = all(x.shape[1] == 1 or x.stride(1) == 0 for x in given[2:7])
    if not same or any(map(forward_mode, given)):
        return None
    found: Tensor = _ForcesResponse.apply(*given)
    return found


class _ForcesResponse(torch.autograd.Function):
    """`forces_response` for arguments that have all their axes."""

    @staticmethod
    def forward(ctx: Any, *given: Tensor) -> Tensor:
        point, weight, place, share_rate, thrust, thrust_rate, velocity, ratio = given
        rows, channels, points, _ = point.shape
        wheels = torch.cat([place, thrust, thrust_rate, share_rate[..., None]], -1)[:, 0].detach()
        arrays = (
            packed(point, (3, 0, 2, 1)),
            packed(weight, (3, 0, 2, 1)),
            np.ascontiguousarray(wheels.permute(2, 1, 0).numpy()),
            np.ascontiguousarray(velocity[:, 0].detach().T.numpy()),
            1 - 2 * packed(ratio, (0, 2, 1)),
        )
        by_wheel = np.zeros((7, place.shape[2], rows, channels))
        if any(ctx.needs_input_grad):
            by_point, by_velocity = np.zeros((7, rows, points, channels)), np.zeros((2, rows, channels))
            add_derivatives(*arrays, by_point, by_wheel, by_velocity)
            ctx.save_for_backward(*map(torch.from_numpy, (by_point, by_wheel, by_velocity)))
        else:
            add_forces(*arrays, by_wheel)
        # Strain rate is proportional to the forces.
        return torch.from_numpy(np.einsum("fwrc,fwr->rc", by_wheel[2:], arrays[2][2:]))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, ...]:
        whole, wheel, speed = ctx.saved_tensors
        if not bool((gradient == 1).all()):
            whole, wheel, speed = whole * gradient[:, None], wheel * gradient, speed * gradient
        vectors, wheel = whole.permute(1, 3, 2, 0), wheel.permute(2, 3, 1, 0)
        forces = wheel[..., 6], wheel[..., 2:4], wheel[..., 4:6]
        return vectors[..., 3:6], vectors[..., :3], wheel[..., :2], *forces, speed.permute(1, 2, 0), vectors[..., 6]


@partial(compiled, fastmath=True)
def add_forces(point: Array, weight: Array, wheels: Array, velocity: Array, softness: Array, by_wheel: Array) -> None:
    """Add the response to each unit force to `by_wheel` [2:]; arguments as of `add_derivatives`."""
    _, count, rows = wheels.shape
    points, channels = point.shape[2:]
    for row in range(rows):
        vx, vy = velocity[0, row], velocity[1, row]
        at, by, of = min(row, point.shape[1] - 1), min(row, weight.shape[1] - 1), min(row, len(softness) - 1)
        for p in range(points):
            xs, ys, zs = point[0, at, p], point[1, at, p], point[2, at, p]
            gxs, gys, gzs = weight[0, by, p], weight[1, by, p], weight[2, by, p]
            soft = softness[of, p]
            for wheel in range(count):
                px, py = wheels[0, wheel, row], wheels[1, wheel, row]
                push_x, push_y = by_wheel[2, wheel, row], by_wheel[3, wheel, row]
                jerk_x, jerk_y = by_wheel[4, wheel, row], by_wheel[5, wheel, row]
                bounce = by_wheel[6, wheel, row]
                for k in range(channels):
                    x, y, z = xs[k] - px, ys[k] - py, zs[k]
                    gx, gy, gz = gxs[k], gys[k], gzs[k]
                    i2 = 1 / (x * x + y * y + z * z)
                    i = np.sqrt(i2)
                    t = i / (1 + z * i)
                    i3, kt = i * i2, soft[k] * t
                    p0, p1 = i + kt, -i3 - kt * i * t
                    q, q1 = i3 - kt * i * t, -3 * i3 * i2 + kt * t * i2 * (i + 2 * t)
                    w, w1 = z * i3 + kt * i, -3 * z * i3 * i2 - kt * i2 * (i + t)
                    c, g, e = vx * x + vy * y, gx * x + gy * y, gx * vx + gy * vy
                    turned = g * q + gz * w
                    outer = e * q + c * (g * q1 + gz * w1)
                    push_x[k] -= c * p1 * gx + turned * vx + outer * x
                    push_y[k] -= c * p1 * gy + turned * vy + outer * y
                    jerk_x[k] += p0 * gx + turned * x
                    jerk_y[k] += p0 * gy + turned * y
                    bounce[k] += g * (z * i3 - kt * i) + gz * (z * z * i3 + (1 + soft[k]) * i)


@partial(compiled, fastmath=True)
def add_derivatives(
    point: Array,
    weight: Array,
    wheels: Array,
    velocity: Array,
    softness: Array,
    by_point: Array,
    by_wheel: Array,
    by_velocity: Array,
) -> None:
    """Add the derivatives of `forces_response`'s sums with respect to all its arguments.

    Parameters
    ----------
    point, weight : [3, 1 or row, point, channel]
    wheels : [7, wheel, row], place (2), thrust (2), its rate (2), and the rate of the share
    velocity : [2, row]
    softness : [1 or row, point, channel], 1 - 2 nu
    by_point : [7, row, point, channel], with respect to weight (3), point (3) and Poisson's ratio
    by_wheel : [7, wheel, row, channel], with respect to `wheels`
    by_velocity : [2, row, channel]
    """
    _, total, rows = wheels.shape
    points, channels = point.shape[2:]
    # In two arrays, so that the compiler knows that what is read and what is written are apart.
    given, found = np.ones(7 * LANES), np.empty(16 * LANES)
    for row in range(rows):
        at, by, of = min(row, point.shape[1] - 1), min(row, weight.shape[1] - 1), min(row, len(softness) - 1)
        for p in range(points):
            for first in range(0, channels, LANES):
                count = min(LANES, channels - first)
                for i in range(3):
                    put(point[i, at, p, first:], given[i * LANES :], count)
                    put(weight[i, by, p, first:], given[(3 + i) * LANES :], count)
                put(softness[of, p, first:], given[6 * LANES :], count)
                found[: 9 * LANES] = 0
                for wheel in range(total):
                    one = wheels[:, wheel, row]
                    add_forces_of(given, one, velocity[0, row], velocity[1, row], (count + 7) // 8 * 8, found)
                    for i in range(7):
                        add(found[(9 + i) * LANES :], by_wheel[i, wheel, row, first:], count)
                for i in range(7):
                    add(found[i * LANES :], by_point[i, row, p, first:], count)
                for i in range(2):
                    add(found[(7 + i) * LANES :], by_velocity[i, row, first:], count)


@partial(compiled, fastmath=True)
def add_forces_of(given: Array, wheel: Array, vx: float, vy: float, count: int, found: Array) -> None:
    """Derivatives at one wheel for the first channels, a multiple of 8 as the processor takes them.

    Parameters
    ----------
    given : [7 * LANES], point (3), weight (3) and softness
    wheel : [7], as `wheels` of `add_derivatives`
    vx, vy : velocity
    found : [16 * LANES]; those of `by_point` (7) and of `by_velocity` (2) are added, of `by_wheel` (7) set

    Notes
    -----
    With h = (x, y), weight g, force d: a push moves the ground by (g . d) p + (g . h)(d . h) q + g_z (d . h) w, as of
    `solver.ground.tangential`, and while it moves on by -(v . grad) of that; a vertical force by (g . h) a + g_z b.
    f1 is df/dR / R of f(R, z), f2 that of f1, f_z the derivative by z at constant R; of p, q, w and a the part that is
    in proportion to the softness has an s.
    """
    px, py, dx, dy, ex, ey, r = wheel[0], wheel[1], wheel[2], wheel[3], wheel[4], wheel[5], wheel[6]
    for k in range(count):
        x, y, z = given[k] - px, given[LANES + k] - py, given[2 * LANES + k]
        gx, gy, gz = given[3 * LANES + k], given[4 * LANES + k], given[5 * LANES + k]
        soft = given[6 * LANES + k]
        i2 = 1 / (x * x + y * y + z * z)
        i = np.sqrt(i2)
        t = i / (1 + z * i)
        i3, it, t2 = i * i2, i * t, t * t
        i5 = i3 * i2
        i7 = i5 * i2
        qs, qs1 = -it * t, i2 * t2 * (i + 2 * t)
        qs2, qs1_z = -3 * i3 * t2 * (i2 + 2 * it + 2 * t2), -2 * i2 * t2 * t * (i + 3 * t)
        ws1, ws2 = -i * it * (i + t), i3 * t * (3 * i2 + 3 * it + 2 * t2)
        p, p1, p2 = i + soft * t, -i3 + soft * qs, 3 * i5 + soft * qs1
        q, q1, q2 = i3 + soft * qs, -3 * i5 + soft * qs1, 15 * i7 + soft * qs2
        w, w1, w2 = z * i3 + soft * it, -3 * z * i5 + soft * ws1, 15 * z * i7 + soft * ws2
        q_z = 2 * soft * it * t2
        p1_z, q1_z = q_z, soft * qs1_z
        w_z, w1_z = i3 + soft * qs, -3 * i5 + soft * qs1
        a, a1, a_z = z * i3 - soft * it, -3 * z * i5 - soft * ws1, i3 - soft * qs
        b, b1, b_z = z * z * i3 + (1 + soft) * i, -3 * z * z * i5 - (1 + soft) * i3, 2 * z * i3
        c, g, speed = vx * x + vy * y, gx * x + gy * y, gx * vx + gy * vy
        # The push that moves on, less its sign.
        s, pull, drift = dx * x + dy * y, gx * dx + gy * dy, dx * vx + dy * vy
        both = speed * s + g * drift
        turned = g * q + gz * w
        outer = speed * q + c * (g * q1 + gz * w1)
        inner = pull * c * p2 + both * q1 + g * s * c * q2 + gz * (drift * w1 + s * c * w2)
        by_z = pull * c * p1_z + both * q_z + g * s * c * q1_z + gz * (drift * w_z + s * c * w1_z)
        on_g = drift * q + s * c * q1
        on_v = pull * p1 + s * (g * q1 + gz * w1)
        # Its change, and that of the vertical force.
        u, fall = ex * x + ey * y, gx * ex + gy * ey
        rest = fall * p1 + u * (g * q1 + gz * w1) + r * (g * a1 + gz * b1)
        found[k] += ex * p + x * u * q + r * x * a - (dx * c * p1 + vx * s * q + x * on_g)
        found[LANES + k] += ey * p + y * u * q + r * y * a - (dy * c * p1 + vy * s * q + y * on_g)
        found[2 * LANES + k] += u * w + r * b - (drift * w + s * c * w1)
        hx = gx * (u * q + r * a - on_g) + ex * turned - dx * outer - vx * on_v + x * (rest - inner)
        hy = gy * (u * q + r * a - on_g) + ey * turned - dy * outer - vy * on_v + y * (rest - inner)
        found[3 * LANES + k] += hx
        found[4 * LANES + k] += hy
        still = -soft * t2 * fall + u * (g * q_z + gz * w_z) + r * (g * a_z + gz * b_z)
        found[5 * LANES + k] += z * (rest - inner) + still - by_z
        softer = t * fall + u * (g * qs + gz * it) + r * (gz * i - g * it)
        softer -= pull * c * qs + both * qs + g * s * c * qs1 + gz * (drift * it + s * c * ws1)
        # By `softness`, whose derivative by Poisson's ratio is -2.
        found[6 * LANES + k] -= 2 * softer
        found[7 * LANES + k] -= pull * x * p1 + gx * s * q + dx * turned + x * s * (g * q1 + gz * w1)
        found[8 * LANES + k] -= pull * y * p1 + gy * s * q + dy * turned + y * s * (g * q1 + gz * w1)
        found[9 * LANES + k] = -hx
        found[10 * LANES + k] = -hy
        found[11 * LANES + k] = -(gx * c * p1 + vx * turned + x * outer)
        found[12 * LANES + k] = -(gy * c * p1 + vy * turned + y * outer)
        found[13 * LANES + k] = gx * p + x * turned
        found[14 * LANES + k] = gy * p + y * turned
        found[15 * LANES + k] = g * a + gz * b
