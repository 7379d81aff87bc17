"""A steadily moving load as an integral over directions of exact plane solutions, sharing nothing with the package."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rate(offset: Array, velocity: Array, nu: float, shear_speed: float, directions: int = 20001) -> Array:
    """Displacement rate [point, 3] per F / (4 pi G).

    Of each direction of waves, P and S parts fall like exp(-k gamma z); integrals over k are 1 / (gamma z - i s)^2.
    """
    angle = 2 * np.pi * (np.arange(directions) + 0.5) / directions
    way = np.array([np.cos(angle), np.sin(angle)])
    speed = velocity @ way
    mach = (speed / shear_speed) ** 2
    slow, fast = np.sqrt(1 - mach), np.sqrt(1 - mach * (1 - 2 * nu) / (2 - 2 * nu))
    c = 1 - mach / 2
    rayleigh = c**2 - slow * fast
    s, z = offset[:, :2] @ way, offset[:, 2:]
    p, q = 1 / (fast * z - 1j * s) ** 2, 1 / (slow * z - 1j * s) ** 2
    vertical = (c * fast * p - fast * q) / rayleigh
    along = (c * p - fast * slow * q) / rayleigh
    down = (-1j * speed * vertical).mean(-1).real
    across = [(-speed * along * w).mean(-1).real for w in way]
    return np.column_stack([*across, down])
