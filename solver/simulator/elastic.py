"""Strain of a homogeneous elastic half-space under a point load, and its average along a curve.

Derived from the strain tensor in cylindrical coordinates, to share nothing with the solver's signal path, which
differences displacements.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def extension(offset: Sequence[Array], tangent: Array, poisson_ratio: float | Array) -> Array:
    """Extension `t . (grad u) . t` along `tangent` under a unit vertical load, F / (4 pi G) = 1 m^2.

    Parameters
    ----------
    offset : [3, ...], m; from the load, on the surface, to the point; z down and positive
    tangent : [3, ...]; unit vectors, broadcast against `offset`
    poisson_ratio : of the ground; an array is broadcast against `offset`

    Returns
    -------
    [...], positive where the fiber is stretched.

    Notes
    -----
    Boussinesq's strains (Poulos & Davis 1974, section 2.1), with rho the horizontal distance, R = |offset|,
    k = 1 - 2 nu:

    - hoop  u_r/rho              =  z/R^3 - k / (R (R + z))
    - (radial - hoop) / rho^2    = -3 z/R^5 + k (2R + z) / (R^3 (R + z)^2)
    - vertical  du_z/dz          =  2 nu z/R^3 - 3 z^3/R^5
    - shear  du_r/dz + du_z/drho = -6 rho z^2/R^5

    The second is finite under the load, where radial and hoop strain are the same.

    >>> import numpy as np
    >>> below = extension(np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0]), 0.25)
    >>> round(float(below), 3)  # (2 nu - 3) / z^2
    -0.625
    """
    x, y, z = offset
    along, steep = x * tangent[0] + y * tangent[1], tangent[2]
    k = 1.0 - 2.0 * poisson_ratio
    R = np.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / R
    square = inverse * inverse
    cube = square * inverse
    dipole = 3.0 * z * cube * square
    reach = 1.0 / (R + z)
    hoop = z * cube - k * inverse * reach
    ovality = k * (R + R + z) * cube * (reach * reach) - dipole
    vertical = 2.0 * poisson_ratio * z * cube - dipole * z * z
    shear = -2.0 * dipole * z
    return ovality * along * along + hoop * (1.0 - steep**2) + vertical * steep**2 + shear * along * steep


def tangential_extension(
    offset: Sequence[Array], tangent: Array, force: tuple[Array, Array], poisson_ratio: float | Array
) -> Array:
    """Extension along `tangent` under a horizontal load on the surface, divided by 1 / (4 pi G).

    Cerruti's displacements (Poulos & Davis 1974, section 2.2) at two points a millimeter up and down the fiber,
    differenced.

    Parameters
    ----------
    offset, tangent, poisson_ratio : as for `extension`
    force : its components along x and y, N, broadcast against `offset`

    >>> import numpy as np
    >>> ahead, along = np.array([2.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    >>> bool(tangential_extension(ahead, along, (np.array(1.0), np.array(0.0)), 0.25) < 0)  # pushed together
    True
    """
    ends = []
    for step in (-1e-3, 1e-3):
        point = [o + step * t for o, t in zip(offset, tangent, strict=True)]
        ends.append(
            force[0] * _cerruti(point[0], point[1], point[2], tangent, poisson_ratio)
            + force[1] * _cerruti(point[1], -point[0], point[2], (tangent[1], -tangent[0], tangent[2]), poisson_ratio)
        )
    return (ends[1] - ends[0]) / 2e-3


def _cerruti(x: Array, y: Array, z: Array, tangent: Sequence[Array] | Array, nu: float | Array) -> Array:
    """Displacement along `tangent` under a unit load along the first axis; any right- or left-handed x, y."""
    R = np.sqrt(x * x + y * y + z * z)
    k, reach = 1.0 - 2.0 * nu, 1.0 / (R + z)
    ux = (1.0 + x * x / R**2 + k * (R * reach - (x * reach) ** 2)) / R
    uy = x * y / R**3 * (1.0 - k * (R * reach) ** 2)
    uz = x / R**2 * (z / R + k * R * reach)
    return ux * tangent[0] + uy * tangent[1] + uz * tangent[2]


def gauge_nodes(first: float, last: float, panel: float, order: int = 4) -> Array:
    """Gauss-Legendre nodes of every panel between `first` and `last`, m along the fiber -> [panel * order].

    >>> gauge_nodes(0.0, 2.0, 1.0, order=1)
    array([0.5, 1.5])
    """
    edges = _edges(first, last, panel)
    abscissa, _ = np.polynomial.legendre.leggauss(order)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1.0 + abscissa)).ravel()


def gauge_weights(center: Array, gauge_length: float, first: float, last: float, panel: float, order: int = 4) -> Array:
    """Weights [channel, node] that average a function sampled at `gauge_nodes` over each channel's gauge.

    Between the nodes of one panel the function is their interpolating polynomial; a gauge that ends inside a
    panel integrates that polynomial up to its end, so every gauge length is exact to one degree.

    Parameters
    ----------
    center : [channel], m along the fiber; middle of each gauge
    gauge_length : m
    first, last, panel, order : as given to `gauge_nodes`

    >>> import numpy as np
    >>> nodes = gauge_nodes(0.0, 20.0, 1.0)
    >>> weights = gauge_weights(np.array([8.3]), 10.0, 0.0, 20.0, 1.0)
    >>> bool(np.isclose(weights @ nodes, 8.3)[0])
    True
    """
    edges = _edges(first, last, panel)
    abscissa, quadrature = np.polynomial.legendre.leggauss(order)
    to_coefficients = np.linalg.inv(np.polynomial.legendre.legvander(abscissa, order - 1))
    low = np.clip(center[:, None] - gauge_length / 2, edges[:-1], edges[1:])
    high = np.clip(center[:, None] + gauge_length / 2, edges[:-1], edges[1:])
    middle, half = (low + high)[..., None] / 2, (high - low)[..., None] / 2
    # Places in the panel, -1..1, of quadrature points over its covered part: [channel, panel, order].
    inside = 2.0 * (middle + half * abscissa - edges[:-1, None]) / np.diff(edges)[:, None] - 1.0
    basis = np.polynomial.legendre.legvander(inside, order - 1) @ to_coefficients
    weights = np.einsum("cpq,cpqn->cpn", half * quadrature, basis)
    return weights.reshape(len(center), -1) / gauge_length


def _edges(first: float, last: float, panel: float) -> Array:
    return np.linspace(first, last, max(1, round((last - first) / panel)) + 1)
