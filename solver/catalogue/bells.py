"""A law of the ground that differs from Boussinesq's by Gaussians of the distance from the wheel."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.boussinesq import Ratio, Response, displacement_rate, plain_values
from solver.ground.compiled import compiled
from solver.ground.law import Law, Placed

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

    def summed(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """As of `Law`: where Boussinesq's law is multiplied, by the same numbers everywhere."""
        numbers = [one for some in self.numbers for one in some]
        if self.law is not None or plain_values(*numbers) is None or any(one.ndim for one in numbers):
            return None
        out = at.nothing
        add_belled(*at, np.array(self.scales), torch.stack(numbers).numpy().reshape(3, -1), out)
        return out


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
    """Add the response of gauges to `out` [row, channel].

    Parameters
    ----------
    point, weight, place, share, velocity, softness : as of `solver.ground.law.Placed`
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
                # As in `solver.ground.wheel_motion.add_response`.
                for k in range(channels):
                    x, y, z = xs[k] - px, ys[k] - py, zs[k]
                    square[k] = x * x + y * y
                    i2 = 1 / (square[k] + z * z)
                    i = np.sqrt(i2)
                    i3 = i2 * i
                    s = i / (1 + z * i)
                    shallow = i * s
                    a = z * i3 - soft[k] * shallow
                    a1 = soft[k] * i * s * shallow * (2 + z * i) - 3 * z * i3 * i2
                    b1 = -(3 * z * z * i3 * i2 + (1 + soft[k]) * i3)
                    c = vx * x + vy * y
                    along = dxs[k] * x + dys[k] * y
                    base[k] = -w * ((dxs[k] * vx + dys[k] * vy) * a + c * (along * a1 + dzs[k] * b1))
                    forward[k] = c / speed
                for k in range(channels):
                    factor, aside = 1.0, 1 - forward[k] ** 2 / max(square[k], 1e-6)
                    for n in range(len(scales)):
                        fallen = square[k] / (2 * scales[n] ** 2)
                        even = numbers[0, n] + numbers[1, n] * forward[k] / scales[n] + numbers[2, n] * aside
                        if even != 0 and fallen < BEYOND:
                            factor += even * np.exp(-fallen)
                    out[row, k] += base[k] * factor
