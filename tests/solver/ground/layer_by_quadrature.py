"""A layer on a half-space once more, sharing nothing with the package: six boundary conditions and plain quadrature."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0, j1

Array = NDArray[np.float64]


def falling(s: Array, nu: float) -> Array:
    """W, V, sigma_zz, sigma_rz [4, 2, k] of the two solutions that fall with s = k z; stresses per 2 k G."""
    fall, one = np.exp(-s), np.ones_like(s)
    return fall * np.array([[2 - 2 * nu + s, one], [s - 1 + 2 * nu, one], [-(1 + s), -one], [-s, -one]])


def both(s: Array, thickness: Array, nu: float) -> Array:
    """The falling solutions and, mirrored, those that grow towards the bottom: [4, 4, k]."""
    mirror = np.array([-1.0, 1, 1, -1])[:, None, None]
    return np.concatenate([falling(s, nu), mirror * falling(thickness - s, nu)], 1)


def kernel(k: Array, z: float, h: float, ratio: float, nu: float) -> Array:
    """W, V [2, k] at depth z, less Boussinesq's; unit F / (4 pi G_layer)."""
    top, bottom = both(0 * k, k * h, nu), both(k * h, k * h, nu)
    below = falling(0 * k, nu) / np.array([1, 1, ratio, ratio])[:, None, None]
    conditions, load = np.zeros((len(k), 6, 6)), np.zeros((len(k), 6))
    conditions[:, :2, :4] = top[2:].transpose(2, 0, 1)
    conditions[:, 2:, :4] = bottom.transpose(2, 0, 1)
    conditions[:, 2:, 4:] = -below.transpose(2, 0, 1)
    load[:, 0] = -1
    share = np.linalg.solve(conditions, load[..., None])[..., 0].T
    shapes, used = (both(k * z, k * h, nu), share[:4]) if z <= h else (falling(k * (z - h), nu), share[4:])
    return np.einsum("ijk,jk->ik", shapes[:2], used) - falling(k * z, nu)[:2, 0]


def rate(offset: Array, z: float, h: float, ratio: float, nu: float) -> Array:
    """Displacement rate [point, 3] at `offset` [point, 2] from a load moving along x at 1 m/s."""
    r = np.hypot(*offset.T)
    reach = 45 / (max(z, 2 * h - z) if z <= h else z)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(0, 1, int(reach * max(r.max(), 1) / 2) + 200) ** 1.5 * reach
    half = np.diff(edges)[:, None] / 2
    k, w = (edges[:-1, None] + half * (1 + nodes)).ravel(), (half * weights).ravel()
    vertical, radial = kernel(k, z, h, ratio, nu)
    kr = np.outer(r, k)
    hoop, slope = j1(kr) @ (w * radial) / r, (j0(kr) - j1(kr) / kr) @ (w * k * radial)
    fall = -j1(kr) @ (w * k * vertical)
    # Boussinesq, differentiated by hand.
    big, soft = np.hypot(r, z), 1 - 2 * nu
    hoop += z / big**3 - soft / (big * (big + z))
    slope += z / big**3 - 3 * r**2 * z / big**5
    slope -= soft * (1 / (big * (big + z)) - r**2 * (2 * big + z) / (big**3 * (big + z) ** 2))
    fall -= 3 * z**2 * r / big**5 + (1 + soft) * r / big**3
    c, s = offset.T / r
    return -np.column_stack([slope * c * c + hoop * s * s, (slope - hoop) * c * s, fall * c])
