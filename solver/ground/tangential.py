"""A tangential load on the surface of a homogeneous elastic half-space (Cerruti): braking, grades, camber."""

import torch
from torch import Tensor

from solver.ground.boussinesq import Ratio


def tangential_displacement(offset: Tensor, poisson_ratio: Ratio, direction: Tensor) -> Tensor:
    """Displacement of the ground under a horizontal point load, per unit Q / (4 pi G).

    With s = d . (x, y), R = |offset| and k = 1 - 2 nu:
    u_h = d (1 / R + k / (R + z)) + h s (1 / R^3 - k / (R (R + z)^2));  u_z = s (z / R^3 + k / (R (R + z))).

    Parameters
    ----------
    offset : [..., 3], ground point minus load point (x, y, z down), m
    poisson_ratio : scalar or [...]
    direction : [..., 2], horizontal direction of the force on the ground; its length scales the force

    Returns
    -------
    [..., 3], 1/m; times Q / (4 pi G) in m^2 it is meters

    References
    ----------
    Cerruti 1882; Johnson 1985, Contact Mechanics, eq. 3.75.

    >>> along_x = torch.tensor([1.0, 0.0], dtype=torch.float64)
    >>> tangential_displacement(torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64), 0.25, along_x)
    tensor([0.6250, 0.0000, 0.0000], dtype=torch.float64)
    """
    x, y, z = offset.unbind(-1)
    dx, dy = direction.unbind(-1)
    inverse = (x * x + y * y + z * z).rsqrt()
    reach = 1 / (1 / inverse + z)
    softness = 1 - 2 * poisson_ratio
    along = x * dx + y * dy
    plain = inverse + softness * reach
    dipole = along * inverse * (inverse**2 - softness * reach**2)
    vertical = along * inverse * (z * inverse**2 + softness * reach)
    return torch.stack([dx * plain + x * dipole, dy * plain + y * dipole, vertical]).movedim(0, -1)


def tangential_displacement_rate(offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, direction: Tensor) -> Tensor:
    """Time derivative of `tangential_displacement` at a fixed ground point while the load moves, in closed form.

    Parameters
    ----------
    offset : [..., 3], ground point minus load point, m
    velocity : [..., 2], horizontal velocity of the load, m/s
    poisson_ratio : scalar or [...]
    direction : [..., 2], horizontal direction of the force on the ground, constant in time

    Returns
    -------
    [..., 3], 1/(m s)

    Notes
    -----
    With u_h = d p + h s q, u_z = s w, and p, q, w functions of R and z: dh/dt = -v_h, ds/dt = -d . v,
    dR/dt = -(h . v) / R.

    >>> offset = torch.tensor([3.0, 1.0, 0.9], dtype=torch.float64)
    >>> v, d = torch.tensor([[10.0, 0.0], [1.0, 0.0]], dtype=torch.float64)
    >>> step = torch.tensor([10.0, 0.0, 0.0], dtype=torch.float64) * 1e-6
    >>> before, after = (tangential_displacement(offset + sign * step, 0.25, d) for sign in (1, -1))
    >>> numeric = (after - before) / 2e-6
    >>> bool(torch.allclose(tangential_displacement_rate(offset, v, 0.25, d), numeric, rtol=1e-6))
    True
    """
    x, y, z = offset.unbind(-1)
    vx, vy = velocity.unbind(-1)
    dx, dy = direction.unbind(-1)
    inverse = (x * x + y * y + z * z).rsqrt()
    reach = 1 / (1 / inverse + z)
    softness = 1 - 2 * poisson_ratio
    square, soft = inverse * inverse, softness * reach
    q = inverse * (square - soft * reach)
    w = inverse * (z * square + soft)
    # Derivatives with respect to R.
    dp = -square - soft * reach
    dq = square * (soft * reach - 3 * square) + 2 * inverse * soft * reach**2
    dw = -square * (3 * z * square + soft) - inverse * soft * reach
    along, drift = x * dx + y * dy, dx * vx + dy * vy
    approach = (x * vx + y * vy) * inverse
    turn = drift * q + along * approach * dq
    horizontal = [-d * approach * dp - v * along * q - h * turn for d, v, h in ((dx, vx, x), (dy, vy, y))]
    return torch.stack([*horizontal, -drift * w - along * approach * dw]).movedim(0, -1)
