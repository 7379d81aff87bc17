"""Surface waves that vehicles send out."""

from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.boussinesq import plain_values
from solver.ground.compiled import compiled
from solver.ground.ground_law import Placed, Waves
from solver.ground.waves import sent_from

Array = NDArray[np.float64]

#: m; the trough of a car some meters beside a gauge of 10 m strains it at about its speed over this length cubed.
TROUGH = 7.5
#: m; where the wave's strength is told, and within what distance it grows no more.
FAR, NEAR = 10.0, 3.0


class Radiated(Waves):
    """Radial motion of a phase of each vehicle's own; 1 strains the ground 10 m away as its trough does nearby.

    Parameters
    ----------
    sine, cosine : [row, 1] or one for all, of either phase
    frequency : scalar, Hz
    speed : scalar, of the waves, m/s
    """

    def __init__(self, sine: Tensor, cosine: Tensor, frequency: Tensor, speed: Tensor):
        self.sine, self.cosine, self.frequency, self.speed = sine, cosine, frequency, speed

    def __call__(self, offset: Tensor, velocity: Tensor, time: Tensor) -> Tensor:
        """As of `Waves`."""
        omega = 2 * torch.pi * self.frequency
        (x, y, _), (vx, vy) = offset.unbind(-1), velocity.unbind(-1)
        r = (x * x + y * y + NEAR**2).sqrt()
        toward = (x * vx + y * vy) / r
        phase = omega * (time - sent_from(r, toward, velocity.norm(dim=-1), self.speed) / self.speed)
        wave = self.sine.reshape(time.shape) * torch.sin(phase) + self.cosine.reshape(time.shape) * torch.cos(phase)
        strength = velocity.norm(dim=-1) / TROUGH**3 * self.speed / omega * (FAR / r).sqrt()
        moved = strength * wave / r
        return torch.stack([moved * x, moved * y, torch.zeros_like(moved)]).movedim(0, -1)

    def summed(self, at: Placed, time: Array) -> Array | None:
        """As of `Waves`."""
        sizes = [size.reshape(-1).expand(len(time)) for size in (self.sine, self.cosine)]
        values = plain_values(*sizes, self.frequency, self.speed)
        if values is None:
            return None
        (sine, cosine), out = map(np.ascontiguousarray, values[:2]), at.nothing
        add_radiated(*at[:5], time, sine, cosine, float(self.frequency), float(self.speed), out)
        return out


@partial(compiled, fastmath=True)
def add_radiated(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    time: Array,
    sine: Array,
    cosine: Array,
    frequency: float,
    wave_speed: float,
    out: Array,
) -> None:
    """Add the response of gauges to `out` [row, channel]; arguments as of `Placed` and, [row], of `Radiated`."""
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    omega = 2 * np.pi * frequency
    for row in range(rows):
        if sine[row] == 0 and cosine[row] == 0:
            continue
        vx, vy = velocity[0, row], velocity[1, row]
        speed = np.sqrt(vx * vx + vy * vy)
        rest = 1 - (speed / wave_speed) ** 2
        # A sum of both phases as one cosine.
        size, turned = np.hypot(sine[row], cosine[row]), np.arctan2(sine[row], cosine[row])
        for p in range(points):
            for wheel in range(wheels):
                scale = share[wheel, row] * size * speed / TROUGH**3 * wave_speed / omega * np.sqrt(FAR)
                for k in range(channels):
                    x, y = point[0, 0, p, k] - place[0, wheel, row], point[1, 0, p, k] - place[1, wheel, row]
                    r = np.sqrt(x * x + y * y + NEAR**2)
                    # As in `solver.ground.waves.sent_from`.
                    closing = (x * vx + y * vy) / (r * wave_speed)
                    sent = r * (closing + np.sqrt(closing * closing + rest)) / rest
                    wave = np.cos(omega * (time[row] - sent / wave_speed) - turned)
                    toward = weight[0, 0, p, k] * x + weight[1, 0, p, k] * y
                    out[row, k] += scale * wave * toward / (r * np.sqrt(r))
