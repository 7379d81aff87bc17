"""The ground stage against closed forms and numbers."""

import numpy as np
import pytest
import torch

from solver.ground.boussinesq import displacement, displacement_rate

NU = torch.tensor(0.25, dtype=torch.float64)


def offsets(count: int = 200, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(np.column_stack([rng.uniform(-30, 30, (count, 2)), rng.uniform(0.3, 3, count)]))


@pytest.mark.parametrize("nu", [0.0, 0.25, 0.49])
def test_displacement_is_boussinesq_as_written_in_the_design(nu: float) -> None:
    x, y, z = offsets().numpy().T
    r = np.sqrt(x**2 + y**2 + z**2)
    radial = 1 / r**2 * (z / r - (1 - 2 * nu) / (1 + z / r))
    expected = np.column_stack([x * radial, y * radial, (z**2 / r**2 + 2 * (1 - nu)) / r])
    np.testing.assert_allclose(displacement(offsets(), nu).numpy(), expected, rtol=1e-12)


def test_displacement_under_the_load_axis_and_at_the_surface() -> None:
    below = displacement(torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64), NU)
    np.testing.assert_allclose(below, [0, 0, (3 - 2 * 0.25) / 2])
    surface = displacement(torch.tensor([3.0, 0.0, 0.0], dtype=torch.float64), NU)
    np.testing.assert_allclose(surface, [-(1 - 2 * 0.25) / 3, 0, 2 * 0.75 / 3])


def test_stress_free_surface_and_equilibrium() -> None:
    """(1 - 2 nu) lap(u) + grad(div(u)) = 0 inside the ground (Navier), by automatic differentiation."""
    point = torch.tensor([1.7, -0.8, 1.1], dtype=torch.float64)

    def hessian_of(component: int) -> torch.Tensor:
        return torch.autograd.functional.hessian(lambda p: displacement(p, NU)[component], point)

    second = torch.stack([hessian_of(i) for i in range(3)])
    laplacian = second.diagonal(dim1=1, dim2=2).sum(-1)
    gradient_of_divergence = torch.einsum("iij->j", second)
    np.testing.assert_allclose((1 - 2 * NU) * laplacian + gradient_of_divergence, 0, atol=1e-12)


@pytest.mark.parametrize("nu", [0.1, 0.25, 0.45])
def test_rate_is_the_time_derivative(nu: float) -> None:
    velocity = torch.tensor([13.0, -2.0], dtype=torch.float64)
    towards = torch.nn.functional.pad(velocity, (0, 1))
    offset = offsets()
    _, derivative = torch.autograd.functional.jvp(lambda o: displacement(o, nu), offset, -towards.expand_as(offset))
    torch.testing.assert_close(displacement_rate(offset, velocity, nu), derivative, rtol=1e-10, atol=1e-14)
