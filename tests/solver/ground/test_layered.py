"""Layered ground and pavement: limits, derivatives, accuracy."""

import numpy as np
import pytest
import torch
from layer_by_quadrature import rate as rate_by_quadrature
from torch import Tensor
from torch.autograd import forward_ad

from solver.ground.boussinesq import displacement, displacement_rate
from solver.ground.layered import layered_displacement, layered_displacement_rate, pavement_displacement_rate

VELOCITY = torch.tensor([12.0, -3.0], dtype=torch.float64)
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.script:DeprecationWarning")


def offsets(count: int = 120, seed: int = 0) -> Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(np.column_stack([rng.uniform(-30, 30, (count, 2)), rng.uniform(0.3, 3, count)]))


def scalar(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


@pytest.mark.parametrize("thickness", [0.05, 0.9, 8.0])
def test_no_contrast_is_boussinesq_exactly(thickness: float) -> None:
    expected = displacement_rate(offsets(), VELOCITY, 0.3)
    assert torch.equal(layered_displacement_rate(offsets(), VELOCITY, 0.3, 0.0, thickness), expected)
    assert torch.equal(pavement_displacement_rate(offsets(), VELOCITY, 0.3, 0.0, thickness), expected)
    nu = scalar(0.3)
    assert torch.equal(layered_displacement(offsets(), nu, 0.0, thickness), displacement(offsets(), nu))


def test_thick_layer_is_a_half_space_of_its_own_and_thin_one_that_below() -> None:
    near = offsets()[offsets()[:, :2].norm(dim=-1) < 5]
    expected = displacement_rate(near, VELOCITY, 0.25)
    thick = layered_displacement_rate(near, VELOCITY, 0.25, 1.5, 300.0)
    torch.testing.assert_close(thick, expected, rtol=0, atol=1e-3 * float(expected.abs().max()))
    thin = layered_displacement_rate(near, VELOCITY, 0.25, 0.5, 0.01) * np.exp(-0.5)
    torch.testing.assert_close(thin, expected, rtol=0, atol=1e-2 * float(expected.abs().max()))


@pytest.mark.parametrize("nu", [0.15, 0.45])
@pytest.mark.parametrize(
    ("log_ratio", "thickness"), [(-2.5, 0.1), (-2.5, 1.0), (-1.0, 2.0), (1.0, 0.9), (1.0, 5.0), (3.0, 0.2)]
)
def test_agrees_with_plain_quadrature(log_ratio: float, thickness: float, nu: float) -> None:
    """Half a percent of the peak is asked for; a quarter is held."""
    distance = np.concatenate([np.geomspace(0.3, 8, 25), np.linspace(8.5, 40, 12)])
    plane = distance[:, None] * [np.cos(0.4), np.sin(0.4)]
    along = torch.tensor([1.0, 0.0], dtype=torch.float64)
    for depth in (0.3, 0.9, 3.0):
        offset = torch.from_numpy(np.column_stack([plane, np.full_like(distance, depth)]))
        found = layered_displacement_rate(offset, along, nu, log_ratio, thickness).numpy()
        expected = rate_by_quadrature(plane, depth, thickness, float(np.exp(log_ratio)), nu)
        np.testing.assert_allclose(found, expected, rtol=0, atol=2.5e-3 * np.abs(expected).max())


def test_pavement_is_the_layer_per_stiffness_of_the_ground() -> None:
    ratio, thickness = 20.0, 0.2
    layered = layered_displacement_rate(offsets(), VELOCITY, 0.25, np.log(ratio), thickness) / ratio
    pavement = pavement_displacement_rate(offsets(), VELOCITY, 0.25, (ratio - 1) * thickness, thickness)
    torch.testing.assert_close(pavement, layered)


def test_rate_is_the_time_derivative_of_the_displacement() -> None:
    offset = offsets().requires_grad_()
    towards = torch.nn.functional.pad(VELOCITY, (0, 1)).expand_as(offset)
    _, expected = torch.autograd.functional.jvp(lambda o: layered_displacement(o, 0.3, 1.2, 1.1), offset, -towards)
    found = layered_displacement_rate(offset, VELOCITY, 0.3, 1.2, 1.1)
    torch.testing.assert_close(found, expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("log_ratio", [0.0, -1.3, 2.0])
@pytest.mark.parametrize("name", ["poisson_ratio", "log_ratio", "thickness"])
def test_derivatives_by_parameters(name: str, log_ratio: float) -> None:
    """Forward and backward modes agree with finite differences; at null too."""
    at = {"poisson_ratio": 0.27, "log_ratio": log_ratio, "thickness": 1.3}

    def rate(value: Tensor) -> Tensor:
        return layered_displacement_rate(offsets(20), VELOCITY, **{**at, name: value})

    value, step = scalar(at[name]), 1e-5
    numeric = (rate(value + step) - rate(value - step)) / (2 * step)
    with forward_ad.dual_level():
        forward = forward_ad.unpack_dual(rate(forward_ad.make_dual(value, scalar(1.0)))).tangent
    torch.testing.assert_close(forward, numeric, rtol=1e-4, atol=1e-6)
    leaf = value.clone().requires_grad_()
    (backward,) = torch.autograd.grad(rate(leaf)[:, 0].sum(), leaf)
    torch.testing.assert_close(backward, forward[:, 0].sum(), rtol=1e-8, atol=1e-10)
    assert name == "thickness" or forward.abs().max() > 1e-2


@pytest.mark.parametrize("ratio", [0.3, torch.linspace(0.2, 0.4, 120).double()])
def test_values_alone_are_those_that_come_with_derivatives(ratio: float | Tensor) -> None:
    """Beyond the table's depth, and on the load's axis, too."""
    offset = offsets()
    offset[0, :2], offset[1, 2] = 0.0, 900.0
    alone = layered_displacement_rate(offset, VELOCITY, ratio, 0.7, 2.0)
    both = layered_displacement_rate(offset.requires_grad_(), VELOCITY, ratio, 0.7, 2.0)
    torch.testing.assert_close(alone, both.detach(), rtol=1e-12, atol=1e-14)


def test_derivatives_in_machine_code_are_those_of_the_operations() -> None:
    """By place, velocity and a Poisson's ratio of each point; forward mode goes through PyTorch's operations."""
    rng = np.random.default_rng(3)
    at = offsets(40), torch.from_numpy(rng.normal(size=(40, 2))), torch.from_numpy(rng.uniform(0.2, 0.4, 40))
    ways = [torch.from_numpy(rng.normal(size=one.shape)) for one in at]
    weight = torch.from_numpy(rng.normal(size=(40, 3)))

    def rate(offset: Tensor, velocity: Tensor, ratio: Tensor) -> Tensor:
        return layered_displacement_rate(offset, velocity, ratio, 0.7, 2.0)

    leaves = [one.clone().requires_grad_() for one in at]
    found = torch.autograd.grad((weight * rate(*leaves)).sum(), leaves)
    for number, way in enumerate(ways):
        with forward_ad.dual_level():
            moved = [forward_ad.make_dual(one, way) if n == number else one for n, one in enumerate(at)]
            expected = forward_ad.unpack_dual(rate(*moved)).tangent
        along = float((weight * expected).sum())
        assert float((found[number] * way).sum()) == pytest.approx(along, rel=1e-9)


def test_derivative_of_pavement_at_null() -> None:
    stiffness = scalar(0.0).requires_grad_()
    rate = pavement_displacement_rate(offsets(), VELOCITY, 0.25, stiffness)
    (slope,) = torch.autograd.grad((rate**2).sum(), stiffness)
    assert torch.isfinite(slope)
    assert abs(float(slope)) > 1e-3


def test_derivative_by_position_also_across_the_interface() -> None:
    offset = offsets().requires_grad_()
    rate = layered_displacement_rate(offset, VELOCITY, 0.3, -1.0, 1.0)
    (gradient,) = torch.autograd.grad(rate[:, 0].sum(), offset)
    step = torch.eye(3, dtype=torch.float64) * 1e-6
    with torch.no_grad():
        for axis in range(3):
            ends = [layered_displacement_rate(offset + s * step[axis], VELOCITY, 0.3, -1.0, 1.0)[:, 0] for s in (-1, 1)]
            torch.testing.assert_close(gradient[:, axis], (ends[1] - ends[0]) / 2e-6, rtol=1e-4, atol=1e-4)


def test_poisson_ratio_per_point() -> None:
    """A tensor of one value is that value; one that varies is close to doing each point alone."""
    alone = layered_displacement_rate(offsets(), VELOCITY, 0.3, 1.0, 1.5)
    same = layered_displacement_rate(offsets(), VELOCITY, torch.full((120,), 0.3, dtype=torch.float64), 1.0, 1.5)
    torch.testing.assert_close(same, alone, rtol=1e-9, atol=1e-12)
    nu = torch.linspace(0.2, 0.4, 120, dtype=torch.float64)
    together = layered_displacement_rate(offsets(), VELOCITY, nu, 1.0, 1.5)
    each = torch.stack(
        [layered_displacement_rate(o, VELOCITY, n, 1.0, 1.5) for o, n in zip(offsets(), nu, strict=True)]
    )
    torch.testing.assert_close(together, each, rtol=0, atol=2e-3 * float(each.abs().max()))


def test_single_precision_stays_single() -> None:
    rate = layered_displacement_rate(offsets().float(), VELOCITY.float(), 0.3, 1.0, 1.5)
    assert rate.dtype == torch.float32
    torch.testing.assert_close(
        rate.double(), layered_displacement_rate(offsets(), VELOCITY, 0.3, 1.0, 1.5), rtol=1e-4, atol=1e-5
    )
