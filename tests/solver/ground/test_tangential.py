"""Cerruti's load against equilibrium, reciprocity, its textbook form, and Boussinesq."""

import numpy as np
import pytest
import torch

from solver.ground.boussinesq import displacement
from solver.ground.tangential import tangential_displacement, tangential_displacement_rate

NU = 0.3


def offsets(count: int = 100) -> torch.Tensor:
    rng = np.random.default_rng(1)
    return torch.from_numpy(np.column_stack([rng.uniform(-20, 20, (count, 2)), rng.uniform(0.3, 3, count)]))


def unit(angle: float) -> torch.Tensor:
    return torch.tensor([np.cos(angle), np.sin(angle)], dtype=torch.float64)


@pytest.mark.parametrize("nu", [0.0, 0.25, 0.5])
def test_textbook_form_along_x(nu: float) -> None:
    """Johnson 1985, eq. 3.75, written out for a force along x."""
    x, y, z = offsets().numpy().T
    r, k = np.sqrt(x**2 + y**2 + z**2), 1 - 2 * nu
    expected = [
        1 / r + x**2 / r**3 + k * (1 / (r + z) - x**2 / (r * (r + z) ** 2)),
        x * y / r**3 - k * x * y / (r * (r + z) ** 2),
        x * z / r**3 + k * x / (r * (r + z)),
    ]
    found = tangential_displacement(offsets(), nu, unit(0.0))
    np.testing.assert_allclose(found.numpy(), np.column_stack(expected), rtol=1e-12)


def test_navier_equilibrium() -> None:
    point = torch.tensor([1.7, -0.8, 1.1], dtype=torch.float64)
    second = torch.stack(
        [
            torch.autograd.functional.hessian(lambda p, i=i: tangential_displacement(p, NU, unit(0.7))[i], point)
            for i in range(3)
        ]
    )
    navier = (1 - 2 * NU) * second.diagonal(dim1=1, dim2=2).sum(-1) + torch.einsum("iij->j", second)
    np.testing.assert_allclose(navier, 0, atol=1e-12)


def test_surface_reciprocity_with_boussinesq() -> None:
    """Betti: what a horizontal load does vertically, the vertical load does horizontally, seen from the other end."""
    surface = offsets() * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    horizontally = displacement(-surface, NU)[:, :2] @ unit(0.4)
    torch.testing.assert_close(tangential_displacement(surface, NU, unit(0.4))[:, 2], horizontally)


@pytest.mark.parametrize("nu", [0.1, 0.45])
def test_rate_is_the_time_derivative(nu: float) -> None:
    velocity, direction = torch.tensor([13.0, -2.0], dtype=torch.float64), unit(2.0)
    towards = torch.nn.functional.pad(velocity, (0, 1)).expand_as(offsets())
    _, expected = torch.autograd.functional.jvp(
        lambda o: tangential_displacement(o, nu, direction), offsets(), -towards
    )
    found = tangential_displacement_rate(offsets(), velocity, nu, direction)
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-14)


def test_linear_in_direction() -> None:
    velocity = torch.tensor([9.0, 4.0], dtype=torch.float64)
    parts = [tangential_displacement_rate(offsets(), velocity, NU, unit(a)) for a in (0.0, np.pi / 2)]
    whole = tangential_displacement_rate(offsets(), velocity, NU, torch.tensor([0.3, -1.2], dtype=torch.float64))
    torch.testing.assert_close(whole, 0.3 * parts[0] - 1.2 * parts[1], rtol=1e-10, atol=1e-14)
