"""An elastic layer on a half-space of another stiffness: soft soil on rock, or a pavement on soil."""

import torch
from torch import Tensor

from solver.ground.boussinesq import Ratio
from solver.ground.correction import Corrected, Tables
from solver.ground.images import images
from solver.ground.layer_stack import Stack
from solver.ground.response_table import Cells, RadialTable

#: Depths over the thickness of the layer: equal steps in the layer, equal ratios below.
INSIDE = torch.linspace(0, 1, 9, dtype=torch.float64)
BELOW = torch.logspace(0, 2.6, 50, dtype=torch.float64)


def layered_displacement(offset: Tensor, poisson_ratio: Ratio, log_ratio: Ratio, thickness: Ratio) -> Tensor:
    """Displacement under a vertical point load on a layer on a half-space, per unit F / (4 pi G_layer).

    Parameters
    ----------
    offset : [..., 3], ground point minus load point (x, y, z down), m
    poisson_ratio : scalar or [...], of layer and half-space, to .49
    log_ratio : scalar, ln(G_layer / G_below), -2.5 to 3.7; 0 is Boussinesq
    thickness : scalar, of the layer, .05 to 8 m; below 398 thicknesses the correction no longer changes with depth

    Returns
    -------
    [..., 3], 1/m

    References
    ----------
    Burmister 1943, Proc. Highway Research Board 23; Kausel & Roesset 1981, Bull. Seism. Soc. Am. 71.

    >>> point = torch.tensor([3.0, 1.0, 0.9], dtype=torch.float64)
    >>> layered_displacement(point, 0.25, 0.7, 2.0)
    tensor([-0.0520, -0.0173,  0.9450], dtype=torch.float64)
    """
    return layered(log_ratio, thickness).displacement(offset, poisson_ratio)


def layered_displacement_rate(
    offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, log_ratio: Ratio, thickness: Ratio
) -> Tensor:
    """Time derivative of `layered_displacement` at a fixed ground point while the load moves.

    Parameters
    ----------
    offset, poisson_ratio, log_ratio, thickness : see `layered_displacement`
    velocity : [..., 2], horizontal velocity of the load, m/s

    Returns
    -------
    [..., 3], 1/(m s), per F / (4 pi G_layer)

    >>> point, velocity = torch.tensor([3.0, 1.0, 0.9]), torch.tensor([10.0, 0.0])
    >>> layered_displacement_rate(point, velocity, 0.25, 0.0, 2.0)  # Boussinesq
    tensor([0.2027, 0.0309, 1.4559])
    """
    return layered(log_ratio, thickness).rate(offset, velocity, poisson_ratio)


def layered(log_ratio: Ratio, thickness: Ratio) -> Corrected:
    """A layer on ground of another stiffness, see `layered_displacement`; its tables are built once."""
    return Corrected(layered_tables(torch.expm1(-scalar(log_ratio))), thickness)


def pavement_displacement_rate(
    offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, stiffness: Ratio, thickness: Ratio = 0.2
) -> Tensor:
    """Displacement rate under a load on a thin stiff layer: `layered_displacement_rate` in a pavement's parameters.

    Parameters
    ----------
    offset : [..., 3], ground point minus load point on the pavement, m
    velocity : [..., 2], horizontal velocity of the load, m/s
    poisson_ratio : scalar or [...], of pavement and ground
    stiffness : scalar, excess stiffness over the ground that the pavement replaces, (G_pavement / G_ground - 1)
        thickness, 0 to 12 m; 0 is Boussinesq
    thickness : scalar, of the pavement, .05 to .3 m

    Returns
    -------
    [..., 3], 1/(m s), per F / (4 pi G_ground)

    >>> point = torch.tensor([3.0, 1.0, 0.9], dtype=torch.float64)
    >>> velocity = torch.tensor([10.0, 0.0], dtype=torch.float64)
    >>> pavement_displacement_rate(point, velocity, 0.25, 3.8)  # 0.2 m, twenty times as stiff
    tensor([0.2883, 0.1261, 1.3303], dtype=torch.float64)
    """
    return paved(stiffness, thickness).rate(offset, velocity, poisson_ratio)


def paved(stiffness: Ratio, thickness: Ratio = 0.2) -> Corrected:
    """Ground under a thin stiff layer, see `pavement_displacement_rate`; its tables are built once."""
    excess = scalar(stiffness) / thickness
    return Corrected(layered_tables(-excess / (1 + excess)), thickness, 1 / (1 + excess))


def layered_table(poisson_ratio: Tensor, contrast: Tensor) -> RadialTable:
    """Tabulate the correction by a layer to Boussinesq's displacement, per unit F / (4 pi G_layer) and unit thickness.

    Parameters
    ----------
    poisson_ratio : scalar
    contrast : scalar, G_below / G_layer - 1

    Notes
    -----
    K du = -(K - K_0) u_0 with u_0 Boussinesq's and K_0 its stiffness: (K - K_0) u_0 is the jump of modulus at the
    interface times Boussinesq's traction there, so that du is exactly zero without a jump.
    """
    hankel = images(0.5, 1000.0, 44, 2e4, 0.125)
    k = hankel.wavenumber
    same = torch.ones(len(INSIDE) - 1, dtype=k.dtype)
    stack = Stack(k, INSIDE[1:], torch.cat([same, 1 + contrast[None]]), poisson_ratio)
    traction = boussinesq_traction(k)
    force = torch.cat([torch.zeros(len(same), *traction.shape, dtype=k.dtype), -contrast * traction[None]])
    moved = stack.displacement(force)
    top, bottom = stack.slope(moved)
    below, below_slope = _continued(moved[-1], k, poisson_ratio)
    return RadialTable.of(
        Cells(
            torch.cat([INSIDE, BELOW[1:]]),
            torch.cat([moved[:-1], below[:-1]]),
            torch.cat([moved[1:], below[1:]]),
            torch.cat([top, below_slope[:-1]]),
            torch.cat([bottom, below_slope[1:]]),
        ),
        hankel,
    )


def boussinesq_traction(s: Tensor) -> Tensor:
    """Boussinesq's traction -(sigma_zz, sigma_rz) [..., 2] at wavenumber times depth `s`, per 2 k G.

    >>> boussinesq_traction(torch.tensor([0.0, 1.0]))
    tensor([[1.0000, 0.0000],
            [0.7358, 0.3679]])
    """
    return torch.stack([1 + s, s], -1) * torch.exp(-s)[..., None]


def scalar(parameter: Ratio) -> Tensor:
    """A parameter common to all points, in double precision.

    >>> scalar(1)
    tensor(1., dtype=torch.float64)
    """
    return torch.as_tensor(parameter, dtype=torch.float64).reshape(())


def layered_tables(contrast: Tensor) -> Tables:
    """Tables, for any Poisson's ratio, of a layer on ground of another stiffness; see `layered_table`."""
    return Tables(lambda poisson_ratio: layered_table(poisson_ratio, contrast))


def _continued(moved: Tensor, k: Tensor, nu: Tensor) -> tuple[Tensor, Tensor]:
    """Displacement and its slope [depth, k, 2] at depths `BELOW` in a half-space, given [k, 2] at its top."""
    w, v = moved.unbind(-1)
    s = k * (BELOW[:, None] - 1)
    fall = torch.exp(-s)
    shear, gradient = (w - v) / (3 - 4 * nu), ((1 - 2 * nu) * w + 2 * (1 - nu) * v) / (3 - 4 * nu)
    vertical = (shear * (2 * (1 - nu) + s) + gradient) * fall
    radial = (shear * (s - (1 - 2 * nu)) + gradient) * fall
    growth = k * shear * fall
    slope = torch.stack([growth - k * vertical, growth - k * radial], -1)
    return torch.stack([vertical, radial], -1), slope
