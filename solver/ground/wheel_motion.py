"""Response of gauges to wheels on a homogeneous elastic half-space, with all derivatives, in machine code."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from solver.ground.boussinesq import forward_mode
from solver.ground.compiled import compiled
from solver.ground.lanes import LANES, add, put

Array = NDArray[np.float64]


def gauge_response(
    point: Tensor, weight: Tensor, place: Tensor, share: Tensor, velocity: Tensor, ratio: Tensor
) -> Tensor | None:
    """Sum over points and wheels of weight . displacement rate, by `solver.ground.boussinesq.displacement_rate`.

    Differentiable once, in backward mode, with respect to all arguments; each may have fewer axes or axes of size 1.

    Parameters
    ----------
    point, weight : [row, channel, point, 3], m and 1/m
    place : [row, channel, wheel, 2], m
    share : [row, channel, wheel]
    velocity : [row, channel, 2], m/s
    ratio : [row, channel, point], Poisson's

    Returns
    -------
    [row, channel], 1/(m^2 s) per unit weight; None if places differ by channel, or a forward derivative is needed

    >>> from solver.ground.boussinesq import displacement_rate
    >>> at, v = torch.tensor([[[[3.0, 1.0, 0.9]]]]).double(), torch.tensor([[[10.0, 0.0]]]).double()
    >>> one, nu = torch.ones(1, 1, 1).double(), torch.tensor(0.25).double()
    >>> found = gauge_response(at, at, torch.zeros(1, 1, 1, 2).double(), one, v, nu)
    >>> bool(torch.allclose(found, (at * displacement_rate(at, v[0, 0], nu)).sum((-1, -2))))
    True
    """
    given = spread(point, weight, place, share, velocity, ratio)
    if given is None:
        return None
    arrays = arranged(given)
    if torch.is_grad_enabled() and any(one.requires_grad for one in given):
        derivatives = Derivatives.nothing(arrays)
        add_derivatives(*arrays, *derivatives)
        return differentiable(given, derivatives)
    out = np.zeros((len(given[0]), given[0].shape[1]))
    add_response(*arrays, out)
    return torch.from_numpy(out)


class Derivatives(NamedTuple):
    """Derivatives of a sum [row, channel] over points and wheels by all arguments of `gauge_response`.

    Attributes
    ----------
    by_point : [7, row, point, channel], with respect to weight (3), point (3) and Poisson's ratio
    by_wheel : [3, wheel, row, channel], with respect to place (2) and share
    by_velocity : [2, row, channel]
    """

    by_point: Array
    by_wheel: Array
    by_velocity: Array

    @classmethod
    def nothing(cls, arrays: Sequence[Array]) -> "Derivatives":
        """None yet, for what `arranged` gives."""
        (points, channels), (wheels, rows) = arrays[0].shape[2:], arrays[3].shape
        shapes = (7, rows, points, channels), (3, wheels, rows, channels), (2, rows, channels)
        return cls(*map(np.zeros, shapes))

    def plus(self, other: "Derivatives", share: float = 1.0) -> "Derivatives":
        """The sum with a share of others."""
        return Derivatives(*(one + share * two for one, two in zip(self, other, strict=True)))

    def times(self, share: float) -> "Derivatives":
        """A share of them."""
        return Derivatives(*(share * one for one in self))


def differentiable(given: tuple[Tensor, ...], derivatives: Derivatives) -> Tensor:
    """The sum [row, channel], which carries its derivatives; `given` as of `spread`.

    Strain rate is proportional to the wheels' shares: these derivatives hold the sum itself.
    """
    found: Tensor = _Sum.apply(derivatives, *given)
    return found


def spread(
    point: Tensor, weight: Tensor, place: Tensor, share: Tensor, velocity: Tensor, ratio: Tensor
) -> tuple[Tensor, ...] | None:
    """Arguments of `gauge_response` with all their axes; None where it returns None."""
    shape = np.broadcast_shapes(point.shape[:-1], weight.shape[:-1], (*place.shape[:2], 1), ratio.shape)
    rows, channels, _ = shape
    given = (
        point.expand(*shape, 3),
        weight.expand(*shape, 3),
        place.expand(rows, channels, -1, 2),
        share.expand(rows, channels, -1),
        velocity.expand(rows, channels, 2),
        ratio.expand(shape),
    )
    same = all(x.shape[1] == 1 or x.stride(1) == 0 for x in given[2:5])
    return given if same and not any(map(forward_mode, given)) else None


def packed(x: Tensor, order: tuple[int, ...]) -> Array:
    """Values in a given order of axes; a single row if all are the same."""
    x = x.detach()
    x = x[:1] if x.stride(0) == 0 else x
    return np.ascontiguousarray(x.permute(order).numpy())


class _Sum(torch.autograd.Function):
    """`differentiable`."""

    @staticmethod
    def forward(ctx: Any, derivatives: Derivatives, *given: Tensor) -> Tensor:
        ctx.save_for_backward(*map(torch.from_numpy, derivatives))
        share = given[3][:, 0].detach().T.numpy()
        return torch.from_numpy(np.einsum("wrc,wr->rc", derivatives.by_wheel[2], share))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        whole, wheel, speed = ctx.saved_tensors
        if not bool((gradient == 1).all()):
            whole, wheel, speed = whole * gradient[:, None], wheel * gradient, speed * gradient
        vectors, wheel = whole.permute(1, 3, 2, 0), wheel.permute(2, 3, 1, 0)
        by_point = vectors[..., 3:6], vectors[..., :3]
        return None, *by_point, wheel[..., :2], wheel[..., 2], speed.permute(1, 2, 0), vectors[..., 6]


def arranged(given: tuple[Tensor, ...]) -> tuple[Array, Array, Array, Array, Array, Array]:
    """What `spread` gives, as compiled loops read it, see `add_response`."""
    point, weight, place, share, velocity, ratio = given
    return (
        packed(point, (3, 0, 2, 1)),
        packed(weight, (3, 0, 2, 1)),
        np.ascontiguousarray(place[:, 0].detach().permute(2, 1, 0).numpy()),
        np.ascontiguousarray(share[:, 0].detach().T.numpy()),
        np.ascontiguousarray(velocity[:, 0].detach().T.numpy()),
        1 - 2 * packed(ratio, (0, 2, 1)),
    )


@partial(compiled, fastmath=True)
def response_at(
    x: float, y: float, z: float, vx: float, vy: float, dx: float, dy: float, dz: float, soft: float
) -> float:
    """Weight (dx, dy, dz) . displacement rate at an offset from a wheel; `soft` is 1 - 2 nu."""
    i2 = 1 / (x * x + y * y + z * z)
    i = np.sqrt(i2)
    i3 = i2 * i
    s = i / (1 + z * i)
    shallow = i * s
    a = z * i3 - soft * shallow
    a1 = soft * i * s * shallow * (2 + z * i) - 3 * z * i3 * i2
    b1 = -(3 * z * z * i3 * i2 + (1 + soft) * i3)
    c = vx * x + vy * y
    return -((dx * vx + dy * vy) * a + c * ((dx * x + dy * y) * a1 + dz * b1))


@partial(compiled, fastmath=True)
def add_response(
    point: Array, weight: Array, place: Array, share: Array, velocity: Array, softness: Array, out: Array
) -> None:
    """Add the response to each wheel to `out` [row, channel].

    Parameters
    ----------
    point, weight : [3, 1 or row, point, channel]
    place, velocity : [2, wheel, row] and [2, row]
    share : [wheel, row]
    softness : [1 or row, point, channel], 1 - 2 nu
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    for row in range(rows):
        vx, vy = velocity[0, row], velocity[1, row]
        at, by, of = min(row, point.shape[1] - 1), min(row, weight.shape[1] - 1), min(row, len(softness) - 1)
        for p in range(points):
            xs, ys, zs = point[0, at, p], point[1, at, p], point[2, at, p]
            dxs, dys, dzs = weight[0, by, p], weight[1, by, p], weight[2, by, p]
            soft, total = softness[of, p], out[row]
            for wheel in range(wheels):
                w, px, py = share[wheel, row], place[0, wheel, row], place[1, wheel, row]
                for k in range(channels):
                    x, y = xs[k] - px, ys[k] - py
                    total[k] += w * response_at(x, y, zs[k], vx, vy, dxs[k], dys[k], dzs[k], soft[k])


@partial(compiled, fastmath=True)
def add_derivatives(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    softness: Array,
    by_point: Array,
    by_wheel: Array,
    by_velocity: Array,
) -> None:
    """Add the derivatives of `add_response`'s sums with respect to all its arguments.

    Parameters
    ----------
    point, weight, place, share, velocity, softness : see there
    by_point, by_wheel, by_velocity : as of `Derivatives`
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    # What is read and written side by side lies in two arrays: only then does the compiler know that they are apart,
    # and work on several channels at once.
    given, found = np.ones(7 * LANES), np.empty(12 * LANES)
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
                for wheel in range(wheels):
                    x, y, w = place[0, wheel, row], place[1, wheel, row], share[wheel, row]
                    add_wheel(given, x, y, w, velocity[0, row], velocity[1, row], (count + 7) // 8 * 8, found)
                    for i in range(3):
                        add(found[(9 + i) * LANES :], by_wheel[i, wheel, row, first:], count)
                for i in range(7):
                    add(found[i * LANES :], by_point[i, row, p, first:], count)
                for i in range(2):
                    add(found[(7 + i) * LANES :], by_velocity[i, row, first:], count)


@partial(compiled, fastmath=True)
def add_wheel(given: Array, px: float, py: float, w: float, vx: float, vy: float, count: int, found: Array) -> None:
    """Derivatives at one wheel for the first channels, a multiple of 8 as the processor takes them.

    Parameters
    ----------
    given : [7 * LANES], point (3), weight (3) and softness
    px, py, w : place and share of the wheel
    vx, vy : velocity
    found : [12 * LANES]; those of `by_point` (7) and of `by_velocity` (2) are added, of `by_wheel` (3) set

    Notes
    -----
    With offset (x, y, z) and load velocity v, h = (x, y), C = h . v, the horizontal response h a, the vertical b:
    motion = -(v a + h C a', C b'), where a' and b' are derivatives by r, over r (Johnson 1985, eq. 3.18).
    """
    for k in range(count):
        x, y, z = given[k] - px, given[LANES + k] - py, given[2 * LANES + k]
        dx, dy, dz = given[3 * LANES + k], given[4 * LANES + k], given[5 * LANES + k]
        softness = given[6 * LANES + k]
        i2 = 1 / (x * x + y * y + z * z)
        i = np.sqrt(i2)
        i3 = i2 * i
        s = i / (1 + z * i)
        shallow = i * s
        bulge = i * s * shallow * (2 + z * i)
        soft, lobe = softness * shallow, softness * bulge
        zi3 = z * i3
        z3i5 = 3 * zi3 * i2
        # a, a' = da/dr / r, and a'' = da'/dr / r; b likewise.
        a = zi3 - soft
        a1 = lobe - z3i5
        a2 = 5 * z3i5 * i2 + soft * s * i2 * (2 * i - (2 + z * i) * (3 * i + 2 * s))
        b1 = -(z * z3i5 + (1 + softness) * i3)
        b2 = i2 * (5 * z * z3i5 + 3 * (1 + softness) * i3)
        # Derivatives by depth at constant r.
        a_z = i3 + soft * s
        a1_z = soft * s * i2 - 2 * lobe * s - 3 * i3 * i2
        b1_z = -2 * z3i5
        c = vx * x + vy * y
        reach = c * a1
        along = dx * x + dy * y
        speed = dx * vx + dy * vy
        mx, my, mz = vx * a + x * reach, vy * a + y * reach, c * b1
        inner = along * a1 + dz * b1
        outer = speed * a1 + c * (along * a2 + dz * b2)
        gx = w * (x * outer + vx * inner + dx * reach)
        gy = w * (y * outer + vy * inner + dy * reach)
        gz = z * outer + speed * a_z + c * (along * a1_z + dz * b1_z)
        found[k] -= w * mx
        found[LANES + k] -= w * my
        found[2 * LANES + k] -= w * mz
        found[3 * LANES + k] -= gx
        found[4 * LANES + k] -= gy
        found[5 * LANES + k] -= w * gz
        # By `softness`, whose derivative by Poisson's ratio is -2.
        found[6 * LANES + k] += 2 * w * (c * (along * bulge - dz * i3) - speed * shallow)
        found[7 * LANES + k] -= w * (dx * a + x * inner)
        found[8 * LANES + k] -= w * (dy * a + y * inner)
        found[9 * LANES + k] = gx
        found[10 * LANES + k] = gy
        found[11 * LANES + k] = -(mx * dx + my * dy + mz * dz)
