"""Ground whose stiffness grows with depth (Gibson soil)."""

import math

import torch
from torch import Tensor

from solver.ground.boussinesq import Ratio
from solver.ground.correction import Corrected, Tables
from solver.ground.images import images
from solver.ground.layer_stack import Stack
from solver.ground.layered import boussinesq_traction, scalar
from solver.ground.response_table import Cells, RadialTable

#: Unit of length of the table, m: no more than the least depth of a fiber.
LENGTH = 0.25
#: Edges of the layers that stand for the gradient, over LENGTH, evenly in ln(z + 0.3 m): to 60 m, constant below.
EDGES = 1.2 * torch.expm1(torch.linspace(0, 1, 76, dtype=torch.float64) * math.log1p(60 / 0.3))
#: Of these, the layers in which a fiber may lie: to 12 m.
TABULATED = 53


def gibson_displacement(offset: Tensor, poisson_ratio: Ratio, gradient: Ratio) -> Tensor:
    """Displacement under a vertical point load on ground with G(z) = G_0 (1 + gradient z), per unit F / (4 pi G_0).

    Parameters
    ----------
    offset : [..., 3], ground point minus load point (x, y, z down), m
    poisson_ratio : scalar or [...], to .49
    gradient : scalar, 0 to 3 per m; 0 is Boussinesq

    Returns
    -------
    [..., 3], 1/m

    References
    ----------
    Gibson 1967, Geotechnique 17 (1).

    >>> point = torch.tensor([3.0, 1.0, 0.9], dtype=torch.float64)
    >>> gibson_displacement(point, 0.25, 1.0)
    tensor([-0.0052, -0.0017,  0.0578], dtype=torch.float64)
    """
    return stiffening(gradient).displacement(offset, poisson_ratio)


def gibson_displacement_rate(offset: Tensor, velocity: Tensor, poisson_ratio: Ratio, gradient: Ratio) -> Tensor:
    """Time derivative of `gibson_displacement` at a fixed ground point while the load moves.

    Parameters
    ----------
    offset, poisson_ratio, gradient : see `gibson_displacement`
    velocity : [..., 2], horizontal velocity of the load, m/s

    Returns
    -------
    [..., 3], 1/(m s), per F / (4 pi G_0)

    >>> point, velocity = torch.tensor([3.0, 1.0, 0.9]), torch.tensor([10.0, 0.0])
    >>> gibson_displacement_rate(point, velocity, 0.25, 0.0)  # Boussinesq
    tensor([0.2027, 0.0309, 1.4559])
    """
    return stiffening(gradient).rate(offset, velocity, poisson_ratio)


def stiffening(gradient: Ratio) -> Corrected:
    """Ground that stiffens by `gradient`, 1/m; its tables are built once."""
    return Corrected(Tables(lambda poisson_ratio: gibson_table(poisson_ratio, scalar(gradient))), LENGTH)


def gibson_table(poisson_ratio: Tensor, gradient: Tensor) -> RadialTable:
    """Tabulate how the gradient changes Boussinesq's displacement, per unit F / (4 pi G_0) and LENGTH.

    Parameters
    ----------
    poisson_ratio : scalar
    gradient : scalar, 1/m

    Notes
    -----
    Thin layers approximate the gradient, each with the geometric mean of the moduli at its faces; the table is built at
    their interfaces, with the mean of the slopes above and below. As in `layered_table`, jumps of modulus act on
    Boussinesq's tractions.
    """
    hankel = images(0.1, 2e4, 54, 4e3, 0.125)
    k, bottoms = hankel.wavenumber, EDGES[1:]
    modulus = 1 + gradient * LENGTH * torch.cat([EDGES, bottoms[-1:]])
    modulus = (modulus[:-1] * modulus[1:]).sqrt()
    jump = torch.diff(modulus, prepend=torch.ones_like(modulus[:1]))
    force = -jump[:, None, None] * boussinesq_traction(EDGES[:, None] * k)
    stack = Stack(k, bottoms, modulus, poisson_ratio)
    moved = stack.displacement(force)
    top, bottom = (slope[:TABULATED] for slope in stack.slope(moved))
    smooth = (top[1:] + bottom[:-1]) / 2
    cells = Cells(
        EDGES[: TABULATED + 1],
        moved[:TABULATED],
        moved[1 : TABULATED + 1],
        torch.cat([top[:1], smooth]),
        torch.cat([smooth, bottom[-1:]]),
    )
    return RadialTable.of(cells, hankel)
