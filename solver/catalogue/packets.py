"""Packets of waves that follow each vehicle at a constant distance."""

from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.catalogue.bells import BEYOND, nothing
from solver.ground.boussinesq import plain_values
from solver.ground.compiled import compiled
from solver.ground.ground_law import Placed, Waves
from solver.ground.radiated import TROUGH

Array = NDArray[np.float64]

#: m aside at which a wave that follows a vehicle has lost a third.
ASIDE = 10.0


class Packet(Waves):
    """Motion along travel, half a wavelength wide (sd); 1 strains the ground as the trough does nearby.

    Parameters
    ----------
    sine, cosine : [row, 1] or one for all, of either phase
    behind : scalar, distance of the packet behind the vehicle, m
    wavelength : scalar, m
    """

    def __init__(self, sine: Tensor, cosine: Tensor, behind: Tensor, wavelength: Tensor):
        self.sine, self.cosine, self.behind, self.wavelength = sine, cosine, behind, wavelength

    def __call__(self, offset: Tensor, velocity: Tensor, time: Tensor) -> Tensor:
        """As of `Waves`."""
        k = 2 * torch.pi / self.wavelength
        waves = [(self.sine, torch.sin), (self.cosine, torch.cos)]
        shown = [(size.reshape(time.shape), shape) for size, shape in waves if not nothing(size)]
        if not shown:
            return torch.zeros_like(offset)
        (x, y, _), (along, across) = offset.unbind(-1), velocity.unbind(-1)
        speed = (along**2 + across**2).sqrt().clamp_min(1e-3)
        along, across = along / speed, across / speed
        behind = -(x * along + y * across) - self.behind
        aside = (x * across - y * along) / ASIDE
        wave = sum(size * shape(k * behind) for size, shape in shown)
        bell = torch.exp(-2 * (behind / self.wavelength) ** 2)
        moved = speed / TROUGH**3 / k * bell * (1 + aside**2) ** -0.5 * wave
        return torch.stack([moved * along, moved * across, torch.zeros_like(moved)]).movedim(0, -1)

    def summed(self, at: Placed, time: Array) -> Array | None:
        """As of `Waves`."""
        sizes = [size.reshape(-1).expand(len(time)) for size in (self.sine, self.cosine)]
        values = plain_values(*sizes, self.behind, self.wavelength)
        if values is None:
            return None
        (sine, cosine), out = map(np.ascontiguousarray, values[:2]), at.nothing
        add_packets(*at[:5], sine, cosine, float(self.behind), float(self.wavelength), out)
        return out


@partial(compiled, fastmath=True)
def add_packets(
    point: Array,
    weight: Array,
    place: Array,
    share: Array,
    velocity: Array,
    sine: Array,
    cosine: Array,
    behind: float,
    wavelength: float,
    out: Array,
) -> None:
    """Add the response of gauges to `out` [row, channel]; arguments as of `Placed` and, [row], of `Packet`."""
    wheels, rows = share.shape
    points, channels = point.shape[2:]
    wave = 2 * np.pi / wavelength
    for row in range(rows):
        if sine[row] == 0 and cosine[row] == 0:
            continue
        speed = max(np.sqrt(velocity[0, row] ** 2 + velocity[1, row] ** 2), 1e-3)
        along, across = velocity[0, row] / speed, velocity[1, row] / speed
        for p in range(points):
            for wheel in range(wheels):
                scale = share[wheel, row] * speed / TROUGH**3 / wave
                for k in range(channels):
                    x, y = point[0, 0, p, k] - place[0, wheel, row], point[1, 0, p, k] - place[1, wheel, row]
                    late = -(x * along + y * across) - behind
                    fallen = 2 * (late / wavelength) ** 2
                    if fallen >= BEYOND:
                        continue
                    told = sine[row] * np.sin(wave * late) + cosine[row] * np.cos(wave * late)
                    moved = scale * np.exp(-fallen) * told / np.sqrt(1 + ((x * across - y * along) / ASIDE) ** 2)
                    out[row, k] += moved * (weight[0, 0, p, k] * along + weight[1, 0, p, k] * across)
