"""Ground stage: response of a homogeneous elastic half-space to a vertical load (Boussinesq)."""

from collections.abc import Callable
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd import forward_ad

from solver.ground.compiled import elementwise

Array = NDArray[np.float64]

Ratio = Tensor | float
#: (offset [..., 3], velocity [..., 2], Poisson's ratio) -> displacement rate [..., 3] of a unit load.
Response = Callable[[Tensor, Tensor, Ratio], Tensor]


def displacement(offset: Tensor, poisson_ratio: Ratio) -> Tensor:
    """Displacement of the ground under a vertical point load, per unit F / (4 pi G).

    u_h = h / r^2 (z / r - (1 - 2 nu) / (1 + z / r)) for h in {x, y};  u_z = 1 / r (z^2 / r^2 + 2 (1 - nu)).

    Parameters
    ----------
    offset : [..., 3], ground point minus load point (x, y, z down), m
    poisson_ratio : scalar or [...]

    Returns
    -------
    [..., 3], 1/m; times F / (4 pi G) in m^2 it is meters

    References
    ----------
    Boussinesq 1885; Johnson 1985, Contact Mechanics, eq. 3.18.

    >>> displacement(torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64), 0.25)
    tensor([0.0000, 0.0000, 1.2500], dtype=torch.float64)
    """
    x, y, z = offset.unbind(-1)
    inverse = (x * x + y * y + z * z).rsqrt()
    steep = z * inverse * inverse * inverse
    radial = steep - (1 - 2 * poisson_ratio) * inverse / (1 / inverse + z)
    return torch.stack([x * radial, y * radial, z * steep + 2 * (1 - poisson_ratio) * inverse]).movedim(0, -1)


def displacement_rate(offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
    """Time derivative of `displacement` at a fixed ground point while the load moves, in closed form.

    Parameters
    ----------
    offset : [..., 3], ground point minus load point, m
    velocity : [..., 2], horizontal velocity of the load, m/s
    poisson_ratio : scalar or [...]

    Returns
    -------
    [..., 3], 1/(m s)

    Notes
    -----
    With u_h = h a(r, z), u_z = b(r, z), dh/dt = -v_h and dr/dt = -(h . v) / r:
    du_h/dt = -v_h a - h (h . v) / r da/dr;  du_z/dt = -(h . v) / r db/dr.

    >>> offset = torch.tensor([3.0, 1.0, 0.9], dtype=torch.float64)
    >>> v = torch.tensor([10.0, 0.0], dtype=torch.float64)
    >>> step = torch.tensor([10.0, 0.0, 0.0], dtype=torch.float64) * 1e-6
    >>> numeric = (displacement(offset - step, 0.25) - displacement(offset + step, 0.25)) / 2e-6
    >>> bool(torch.allclose(displacement_rate(offset, v, 0.25), numeric, rtol=1e-6))
    True
    """
    softness = torch.as_tensor(1 - 2 * poisson_ratio, dtype=torch.float64)
    values = plain_values(*offset.unbind(-1), *velocity.unbind(-1), softness)
    if values is not None:
        shape = np.broadcast_shapes(*(one.shape for one in values))
        rate = np.empty((3, *shape))
        machine_rate()(*values, rate[0, ...], rate[1, ...], rate[2, ...])
        return torch.from_numpy(rate).movedim(0, -1)
    x, y, z = offset.unbind(-1)
    vx, vy = velocity.unbind(-1)
    inverse = (x * x + y * y + z * z).rsqrt()
    r = 1 / inverse
    shallow = inverse / (r + z)
    inverse2 = inverse * inverse
    a = z * inverse * inverse2 - softness * shallow
    da = softness * (2 * r + z) * shallow * shallow - 3 * z * inverse2 * inverse2
    db = -inverse2 * (3 * z * z * inverse2 + 1 + softness)
    approach = (x * vx + y * vy) * inverse
    # Components outermost in memory, so that the operations below run along long rows.
    return torch.stack([-vx * a - x * approach * da, -vy * a - y * approach * da, -approach * db]).movedim(0, -1)


def plain_values(*tensors: Tensor) -> list[Array] | None:
    """Values of tensors in double precision; None if one carries a derivative or is of another type."""
    if any(x.requires_grad or x.dtype != torch.float64 or forward_mode(x) for x in tensors):
        return None
    return [x.numpy() for x in tensors]


def forward_mode(x: Tensor) -> bool:
    """Whether a tensor carries a forward derivative, or is one of `torch.func`, which has no values of its own."""
    if torch._C._functorch.is_functorch_wrapped_tensor(x):
        return True
    return forward_ad.unpack_dual(x).tangent is not None


@cache
def machine_rate() -> Callable[..., None]:
    """`displacement_rate` in machine code: one pass over memory instead of about thirty."""
    return elementwise(_rate, 6, 3)


def _rate(
    x: float, y: float, z: float, vx: float, vy: float, softness: float, along_x: Array, along_y: Array, down: Array
) -> None:
    square = x * x + y * y + z * z
    r = np.sqrt(square)
    inverse2 = 1 / square
    inverse = r * inverse2
    shallow = inverse / (r + z)
    a = z * inverse * inverse2 - softness * shallow
    da = softness * (2 * r + z) * shallow * shallow - 3 * z * inverse2 * inverse2
    db = -inverse2 * (3 * z * z * inverse2 + 1 + softness)
    approach = (x * vx + y * vy) * inverse
    along_x[0] = -vx * a - x * approach * da
    along_y[0] = -vy * a - y * approach * da
    down[0] = -approach * db
