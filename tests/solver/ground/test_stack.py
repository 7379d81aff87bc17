"""Stiffness of layers against published tables of multilayer programs, and against itself."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.special import j1

from solver.ground.layer_stack import Stack, half_space_stiffness, layer_stiffness

Array = NDArray[np.float64]


def circular_load_deflection(
    depth: Array, bottoms: list[float], young: list[float], nu: list[float], pressure: float, radius: float
) -> Array:
    """Vertical displacement under the middle of a uniform circular load at each `depth` > 0, by plain quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(0.0, 40 / depth.min(), 1200)
    half = np.diff(edges)[:, None] / 2
    k = (edges[:-1, None] + half * (1 + nodes)).ravel()
    modulus = np.array(young) / 2 / (1 + np.array(nu))
    planes = np.unique(np.concatenate([depth, bottoms]))
    layer = np.append(np.searchsorted(bottoms, planes - 1e-9), len(bottoms))
    stack = Stack(
        torch.from_numpy(k),
        torch.from_numpy(planes),
        torch.from_numpy(modulus[layer] / modulus[-1]),
        torch.tensor(np.array(nu)[layer]),
    )
    force = torch.zeros(len(planes) + 1, len(k), 2, dtype=torch.float64)
    force[0, :, 0] = 1
    kernel = stack.displacement(force)[1:, :, 0].numpy()[np.searchsorted(planes, depth)]
    spread = 2 * j1(k * radius) / (k * radius) * (half * weights).ravel()
    return pressure * np.pi * radius**2 / (4 * np.pi * modulus[-1]) * (kernel @ spread)


def test_three_layers_as_kenlayer() -> None:
    """KENLAYER (Huang, Pavement Analysis and Design), deflections in inch as published with PyMastic 2021."""
    depth = np.array([2, 4, 6, 7, 10, 13, 16, 17, 20, 25, 29.0])
    published = [0.02246, 0.02227, 0.02186, 0.0213, 0.01991, 0.0188, 0.01774, 0.01722, 0.01585, 0.01401, 0.01283]
    found = circular_load_deflection(depth, [6, 16], [500e3, 40e3, 10e3], [0.35, 0.4, 0.45], 100.0, 5.99)
    np.testing.assert_allclose(found, published, rtol=1e-3)


def test_three_layers_as_ellea() -> None:
    """ELLEA1 (Levenberg 2016), mm, as published with ALVA (Skar, Andersen & Nielsen 2020), single wheel."""
    depth = np.array([30, 50, 100, 150, 200, 300, 400, 500, 750, 1000.0])
    published = [1.0513, 1.0493, 1.0396, 1.0235, 0.9644, 0.8769, 0.8165, 0.7726, 0.6931, 0.5777]
    found = circular_load_deflection(depth, [150, 750], [3000, 200, 40], [0.3, 0.35, 0.4], 1.1, 150.0)
    np.testing.assert_allclose(found, published, rtol=1e-3)


@pytest.mark.parametrize("nu", [0.1, 0.3, 0.49])
def test_a_half_space_cut_into_layers_stays_one(nu: float) -> None:
    k = torch.logspace(-4, 3, 40, dtype=torch.float64)
    top, across, bottom = layer_stiffness(k * 0.7, nu)
    below = half_space_stiffness(nu, k)
    whole = top - across @ torch.linalg.inv(bottom + below) @ across.mT
    torch.testing.assert_close(whole, below, rtol=1e-6, atol=1e-8)


def test_rigid_motion_of_a_layer_needs_no_force_at_long_waves() -> None:
    top, across, _ = layer_stiffness(torch.tensor([1e-4], dtype=torch.float64), 0.3)
    torch.testing.assert_close((top + across)[0, 0, 0], torch.tensor(0.0, dtype=torch.float64), atol=1e-4, rtol=0)


def test_slopes_are_derivatives_by_depth() -> None:
    k = torch.logspace(-1, 1, 9, dtype=torch.float64)
    planes = torch.tensor([1.0, 1.0 + 1e-5, 2.0, 2.0 + 1e-5, 3.0], dtype=torch.float64)
    stack = Stack(k, planes, torch.tensor([1.0, 1, 1, 0.2, 0.2, 3], dtype=torch.float64), torch.tensor(0.2))
    force = torch.zeros(6, len(k), 2, dtype=torch.float64)
    force[0, :, 0] = 1
    moved = stack.displacement(force)
    top, _ = stack.slope(moved)
    for layer in (1, 3):
        numeric = (moved[layer + 1] - moved[layer]) / 1e-5
        torch.testing.assert_close(top[layer], numeric, rtol=1e-3, atol=1e-4)
