"""A law of the ground that differs from Boussinesq's by Gaussians of the distance from the wheel."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.boussinesq import Ratio, Response, displacement_rate, plain_values
from solver.ground.compiled import compiled
from solver.ground.ground_law import Law, Placed
from solver.ground.lanes import LANES, put
from solver.ground.wheel_motion import Derivatives, add_wheel, response_at

Array = NDArray[np.float64]

#: Half the square of a distance, in the scale of a Gaussian, beyond which it is no more than rounding beside 1.
BEYOND = 40.0


class Belled(Law):
    """A law times one plus Gaussians of the distance from the wheel: even, odd along travel, and even across.

    Parameters
    ----------
    law : that is multiplied; None: Boussinesq's
    scales : of the Gaussians, m
    near, ahead, beside : numbers of each scale
    """

    def __init__(
        self,
        law: Response | None,
        scales: Sequence[float],
        near: Sequence[Tensor],
        ahead: Sequence[Tensor],
        beside: Sequence[Tensor],
    ):
        self.law, self.scales, self.numbers = law, scales, (near, ahead, beside)

    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """As of `Law`."""
        base = (self.law or displacement_rate)(offset, velocity, poisson_ratio)
        (x, y, _), (along, across) = offset.unbind(-1), velocity.unbind(-1)
        forward = (x * along + y * across) / (along**2 + across**2).sqrt().clamp_min(1e-3)
        square = x**2 + y**2
        factor, aside = torch.ones_like(square), 1 - forward**2 / square.clamp_min(1e-6)
        for scale, near, ahead, beside in zip(self.scales, *self.numbers, strict=True):
            if not nothing(near, ahead, beside):
                even = near + ahead * forward / scale + beside * aside
                factor = factor + even * torch.exp(-square / (2 * scale**2))
        return base * factor[..., None]

    def has_pass(self, derivatives: bool, uniform: bool) -> bool:
        """As of `Law`."""
        return self.law is None

    def added(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """As of `Law`: where Boussinesq's law is multiplied, by the same numbers everywhere."""
        bells = self._bells()
        if bells is None:
            return None
        out = at.nothing
        add_belled(*at, *bells, out)
        return out

    def derived(self, at: Placed, poisson_ratio: Tensor) -> Derivatives | None:
        """As of `Law`, where `added` has one."""
        bells = self._bells()
        if bells is None:
            return None
        out = Derivatives.nothing(at)
        add_belled_derivatives(*at, *bells, *out)
        return out

    def _bells(self) -> tuple[Array, Array] | None:
        """Scales [scale] and numbers [3, scale]; None where there is no pass."""
        numbers = [one for some in self.numbers for one in some]
        if self.law is not None or plain_values(*numbers) is None or any(one.ndim for one in numbers):
            return None
        return np.array(self.scales), torch.stack(numbers).numpy().reshape(3, -1)


def nothing(*numbers: Tensor) -> bool:
    """Whether numbers are all zero, and no derivative by them is asked for.

    >>> nothing(torch.zeros(2).double()), nothing(torch.zeros(2).double().requires_grad_())
    (True, False)
    """
    return plain_values(*numbers) is not None and not any(bool(one.any()) for one in numbers)


@partial(compiled, fastmath=True)
def add_belled(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    softness: Array,
    scales: Array,
    numbers: Array,
    out: Array,
) -> None:
    """Add what Gaussians add to the response of gauges to `out` [row, channel].

    Parameters
    ----------
    point, weight, place, share, velocity, softness : as of `solver.ground.ground_law.Placed`
    scales, numbers : [scale], m, and [3, scale], as of `Belled`
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    base, square, forward = np.empty(channels), np.empty(channels), np.empty(channels)
    for row in range(rows):
        vx, vy = velocity[0, row], velocity[1, row]
        speed = max(np.sqrt(vx * vx + vy * vy), 1e-3)
        for p in range(points):
            xs, ys, zs = point[0, 0, p], point[1, 0, p], point[2, 0, p]
            dxs, dys, dzs, soft = weight[0, 0, p], weight[1, 0, p], weight[2, 0, p], softness[0, p]
            for wheel in range(wheels):
                w, px, py = share[wheel, row], place[0, wheel, row], place[1, wheel, row]
                for k in range(channels):
                    x, y = xs[k] - px, ys[k] - py
                    square[k], forward[k] = x * x + y * y, (vx * x + vy * y) / speed
                    base[k] = w * response_at(x, y, zs[k], vx, vy, dxs[k], dys[k], dzs[k], soft[k])
                for k in range(channels):
                    factor, aside = 0.0, 1 - forward[k] ** 2 / max(square[k], 1e-6)
                    for n in range(len(scales)):
                        fallen = square[k] / (2 * scales[n] ** 2)
                        even = numbers[0, n] + numbers[1, n] * forward[k] / scales[n] + numbers[2, n] * aside
                        if even != 0 and fallen < BEYOND:
                            factor += even * np.exp(-fallen)
                    out[row, k] += base[k] * factor


@partial(compiled, fastmath=True)
def add_belled_derivatives(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    softness: Array,
    scales: Array,
    numbers: Array,
    by_point: Array,
    by_wheel: Array,
    by_velocity: Array,
) -> None:
    """Add the derivatives of `add_belled`'s sums with respect to all but scales and numbers.

    Parameters
    ----------
    point, weight, place, share, velocity, softness, scales, numbers : see there
    by_point, by_wheel, by_velocity : as of `solver.ground.wheel_motion.Derivatives`
    """
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    given, found = np.ones(7 * LANES), np.empty(12 * LANES)
    for row in range(rows):
        vx, vy = velocity[0, row], velocity[1, row]
        speed = max(np.sqrt(vx * vx + vy * vy), 1e-3)
        for p in range(points):
            for first in range(0, channels, LANES):
                count = min(LANES, channels - first)
                for i in range(3):
                    put(point[i, 0, p, first:], given[i * LANES :], count)
                    put(weight[i, 0, p, first:], given[(3 + i) * LANES :], count)
                put(softness[0, p, first:], given[6 * LANES :], count)
                for wheel in range(wheels):
                    px, py, w = place[0, wheel, row], place[1, wheel, row], share[wheel, row]
                    found[: 9 * LANES] = 0
                    add_wheel(given, px, py, w, vx, vy, (count + 7) // 8 * 8, found)
                    for k in range(count):
                        x, y = given[k] - px, given[LANES + k] - py
                        factor, by_x, by_y, by_vx, by_vy = bells_at(x, y, vx / speed, vy / speed, scales, numbers)
                        at, alone = first + k, found[11 * LANES + k]
                        base = w * alone
                        for i in range(7):
                            by_point[i, row, p, at] += factor * found[i * LANES + k]
                        by_point[3, row, p, at] += base * by_x
                        by_point[4, row, p, at] += base * by_y
                        by_wheel[0, wheel, row, at] += factor * found[9 * LANES + k] - base * by_x
                        by_wheel[1, wheel, row, at] += factor * found[10 * LANES + k] - base * by_y
                        by_wheel[2, wheel, row, at] += factor * alone
                        by_velocity[0, row, at] += factor * found[7 * LANES + k] + base * by_vx / speed
                        by_velocity[1, row, at] += factor * found[8 * LANES + k] + base * by_vy / speed


@partial(compiled, fastmath=True)
def bells_at(
    x: float, y: float, along: float, across: float, scales: Array, numbers: Array
) -> tuple[float, float, float, float, float]:
    """The sum of Gaussians at an offset from the wheel, and its derivatives by the offset and by velocity over speed.

    `along` and `across` are the direction of travel.
    """
    square, forward = max(x * x + y * y, 1e-6), x * along + y * across
    share = forward / square
    factor, by_x, by_y, by_forward = 0.0, 0.0, 0.0, 0.0
    for n in range(len(scales)):
        fallen = square / (2 * scales[n] ** 2)
        if fallen < BEYOND:
            bell = np.exp(-fallen)
            even = numbers[0, n] + numbers[1, n] * forward / scales[n] + numbers[2, n] * (1 - forward * share)
            factor += even * bell
            radial = bell * (2 * numbers[2, n] * share * share - even / scales[n] ** 2)
            by_x += radial * x
            by_y += radial * y
            by_forward += bell * (numbers[1, n] / scales[n] - 2 * numbers[2, n] * share)
    turned_x, turned_y = x - forward * along, y - forward * across
    return (
        factor,
        by_x + by_forward * along,
        by_y + by_forward * across,
        by_forward * turned_x,
        by_forward * turned_y,
    )
