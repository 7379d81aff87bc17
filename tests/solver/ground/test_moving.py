"""Inertia of the ground against the whole integral over directions."""

import numpy as np
import pytest
import torch
from moving_by_quadrature import rate as rate_by_quadrature
from torch import Tensor
from torch.autograd import forward_ad

from solver.ground.boussinesq import displacement_rate
from solver.ground.moving import moving_displacement_rate

VELOCITY = torch.tensor([14.0, -5.0], dtype=torch.float64)
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.script:DeprecationWarning")


def offsets(count: int = 60) -> Tensor:
    rng = np.random.default_rng(0)
    return torch.from_numpy(np.column_stack([rng.uniform(-9, 9, (count, 2)), rng.uniform(0.3, 3, count)]))


def slowness(mach: float) -> float:
    return (mach / float(VELOCITY.norm())) ** 2


def test_no_inertia_is_boussinesq_exactly() -> None:
    expected = displacement_rate(offsets(), VELOCITY, 0.3)
    assert torch.equal(moving_displacement_rate(offsets(), VELOCITY, 0.3, 0.0), expected)
    assert torch.equal(moving_displacement_rate(offsets(), 0 * VELOCITY, 0.3, 1e-4), 0 * expected)


@pytest.mark.parametrize("nu", [0.15, 0.3, 0.45])
@pytest.mark.parametrize(("mach", "tolerance"), [(0.02, 1e-6), (0.1, 1e-5), (0.2, 3e-4), (0.3, 3e-3)])
def test_agrees_with_the_integral_over_directions(mach: float, tolerance: float, nu: float) -> None:
    found = moving_displacement_rate(offsets(), VELOCITY, nu, slowness(mach)).numpy()
    expected = rate_by_quadrature(offsets().numpy(), VELOCITY.numpy(), nu, float(VELOCITY.norm()) / mach)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())
    boussinesq = displacement_rate(offsets(), VELOCITY, nu).numpy()
    assert np.abs(boussinesq - expected).max() > mach**2 * np.abs(expected).max()


@pytest.mark.parametrize("mach", [0.0, 0.2])
def test_derivative_by_slowness(mach: float) -> None:
    value, step = torch.tensor(slowness(mach), dtype=torch.float64), 1e-9

    def rate(s: Tensor) -> Tensor:
        return moving_displacement_rate(offsets(), VELOCITY, 0.3, s)

    numeric = (rate(value + step) - rate(value - step)) / (2 * step)
    with forward_ad.dual_level():
        forward = forward_ad.unpack_dual(rate(forward_ad.make_dual(value, torch.ones_like(value)))).tangent
    torch.testing.assert_close(forward, numeric, rtol=1e-4, atol=1e-3)
    leaf = value.clone().requires_grad_()
    (backward,) = torch.autograd.grad(rate(leaf)[:, 0].sum(), leaf)
    torch.testing.assert_close(backward, forward[:, 0].sum(), rtol=1e-8, atol=1e-6)
    assert forward.abs().max() > 100


def test_derivatives_by_place_speed_and_poisson_ratio() -> None:
    nu = torch.full((5,), 0.3, dtype=torch.float64, requires_grad=True)
    leaves = offsets(5).requires_grad_(), VELOCITY.expand(5, 2).clone().requires_grad_(), nu
    assert torch.autograd.gradcheck(lambda o, v, n: moving_displacement_rate(o, v, n, slowness(0.2)), leaves)


def test_many_points_and_shapes() -> None:
    """Blocks join without a seam; poisson ratio and velocity broadcast."""
    offset = offsets(40000).reshape(200, 50, 4, 3)
    velocity = VELOCITY * torch.linspace(0.5, 1, 200, dtype=torch.float64)[:, None, None, None]
    found = moving_displacement_rate(
        offset, velocity, torch.full((200, 50, 1), 0.3, dtype=torch.float64), slowness(0.2)
    )
    assert found.shape == offset.shape
    one = moving_displacement_rate(offset[170, 13, 2], velocity[170, 0, 0], 0.3, slowness(0.2))
    torch.testing.assert_close(found[170, 13, 2], one, rtol=1e-9, atol=1e-12)
