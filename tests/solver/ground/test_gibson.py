"""Ground that stiffens with depth: limits, derivatives, and one-dimensional finite elements over depth."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from torch import Tensor
from torch.autograd import forward_ad

from solver.ground.boussinesq import displacement_rate
from solver.ground.gibson import EDGES, LENGTH, gibson_displacement, gibson_displacement_rate
from solver.ground.layer_stack import Stack

VELOCITY = torch.tensor([12.0, -3.0], dtype=torch.float64)
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.script:DeprecationWarning")


def offsets(count: int = 120) -> Tensor:
    rng = np.random.default_rng(0)
    return torch.from_numpy(np.column_stack([rng.uniform(-30, 30, (count, 2)), rng.uniform(0.3, 3, count)]))


def surface_by_finite_elements(k: float, gradient: float, nu: float) -> NDArray[np.float64]:
    """W, V at the surface, per 2 k G_0, from the elastic energy with linear elements of varying modulus."""
    z = np.concatenate([[0.0], np.geomspace(1e-4, 25 / k, 6000)])
    band = np.zeros((7, 2 * len(z)))
    for place in (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)):
        size = np.diff(z)
        modulus = 1 + gradient * (z[:-1] + place * size)
        zero, share, slope = np.zeros_like(size), (1 - place, place), (-1 / size, 1 / size)
        # Strains kV, W', V' - kW by W and V of the upper and the lower node: [4, 3, element].
        strain = []
        for a, da in zip(share, slope, strict=True):
            strain += [[zero, da, zero - k * a], [zero + k * a, zero, da]]
        bulk = 2 * nu / (1 - 2 * nu)
        law = np.array([[2 + bulk, bulk, 0], [bulk, 2 + bulk, 0], [0, 0, 1]])
        stiffness = np.einsum("aie,ij,bje->abe", strain, law, strain) * modulus * size / 2
        for a in range(4):
            for b in range(4):
                first = 2 * np.arange(len(size))
                np.add.at(band, (3 + a - b, first + b), stiffness[a, b])
    load = np.zeros(2 * len(z))
    load[0] = 2 * k
    # Far below nothing moves.
    band[3, -2:] = 1e12
    return np.asarray(solve_banded((3, 3), band, load)[:2])


def test_no_gradient_is_boussinesq_exactly() -> None:
    assert torch.equal(
        gibson_displacement_rate(offsets(), VELOCITY, 0.3, 0.0), displacement_rate(offsets(), VELOCITY, 0.3)
    )


@pytest.mark.parametrize("gradient", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("k", [0.3, 1.0, 5.0])
def test_layers_stand_for_the_gradient(k: float, gradient: float) -> None:
    edges = (EDGES * LENGTH).to(torch.float64)
    modulus = 1 + gradient * torch.cat([edges, edges[-1:]])
    modulus = (modulus[:-1] * modulus[1:]).sqrt()
    wavenumber = torch.tensor([k], dtype=torch.float64)
    force = torch.zeros(len(edges), 1, 2, dtype=torch.float64)
    force[0, 0, 0] = 1
    found = Stack(wavenumber, edges[1:], modulus, 0.3).displacement(force)[0, 0]
    np.testing.assert_allclose(found, surface_by_finite_elements(k, gradient, 0.3), rtol=3e-3)


def test_stiffer_below_narrows_the_response() -> None:
    far = torch.tensor([[15.0, 0.0, 1.0]], dtype=torch.float64)
    uniform, stiffening = (gibson_displacement(far, 0.25, g)[0, 2] for g in (0.0, 1.0))
    assert 0 < stiffening < 0.35 * uniform


def test_rate_is_the_time_derivative_of_the_displacement() -> None:
    offset = offsets()
    towards = torch.nn.functional.pad(VELOCITY, (0, 1)).expand_as(offset)
    _, expected = torch.autograd.functional.jvp(lambda o: gibson_displacement(o, 0.3, 0.7), offset, -towards)
    found = gibson_displacement_rate(offset, VELOCITY, 0.3, 0.7)
    torch.testing.assert_close(found, expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("gradient", [0.0, 0.8, 3.0])
def test_derivative_by_gradient(gradient: float) -> None:
    value, step = torch.tensor(gradient, dtype=torch.float64), 1e-6

    def rate(g: Tensor) -> Tensor:
        return gibson_displacement_rate(offsets(20), VELOCITY, 0.3, g)

    numeric = (rate(value + step) - rate(value - step)) / (2 * step)
    with forward_ad.dual_level():
        forward = forward_ad.unpack_dual(rate(forward_ad.make_dual(value, torch.ones_like(value)))).tangent
    torch.testing.assert_close(forward, numeric, rtol=1e-4, atol=1e-5)
    leaf = value.clone().requires_grad_()
    (backward,) = torch.autograd.grad(rate(leaf)[:, 0].sum(), leaf)
    torch.testing.assert_close(backward, forward[:, 0].sum(), rtol=1e-8, atol=1e-10)
    assert forward.abs().max() > 1e-3
