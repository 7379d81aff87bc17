"""A vertical point load that moves steadily, slower than any wave, over a homogeneous half-space with inertia."""

from functools import cache

import numpy as np
import torch
from numpy.polynomial import Polynomial
from torch import Tensor

from solver.ground.blocks import double, in_blocks
from solver.ground.boussinesq import Ratio, displacement_rate, plain_values
from solver.ground.ground_law import Array, Law, Placed
from solver.ground.moving_sums import add_inertia, add_inertia_derivatives
from solver.ground.wheel_motion import Derivatives

#: (kernel and its order, order of the Bessel function) -> coefficients of powers of z / R.
Kernels = dict[tuple[str, int], list[Tensor]]
#: Kernels that enter downward, along the load's travel and outward from it: kernel, order of the Bessel function, and
#: shares of first and second order.
DOWN = ("w", 1, 3 / 4, 10 / 16), ("w", 3, 1 / 4, 5 / 16)
ALONG = ("v", 0, 3 / 8, 10 / 32), ("v", 2, 1 / 8, 5 / 32)
OUTWARD = ("v", 2, 3 / 8, 10 / 32), ("v", 4, 1 / 8, 5 / 32)
#: Those of second order alone: kernel, order of the Bessel function, share.
LAST = ("w", 5, 1 / 16), ("v", 4, 1 / 32), ("v", 6, 1 / 32)
#: Change of Poisson's ratio by which it is seen how kernels change: they are smooth in it.
STEP = 1e-4


class Moving(Law):
    """The law of `moving_displacement_rate`.

    Parameters
    ----------
    slowness : scalar, 1 / c_s^2, s^2/m^2
    """

    def __init__(self, slowness: Tensor):
        self.slowness = slowness

    def rate(self, offset: Tensor, velocity: Tensor, poisson_ratio: Ratio) -> Tensor:
        """As of `Law`."""
        return moving_displacement_rate(offset, velocity, poisson_ratio, self.slowness)

    def has_pass(self, derivatives: bool, uniform: bool) -> bool:
        """As of `Law`."""
        return uniform

    def added(self, at: Placed, poisson_ratio: Tensor) -> Array | None:
        """As of `Law`: of a ratio that is the same everywhere."""
        told = self._kernels(poisson_ratio)
        if told is None:
            return None
        out, (kernels, slowness) = at.nothing, told
        add_inertia(*at[:5], kernels[0], slowness, out)
        return out

    def derived(self, at: Placed, poisson_ratio: Tensor) -> Derivatives | None:
        """As of `Law`, likewise."""
        told = self._kernels(poisson_ratio)
        if told is None:
            return None
        out, (kernels, slowness) = Derivatives.nothing(at), told
        add_inertia_derivatives(*at[:5], *kernels, slowness, *out)
        return out

    def _kernels(self, poisson_ratio: Tensor) -> tuple[tuple[Array, Array], float] | None:
        """What `add_inertia` reads, its derivative by Poisson's ratio, and the slowness; None without a pass."""
        ratio = poisson_ratio.detach().flatten()
        if self.slowness.ndim or plain_values(self.slowness) is None or bool((ratio != ratio[0]).any()):
            return None
        slowness = float(self.slowness)
        one, here, two = (summed_kernels(_kernels(ratio[0] + step), slowness) for step in (-STEP, 0.0, STEP))
        return (here, (two - one) / (2 * STEP)), slowness


def summed_kernels(kernels: Kernels, slowness: float) -> Array:
    """Coefficients [down, along and outward, three each, 2, power] as `add_inertia` reads them."""
    out = np.zeros((9, 2, 8))
    for group, (both, (name, order, share)) in enumerate(zip((DOWN, ALONG, OUTWARD), LAST, strict=True)):
        for number, (kernel, of, *shares) in enumerate(both):
            for power, part in enumerate(shares):
                found = torch.stack(kernels[f"{kernel}{power + 1}", of]).numpy()
                out[3 * group + number, power, : len(found)] = part * found
        out[3 * group + 2, 0] = slowness * share * torch.stack(kernels[f"{name}2", order]).numpy()
    return out


def moving_displacement_rate(
    offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, shear_speed_inverse_squared: Ratio
) -> Tensor:
    """Displacement rate under a load in steady motion, to second order in (v / c_s)^2.

    Parameters
    ----------
    offset : [..., 3], ground point minus load point (x, y, z down), m
    velocity : [..., 2], horizontal velocity of the load, m/s
    poisson_ratio : scalar or [...]
    shear_speed_inverse_squared : scalar or [...], 1 / c_s^2, s^2/m^2; 0 is Boussinesq

    Returns
    -------
    [..., 3], 1/(m s), per F / (4 pi G)

    Notes
    -----
    Waves in direction k meet the load at the speed v . k: exp(-k z) becomes exp(-k gamma z) with gamma_i^2 =
    1 - (v . k)^2 / c_i^2. Powers of (v . k)^2 / c_s^2 have polynomials in k z as kernels, and these closed forms, with
    R = |offset|, c = z / R, p = (x + i y) / (R + z):
    int k^n e^(-k z) J_j(k r) dk e^(i j phi) = p^j R^-(n+1) Q_jn(c),
    Q_j0 = 1, Q_j(n+1) = (j + (n + 1) c) Q_jn - (1 - c^2) Q_jn'.
    Against the whole integral the peak is right to 0.03 % at v = 0.2 c_s and 0.3 % at 0.3 c_s.

    References
    ----------
    Eason 1965, Int. J. Engng Sci. 2; Lansing 1966, NASA TR R-238.

    >>> point = torch.tensor([3.0, 1.0, 0.9], dtype=torch.float64)
    >>> velocity = torch.tensor([20.0, 0.0], dtype=torch.float64)
    >>> moving_displacement_rate(point, velocity, 0.25, 1 / 100**2) / displacement_rate(point, velocity, 0.25)
    tensor([0.9935, 0.8546, 1.0110], dtype=torch.float64)
    """
    nu = double(poisson_ratio)
    shared = _kernels(nu) if nu.ndim == 0 else None

    def total(offset: Tensor, velocity: Tensor, nu: Tensor, slowness: Tensor) -> Tensor:
        kernels = shared or _kernels(nu)
        return displacement_rate(offset, velocity, nu) + _inertia(offset, velocity, slowness, kernels)

    return in_blocks(total, [offset, velocity], [nu, shear_speed_inverse_squared])


def _inertia(offset: Tensor, velocity: Tensor, slowness: Tensor, kernels: Kernels) -> Tensor:
    """Contribution of inertia, [point, 3]."""
    (x, y, z), (vx, vy) = offset.unbind(-1), velocity.unbind(-1)
    inverse = (x * x + y * y + z * z).rsqrt()
    c, reach = z * inverse, 1 / (1 / inverse + z)
    p = torch.complex(x * reach, y * reach)
    # Direction to the point relative to the load's direction of travel.
    q = torch.complex((x * vx + y * vy) * reach, (y * vx - x * vy) * reach)
    q2, speed2 = q * q, vx * vx + vy * vy
    q3 = q2 * q
    beta = slowness * speed2

    def kernel(name: str, order: int) -> Tensor:
        total = kernels[name, order][-1]
        for coefficient in reversed(kernels[name, order][:-1]):
            total = torch.addcmul(coefficient, total, c)
        return total

    def both(name: str, order: int, first: float, second: float) -> Tensor:
        return first * kernel(name + "1", order) + second * beta * kernel(name + "2", order)

    down, along, out = (slowness * share * kernel(name + "2", order) for name, order, share in LAST)
    vertical = speed2 * q.real * both(*DOWN[0]) - q3.real * both(*DOWN[1]) + (q3 * q2).real * down
    back = q2.conj()
    with_load = speed2 * both(*ALONG[0]) - back * both(*ALONG[1]) + back * back * along
    outward = -speed2 * q * both(*OUTWARD[0]) + q3 * both(*OUTWARD[1]) - q3 * q2 * out
    horizontal = -(torch.complex(vx, vy) * with_load + p * outward)
    scale = slowness * inverse * inverse
    return scale[..., None] * torch.stack([horizontal.real, horizontal.imag, vertical], -1)


def _first_order(nu: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Coefficients of powers of k z in the kernels W and V that go with (v . k)^2 / c_s^2; e^(-k z) is left out."""
    k, g = _ratios(nu)
    top = (k + 1) / 4
    return (
        [(3 * k**2 - 4 * k + 3) * g**2 / 4, (k**2 - k + 2) * g / 2, top],
        [-(k**2 + 1) * g**2 / 4, torch.full_like(k, 0.5), top],
    )


def _second_order(nu: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """The same for ((v . k)^2 / c_s^2)^2."""
    k, g = _ratios(nu)
    top = (k**2 + k + 1) / 24
    return (
        [
            -(k**4 + 2 * k**3 - 18 * k**2 + 22 * k - 11) * g**3 / 16,
            -(k**4 - 2 * k**3 - 6 * k**2 + 11 * k - 8) * g**2 / 8,
            (k**3 + k**2 - k + 5) * g / 16,
            top,
        ],
        [
            (k**4 - 2 * k**3 - 4 * k**2 + 6 * k - 5) * g**3 / 16,
            -(2 * k - 3) * g / 8,
            -(k**3 - k**2 + k - 3) * g / 16,
            top,
        ],
    )


def _ratios(nu: Tensor) -> tuple[Tensor, Tensor]:
    """(c_s / c_p)^2 and 1 / (1 - (c_s / c_p)^2)."""
    return (1 - 2 * nu) / (2 * (1 - nu)), 2 * (1 - nu)


def _kernels(nu: Tensor) -> Kernels:
    """Kernels W and V of first and second order, transformed with Bessel functions of each order that enters."""
    (w1, v1), (w2, v2) = _first_order(nu), _second_order(nu)
    entering = {"w1": (w1, (1, 3)), "v1": (v1, (0, 2, 4)), "w2": (w2, (1, 3, 5)), "v2": (v2, (0, 2, 4, 6))}
    return {(name, order): _angular(order, kernel) for name, (kernel, orders) in entering.items() for order in orders}


def _angular(order: int, kernel: list[Tensor]) -> list[Tensor]:
    """Coefficients of powers of c in the sum of kernel_l c^l Q_j(l+1)(c)."""
    powers = [torch.zeros_like(kernel[0])] * (2 * len(kernel))
    for i, share in enumerate(kernel):
        for degree, factor in enumerate(_legendre(order, i + 1)):
            powers[i + degree] = powers[i + degree] + factor * share
    return powers


@cache
def _legendre(order: int, power: int) -> tuple[float, ...]:
    """Coefficients of Q_jn."""
    polynomial = Polynomial([1.0])
    for n in range(power):
        polynomial = Polynomial([order, n + 1]) * polynomial - Polynomial([1, 0, -1]) * polynomial.deriv()
    return tuple(polynomial.coef)
