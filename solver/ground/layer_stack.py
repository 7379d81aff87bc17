"""Static stiffness of elastic layers on a half-space, wavenumber by wavenumber.

A vertical load makes u_z = F / (4 pi G) int W(k, z) J0(k r) dk and u_r = F / (4 pi G) int V(k, z) J1(k r) dk. On a
horizontal plane the traction is (S, T) = (sigma_zz, sigma_rz) likewise; forces here are in units of 2 k G, G the
modulus that contrasts refer to. Stiffness matrices (Kausel & Roesset 1981, here in their static limit) stay bounded
for any k times thickness, unlike propagators of the layer state.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from solver.ground.boussinesq import Ratio


def half_space_stiffness(poisson_ratio: Ratio, like: Tensor) -> Tensor:
    """Force by displacement at the top of a half-space, per 2 k G -> [..., 2, 2].

    Parameters
    ----------
    poisson_ratio : scalar or [...]
    like : [...], wavenumbers; gives shape and type

    >>> half_space_stiffness(0.5, torch.ones(1, dtype=torch.float64))
    tensor([[[1., 0.],
             [0., 1.]]], dtype=torch.float64)
    """
    nu = poisson_ratio + torch.zeros_like(like)
    diagonal, across = 2 * (1 - nu) / (3 - 4 * nu), (1 - 2 * nu) / (3 - 4 * nu)
    return _matrix(diagonal, across, across, diagonal)


def layer_stiffness(thickness: Tensor, poisson_ratio: Ratio) -> tuple[Tensor, Tensor, Tensor]:
    """Forces by displacements at the faces of a layer, per 2 k G.

    Parameters
    ----------
    thickness : [...], wavenumber times thickness
    poisson_ratio : scalar or [...]

    Returns
    -------
    top, across, bottom : [..., 2, 2]; force at the top by displacement at the top, force at the top by displacement at
        the bottom (its transpose is the reverse), force at the bottom by displacement at the bottom

    Notes
    -----
    Motions symmetric about the middle plane and antisymmetric ones part, with s = k h / 2, t = tanh s, c = sech^2 s:
    K_s = [[2 (1 - nu), s c - (1 - 2 nu) t], [., 2 (1 - nu) t^2]] / ((3 - 4 nu) t - s c),
    K_a = [[2 (1 - nu) t^2, -s c - (1 - 2 nu) t], [., 2 (1 - nu)]] / ((3 - 4 nu) t + s c).

    >>> top, across, bottom = layer_stiffness(torch.tensor(50.0, dtype=torch.float64), 0.3)
    >>> bool(torch.allclose(top, half_space_stiffness(0.3, torch.tensor(1.0, dtype=torch.float64))))
    True
    """
    s = thickness / 2
    t = torch.tanh(s)
    fall = torch.exp(-2 * s)
    sc = s * 4 * fall / (1 + fall) ** 2
    stretch, soft, eta = 2 * (1 - poisson_ratio), (1 - 2 * poisson_ratio) * t, (3 - 4 * poisson_ratio) * t
    even, odd = 0.5 / (eta - sc), 0.5 / (eta + sc)
    s11, s12, s22 = stretch * even, (sc - soft) * even, stretch * t * t * even
    a11, a12, a22 = stretch * t * t * odd, (-sc - soft) * odd, stretch * odd
    across = _matrix(a11 - s11, s12 - a12, a12 - s12, s22 - a22)
    off = s12 + a12
    return _matrix(s11 + a11, -off, -off, s22 + a22), across.mT, _matrix(s11 + a11, off, off, s22 + a22)


@dataclass(frozen=True)
class Stack:
    """Layers on a half-space, at some wavenumbers.

    Parameters
    ----------
    wavenumber : [k], 1/m
    depth : [layer], of the bottom of each layer, ascending, m
    modulus : [layer + 1], shear modulus of each layer and of the half-space, over the modulus of reference
    poisson_ratio : [layer + 1] or scalar
    """

    wavenumber: Tensor
    depth: Tensor
    modulus: Tensor
    poisson_ratio: Ratio

    def displacement(self, force: Tensor) -> Tensor:
        """Displacement (W, V) of the surface and of every interface.

        Parameters
        ----------
        force : [layer + 1, k, 2], at the surface and every interface, per 2 k G

        Returns
        -------
        [layer + 1, k, 2]
        """
        top, across, bottom = self._layers()
        below, reduced = self._half_space() + bottom[-1], [force[-1, ..., None]]
        inverses = [_inverse(below)]
        for i in range(len(top) - 1, -1, -1):
            carried = across[i] @ inverses[-1]
            above = top[i] + (bottom[i - 1] if i else 0)
            reduced.append(force[i, ..., None] - carried @ reduced[-1])
            inverses.append(_inverse(above - carried @ across[i].mT))
        moved = [inverses.pop() @ reduced.pop()]
        for i in range(len(top)):
            moved.append(inverses.pop() @ (reduced.pop() - across[i].mT @ moved[-1]))
        return torch.stack(moved)[..., 0]

    def slope(self, displacement: Tensor) -> tuple[Tensor, Tensor]:
        """Derivative by depth of the displacement at the top and at the bottom of every layer.

        Parameters
        ----------
        displacement : [layer + 1, k, 2]

        Returns
        -------
        top, bottom : [layer, k, 2], 1/m
        """
        top, across, bottom = layer_stiffness(self._thickness(), self._ratio(self.depth))
        above, below = displacement[:-1, ..., None], displacement[1:, ..., None]
        at_top = -(top @ above + across @ below)[..., 0]
        at_bottom = (across.mT @ above + bottom @ below)[..., 0]
        return self._strained(displacement[:-1], at_top), self._strained(displacement[1:], at_bottom)

    def _strained(self, displacement: Tensor, traction: Tensor) -> Tensor:
        nu, k = self._ratio(self.depth), self.wavenumber
        w, v = displacement.unbind(-1)
        s, t = traction.unbind(-1)
        return torch.stack([k * ((1 - 2 * nu) * s - nu * v) / (1 - nu), k * (2 * t + w)], -1)

    def _thickness(self) -> Tensor:
        return torch.diff(self.depth, prepend=self.depth.new_zeros(1))[:, None] * self.wavenumber

    def _ratio(self, layers: Tensor) -> Ratio:
        nu = self.poisson_ratio
        return nu[: len(layers), None] if isinstance(nu, Tensor) and nu.ndim else nu

    def _layers(self) -> list[Tensor]:
        modulus = self.modulus[:-1, None, None, None]
        return [modulus * k for k in layer_stiffness(self._thickness(), self._ratio(self.depth))]

    def _half_space(self) -> Tensor:
        nu = self.poisson_ratio
        last = nu[-1] if isinstance(nu, Tensor) and nu.ndim else nu
        return self.modulus[-1] * half_space_stiffness(last, self.wavenumber)


def _matrix(a: Tensor, b: Tensor, c: Tensor, d: Tensor) -> Tensor:
    return torch.stack([torch.stack([a, b], -1), torch.stack([c, d], -1)], -2)


def _inverse(matrix: Tensor) -> Tensor:
    a, b, c, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]
    return _matrix(d, -b, -c, a) / (a * d - b * c)[..., None, None]
