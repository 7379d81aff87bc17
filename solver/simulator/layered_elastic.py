"""Extension under a load on layered ground: solve the layers per wavenumber, then sum the Hankel integrals.

Every layer has two decaying and two growing solutions of Navier's equations, each scaled from the face at which it
decays; tractions and displacements are continuous at the faces (all unknowns in one linear system, so nothing
overflows).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.simulator.scenario import Scenario

Array = NDArray[np.float64]
PANEL = 0.1  # 1/m of wavenumber per 16 Gauss-Legendre nodes: enough for distances up to 200 m
DECAY = 22.0  # wavenumber times depth at which the integrals end
FARTHEST = 260.0  # m
STEPS = 700  # distances in a table, even in log(1 + r / half a meter)


class Layers(NamedTuple):
    """Ground from the surface down; the last layer has no lower face.

    Attributes
    ----------
    face : [layer - 1] m; depth of each lower face
    modulus : [layer] shear modulus, relative
    poisson_ratio : of all
    """

    face: Array
    modulus: Array
    poisson_ratio: float


def layers_of(scenario: Scenario) -> Layers | None:
    """Layers of a scenario, None if its ground is uniform; moduli relative to that 1 m below the road."""
    thickness, ratio = scenario.effect("pavement"), scenario.effect("layered_ground")
    growth = scenario.effect("gibson_soil")
    if not (thickness or ratio or growth):
        return None
    face = np.geomspace(0.1, 30.0, 36) if growth else np.empty(0)
    if ratio:
        face = np.union1d(face, scenario.effect("layered_ground_depth"))
    face = face + thickness
    top = np.append(thickness, face)
    bottom = np.append(face, top[-1])
    middle = (top + bottom) / 2 - thickness
    modulus = (1 + growth * middle) / (1 + growth)
    if ratio:
        modulus = modulus * np.where(middle + 1e-9 < scenario.effect("layered_ground_depth"), 1.0, np.exp(ratio))
    if thickness:
        face, modulus = np.append(thickness, face), np.append(scenario.effect("pavement_ratio"), modulus)
    return Layers(face, modulus, scenario.poisson_ratio + scenario.effect("poisson_ratio"))


def _solutions(k: Array, zeta: Array, modulus: float, nu: float, sign: float) -> Array:
    """The two solutions that decay with zeta = k * distance from a face: [k, (U, W, sigma / 2k, tau / 2k), 2].

    U and W belong to J1 and J0; `sign` is +1 if they decay downwards, -1 upwards.
    """
    one = np.ones_like(k)
    a = np.stack([one, sign * one, -modulus * one, -sign * modulus * one], axis=1)
    b = np.stack(
        [
            zeta,
            sign * (3 - 4 * nu + zeta),
            -modulus * (2 - 2 * nu + zeta),
            -sign * modulus * (1 - 2 * nu + zeta),
        ],
        axis=1,
    )
    return np.stack([a, b], axis=2) * np.exp(-zeta)[:, None, None]


def solve(layers: Layers, k: Array) -> Array:
    """Amplitudes of the solutions [k, 4 layer - 2] for wavenumbers `k` [k], 1/m, under a unit load.

    Times k, in units where the modulus 1 is 1 / (4 pi).
    """
    count, nu = len(layers.modulus), layers.poisson_ratio
    size = 4 * count - 2
    matrix, right = np.zeros((len(k), size, size)), np.zeros((len(k), size, 1))
    top = np.append(0.0, layers.face)

    def fill(rows: slice, layer: int, z: float, factor: float, parts: slice) -> None:
        down = _solutions(k, k * (z - top[layer]), layers.modulus[layer], nu, 1.0)
        matrix[:, rows, 4 * layer : 4 * layer + 2] = factor * down[:, parts]
        if layer < count - 1:
            up = _solutions(k, k * (layers.face[layer] - z), layers.modulus[layer], nu, -1.0)
            matrix[:, rows, 4 * layer + 2 : 4 * layer + 4] = factor * up[:, parts]

    fill(slice(0, 2), 0, 0.0, 1.0, slice(2, 4))
    right[:, 0] = -1.0  # sigma = -1 / (2 pi), and 4 pi times it, / 2
    for layer, z in enumerate(layers.face):
        rows = slice(2 + 4 * layer, 6 + 4 * layer)
        fill(rows, layer, float(z), 1.0, slice(0, 4))
        fill(rows, layer + 1, float(z), -1.0, slice(0, 4))
    return np.asarray(np.linalg.solve(matrix, right)[:, :, 0])


def state(layers: Layers, k: Array, weight: Array, depth: float) -> Array:
    """(U, W, sigma / 2k, tau / 2k) [k, 4] at `depth`, m, from what `solve` found."""
    count, nu = len(layers.modulus), layers.poisson_ratio
    top = np.append(0.0, layers.face)
    layer = int(np.searchsorted(layers.face, depth, side="right"))
    here = _solutions(k, k * (depth - top[layer]), layers.modulus[layer], nu, 1.0)
    out = np.einsum("kij,kj->ki", here, weight[:, 4 * layer : 4 * layer + 2])
    if layer < count - 1:
        here = _solutions(k, k * (layers.face[layer] - depth), layers.modulus[layer], nu, -1.0)
        out = out + np.einsum("kij,kj->ki", here, weight[:, 4 * layer + 2 : 4 * layer + 4])
    return np.asarray(out)


def strains(layers: Layers, distance: Array, depths: Array) -> Array:
    """Hoop, (radial - hoop) / r^2, vertical and shear / r [4, depth, distance], times 4 pi G, 1/m^2, under 1 N.

    Parameters
    ----------
    layers : with modulus 1 where the 4 pi G of the result is meant
    distance, depths : m; distances above 0
    """
    from scipy.interpolate import CubicSpline
    from scipy.special import j0, j1

    coarse = np.concatenate([[0.0], np.geomspace(1e-4, DECAY / depths.min(), 400)])
    nodes, weights = np.polynomial.legendre.leggauss(16)
    panels = np.arange(0.0, coarse[-1], PANEL)
    k = (panels[:, None] + PANEL / 2 * (1 + nodes)).ravel()
    measure = np.resize(weights, len(k)) * PANEL / 2
    r = distance[:, None]
    level, steep = j0(k * r), j1(k * r) / r
    # J2 = 2 J1 / x - J0, whose difference is lost in rounding where x is small: x^2 / 8 there.
    second = np.where(k * r > 1e-2, 2 * steep / k - level, (k * r) ** 2 / 8)
    bessel = (steep, -second * k / r**2, level, steep)
    nu, weight = layers.poisson_ratio, solve(layers, coarse)
    amount = np.empty((4, len(k), len(depths)))
    for column, depth in enumerate(depths):
        # Without its decay the integrand is smooth in k, so a spline carries it to the nodes.
        smooth = CubicSpline(coarse, state(layers, coarse, weight, float(depth)) * np.exp(coarse * depth)[:, None])
        U, _, sigma, tau = smooth(np.minimum(k, coarse[-1])).T * np.exp(-k * depth) * measure
        modulus = layers.modulus[int(np.searchsorted(layers.face, depth, side="right"))]
        # W' from sigma = lambda (k U + W') + 2 mu W', with lambda = 2 mu nu / (1 - 2 nu).
        vertical = ((1 - 2 * nu) * sigma / modulus - nu * U) / (1 - nu) * k
        amount[:, :, column] = U, U, vertical, 2 * k * tau / modulus
    return np.stack([(kernel @ part).T for kernel, part in zip(bessel, amount, strict=True)])


class Table:
    """Extension under a unit load, times 4 pi G, looked up for the nodes of a fiber.

    Parameters
    ----------
    layers : of the ground
    depth : [node] m
    tangents : [3, node]
    """

    def __init__(self, layers: Layers, depth: Array, tangents: Array):
        self.step = np.log1p(FARTHEST / 0.5) / (STEPS - 1)
        distance = 0.5 * np.expm1(self.step * np.arange(STEPS))
        distance[0] = 1e-3
        levels = np.linspace(depth.min() - 1e-3, depth.max() + 1e-3, max(2, int(np.ptp(depth) / 0.04) + 2))
        table = strains(layers, distance, levels)
        place = (depth - levels[0]) / (levels[1] - levels[0])
        low = place.astype(int)
        share = (place - low)[:, None]
        hoop, oval, vertical, shear = (1 - share) * table[:, low] + share * table[:, low + 1]
        steep = tangents[2][:, None]
        self.tangents = tangents
        self.level = hoop * (1 - steep**2) + vertical * steep**2
        self.along, self.across = oval, shear * steep
        self.row = STEPS * np.arange(len(depth))

    def extension(self, x: Array, y: Array) -> Array:
        """[..., node] at horizontal offsets x, y [..., node], m, from the load."""
        r = np.sqrt(x * x + y * y)
        place = np.minimum(np.log1p(r / 0.5) / self.step, STEPS - 1.001)
        low = place.astype(np.int64)
        share = place - low
        low += self.row
        ahead = x * self.tangents[0] + y * self.tangents[1]
        found = [
            part.take(low) * (1 - share) + part.take(low + 1) * share for part in (self.level, self.along, self.across)
        ]
        return np.asarray(found[0] + ahead * (ahead * found[1] + found[2]))
