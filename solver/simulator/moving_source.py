"""Strain that the ground's inertia adds under a moving load: the steady state of a point load on a half-space.

In the load's frame every wave of the ground's surface with wavenumber k decays downwards as exp(-gamma z),
gamma_i^2 = k^2 - k_x^2 v^2 / c_i^2 for shear and pressure waves (Eason 1965). The horizontal strains, less their static
limit, are summed by a two-dimensional FFT; vertical motion, for a fiber with slopes of a few percent, is left out of
this small difference.
"""

import numpy as np
from numpy.typing import NDArray

from solver.simulator.axle_forces import contact
from solver.simulator.scenario import Scenario
from solver.simulator.vehicle import GRAVITY, Vehicle

Array = NDArray[np.float64]
PITCH = 0.4  # m between points of a table
SHAPE = (1024, 512)  # points along and across the load's path
REFERENCE = 15.0  # m/s, speed to which the scenario's amount refers


class Inertia:
    """Extension that inertia adds at the nodes of a fiber, times 4 pi G, as the vehicles drive.

    Parameters
    ----------
    scenario : speed of shear waves, Poisson ratio
    points, tangents : [3, node]
    """

    def __init__(self, scenario: Scenario, points: Array, tangents: Array):
        self.scenario, self.points, self.tangents = scenario, points, tangents
        z = points[2]
        self.levels = np.linspace(z.min(), z.max() + 1e-6, 3)
        place = (z[None] - self.levels[:, None]) / np.ptp(self.levels)
        others = [[j for j in range(3) if j != i] for i in range(3)]
        # Lagrange's weights of the three levels at each node.
        self.share = np.stack(
            [np.prod([(place[j]) / (place[j] - place[i]) for j in pair], 0) for i, pair in enumerate(others)]
        )
        self.tables: dict[str, Array] = {}

    def extension(self, vehicle: Vehicle, time: Array) -> Array:
        """[time, node], N/m^2 times 4 pi."""
        from scipy.ndimage import map_coordinates

        table = self.tables.get(vehicle.track_id)
        if table is None:
            table = self.tables[vehicle.track_id] = self._table(vehicle)
        place = vehicle.position(time)
        dx = vehicle.direction * (self.points[0] - place[:, :1])
        dy = vehicle.direction * (self.points[1] - place[:, 1:])
        at = np.stack([dx / PITCH + SHAPE[0] // 2, dy / PITCH + SHAPE[1] // 2])
        tx, ty, _ = self.tangents
        total = np.zeros_like(dx)
        for level in range(3):
            for part, tangents in enumerate((tx * tx, ty * ty, 2 * tx * ty)):
                total += self.share[level] * tangents * map_coordinates(table[level, part], at, order=1)
        return vehicle.mass * GRAVITY * total

    def _table(self, vehicle: Vehicle) -> Array:
        """xx, yy and xy strain [level, 3, along, across] of a whole vehicle, centered in the table."""
        slowness = self.scenario.effect("moving_load") / REFERENCE
        nu = self.scenario.poisson_ratio + self.scenario.effect("poisson_ratio")
        kx = np.asarray(2 * np.pi * np.fft.fftfreq(SHAPE[0], PITCH)[:, None], np.float64)
        ky = 2 * np.pi * np.fft.rfftfreq(SHAPE[1], PITCH)[None, :]
        now = np.array([vehicle.time_at])
        wheels, force = contact(self.scenario, vehicle, now)
        from_middle = vehicle.direction * (wheels[0] - vehicle.position(now))
        load = sum(
            weight * np.exp(-1j * (kx * x + ky * y))
            for (x, y), weight in zip(from_middle, force[0, :, 2] / (vehicle.mass * GRAVITY), strict=True)
        )
        k = np.hypot(kx, ky)
        k[0, 0] = 1.0
        table = np.empty((3, 3, *SHAPE))
        for level, z in enumerate(self.levels):
            spread = load * excess(k, kx, z, vehicle.speed * slowness, nu) / PITCH**2
            for part, product in enumerate((kx * kx, ky * ky, kx * ky)):
                table[level, part] = np.fft.fftshift(np.fft.irfft2(-product / k * spread, SHAPE))
        return table


def excess(k: Array, kx: Array, z: float, speed: float, nu: float) -> Array:
    """Transform of the displacement along the wave, over i, less the static one; unit load, 4 pi G = 1.

    Parameters
    ----------
    k, kx : 1/m; wavenumber and its component along the path
    z : m
    speed : of the load, relative to that of shear waves; below the Rayleigh waves' (0.87 and more)
    nu : Poisson ratio

    >>> import numpy as np
    >>> k = np.array([1.0])
    >>> small, large = (excess(k, k, 0.5, speed, 0.25)[0] for speed in (0.1, 0.2))
    >>> bool(3.9 < large / small < 4.5)  # as the square of the speed
    True
    """
    slow: Array = (kx * speed) ** 2
    gamma_s = np.sqrt(k**2 - slow)
    gamma_p = np.sqrt(k**2 - slow * (1 - 2 * nu) / (2 - 2 * nu))
    shear = k**2 + gamma_s**2
    rayleigh = shear**2 - 4 * k**2 * gamma_p * gamma_s
    moving = -k * shear * np.exp(-gamma_p * z) + 2 * k * gamma_p * gamma_s * np.exp(-gamma_s * z)
    static = (k * z - (1 - 2 * nu)) * np.exp(-k * z) / (2 * k)  # the limit is its negative
    slanted = slow > 1e-8 * k**2  # waves across the path stand still
    return 4 * np.pi * np.where(slanted, moving / np.where(slanted, rayleigh, 1.0) + static, 0.0)
