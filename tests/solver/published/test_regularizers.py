"""Each regularizer against what it is on curves known in closed form."""

import numpy as np
import pytest
import torch

from solver.published.regularizers import (
    Regularization,
    anchor_loss,
    angle_loss,
    curvature_loss,
    depth_loss,
    length_loss,
)


def circle(radius: float, spacing: float, nodes: int) -> torch.Tensor:
    """Nodes whose chords are `spacing` long on a level circle."""
    turn = 2 * np.arcsin(spacing / (2 * radius))
    angle = torch.arange(nodes, dtype=torch.float64) * turn
    level = torch.full_like(angle, 0.9)
    return torch.stack([radius * angle.sin(), radius * (1 - angle.cos()), level], dim=1)


def test_straight_and_unstretched_costs_nothing():
    line = torch.stack([torch.arange(9.0, dtype=torch.float64), *2 * [torch.ones(9, dtype=torch.float64)]], dim=1)
    assert angle_loss(line).item() == pytest.approx(0.0, abs=1e-14)
    assert length_loss(line, 1.0).item() == pytest.approx(0.0, abs=1e-14)
    assert curvature_loss(line, 1.0).item() == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("radius", [20.0, 80.0])
def test_angle_and_curvature_of_a_circle(radius: float):
    route = circle(radius, 2.0, 30)
    turn = 2 * np.arcsin(1 / radius)
    assert angle_loss(route).item() == pytest.approx(28 * 2 * (1 - np.cos(turn)))
    assert curvature_loss(route, 2.0).item() == pytest.approx(28 / radius**2, rel=1e-9)
    assert length_loss(route, 2.0).item() == pytest.approx(0.0, abs=1e-12)


def test_curvature_of_dips_alone():
    route = circle(40.0, 2.0, 30)
    assert curvature_loss(route, 2.0, slice(2, 3)).item() == 0.0
    dipping = route[:, [0, 2, 1]]
    assert curvature_loss(dipping, 2.0, slice(2, 3)).item() > 0.0


def test_length_counts_both_ways():
    route = torch.tensor([[0.0, 0.0], [1.02, 0.0], [1.99, 0.0]], dtype=torch.float64)
    assert length_loss(route, 1.0).item() == pytest.approx(0.02**2 + 0.03**2)


def test_depth_and_anchors_are_in_standard_deviations():
    route = torch.tensor([[0.0, 4.0, 0.8], [1.0, 4.0, 1.2]], dtype=torch.float64)
    assert depth_loss(route, 0.7, 0.1).item() == pytest.approx(9.0)
    sigma = torch.tensor([[0.1, 0.1, 0.2]] * 2, dtype=torch.float64)
    assert anchor_loss(route, route + sigma, sigma).item() == pytest.approx(6.0)


def test_infinity_switches_a_term_off():
    route = circle(30.0, 2.0, 20)
    none = Regularization(np.inf, np.inf, np.inf)
    assert none.loss(route, 2.0, 10.0).item() == 0.0
    only = Regularization(angle=np.inf, length=np.inf, curvature=0.02)
    assert only.loss(route, 2.0, 10.0).item() == pytest.approx(0.2 * 18 / 30**2 / 0.02**2, rel=1e-6)


def test_gradients_reach_every_node():
    route = circle(30.0, 2.1, 12).requires_grad_()
    (gradient,) = torch.autograd.grad(Regularization().loss(route, 2.0, 10.0), route)
    assert torch.isfinite(gradient).all()
    assert (gradient.norm(dim=1) > 0).all()
