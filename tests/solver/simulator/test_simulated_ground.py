"""Layered and moving ground of the generator: limits that are known, and brute-force integrals."""

import numpy as np
import pytest

from solver.simulator import Scenario, Vehicle
from solver.simulator.elastic import extension
from solver.simulator.layered_elastic import Layers, Table, layers_of, solve, state, strains
from solver.simulator.moving_source import Inertia, excess

STILL = ((0.0, 1.0, 0.0),)


def boussinesq(r, z, nu):
    """Hoop, (radial - hoop) / r^2, vertical, shear / r for F / (4 pi G) = 1 (Poulos & Davis 1974)."""
    R, k = np.hypot(r, z), 1 - 2 * nu
    return np.array(
        [
            z / R**3 - k / (R * (R + z)),
            k * (2 * R + z) / (R**3 * (R + z) ** 2) - 3 * z / R**5,
            2 * nu * z / R**3 - 3 * z**3 / R**5,
            -6 * z**2 / R**5,
        ]
    )


@pytest.mark.parametrize("nu", [0.1, 0.25, 0.45])
@pytest.mark.parametrize("face", [[], [0.7, 3.0]])
def test_layers_that_are_alike_are_a_half_space(nu, face):
    r, z = np.array([0.001, 0.4, 2.0, 10.0, 60.0]), np.array([0.6, 1.2])
    found = strains(Layers(np.array(face), np.ones(len(face) + 1), nu), r, z)
    for row, depth in enumerate(z):
        known = boussinesq(r, depth, nu)
        np.testing.assert_allclose(found[:, row], known, rtol=1e-4, atol=1e-8)


def test_near_the_load_the_upper_layer_rules_and_far_away_the_lower():
    layers = Layers(np.array([4.0]), np.array([1.0, 4.0]), 0.25)
    near, far = np.array([0.2]), np.array([150.0])
    shallow = strains(layers, near, np.array([0.3]))[:2, 0, 0]
    np.testing.assert_allclose(shallow, boussinesq(near, 0.3, 0.25)[:2, 0], rtol=0.03)
    deep = strains(layers, far, np.array([0.3]))[:2, 0, 0]
    np.testing.assert_allclose(deep, boussinesq(far, 0.3, 0.25)[:2, 0] / 4, rtol=0.08)


def test_tractions_and_displacements_meet_at_every_face_and_the_surface_is_free():
    layers = Layers(np.array([0.2, 1.0]), np.array([20.0, 1.0, 5.0]), 0.3)
    k = np.geomspace(0.01, 15, 9)
    weight = solve(layers, k)
    for face in layers.face:
        above, below = (state(layers, k, weight, face + side) for side in (-1e-9, 1e-9))
        np.testing.assert_allclose(above, below, rtol=1e-5, atol=1e-9)
    surface = state(layers, k, weight, 0.0)
    np.testing.assert_allclose(surface[:, 2], -1.0, atol=1e-9)
    np.testing.assert_allclose(surface[:, 3], 0.0, atol=1e-9)


def test_the_equations_of_equilibrium_hold_inside_a_layer():
    """In transforms: sigma' = -k tau, tau' = k sigma_x, and Hooke's law; slopes from central differences."""
    layers, nu = Layers(np.array([0.5, 2.0]), np.array([3.0, 1.0, 6.0]), 0.3), 0.3
    k, h = np.array([0.3, 1.0, 2.5]), 1e-5
    weight = solve(layers, k)
    U, W, sigma, tau = state(layers, k, weight, 1.1).T
    before, after = (state(layers, k, weight, 1.1 + side) for side in (-h, h))
    slope = (after - before) / (2 * h)
    np.testing.assert_allclose(slope[:, 2], -k * tau, rtol=1e-6)
    lame, dilation = 2 * nu / (1 - 2 * nu), k * U + slope[:, 1]
    np.testing.assert_allclose(sigma * 2 * k, lame * dilation + 2 * slope[:, 1], rtol=1e-6)
    np.testing.assert_allclose(tau * 2 * k, slope[:, 0] - k * W, rtol=1e-6)
    # Plane strain along the wave: tau' = k sigma_x, sigma_x = lambda dilation + 2 mu k U.
    np.testing.assert_allclose(slope[:, 3] * 2 * k, k * (lame * dilation + 2 * k * U), rtol=1e-6)


def test_the_table_is_the_strain_tensor_along_the_fiber():
    rng = np.random.default_rng(2)
    tangents = rng.normal(size=(3, 8)) * np.array([[1.0], [0.3], [0.05]])
    tangents /= np.linalg.norm(tangents, axis=0)
    x, y, z = rng.uniform(-15, 15, 8), rng.uniform(1, 6, 8), rng.uniform(0.6, 1.2, 8)
    table = Table(Layers(np.array([2.0]), np.ones(2), 0.25), z, tangents)
    known = extension((x, y, z), tangents, 0.25)
    np.testing.assert_allclose(table.extension(x, y), known, rtol=2e-3, atol=2e-4 * np.abs(known).max())


def test_layers_of_a_scenario():
    assert layers_of(Scenario()) is None
    two = layers_of(Scenario(effects={"layered_ground": np.log(4), "layered_ground_depth": 3.0}))
    np.testing.assert_allclose(two.face, [3.0])
    np.testing.assert_allclose(two.modulus, [1.0, 4.0])
    plate = layers_of(Scenario(effects={"pavement": 0.2, "pavement_ratio": 15.0}))
    np.testing.assert_allclose(plate.face, [0.2])
    np.testing.assert_allclose(plate.modulus, [15.0, 1.0])
    soil = layers_of(Scenario(effects={"gibson_soil": 2.0}))
    middle = (soil.face[10] + soil.face[11]) / 2
    assert soil.modulus[11] == pytest.approx((1 + 2 * middle) / 3)
    both = layers_of(Scenario(effects={"gibson_soil": 2.0, "pavement": 0.1}))
    assert both.modulus[0] > 9 and both.face[0] == pytest.approx(0.1) and both.face[1] == pytest.approx(0.2)


def test_a_slow_load_is_a_static_one_and_a_faster_one_departs_as_its_square():
    k = np.array([0.3, 1.0, 3.0])
    small, large = (excess(k, 0.7 * k, 0.8, speed, 0.25) for speed in (0.05, 0.1))
    np.testing.assert_allclose(large / small, 4.0, rtol=0.08)
    assert np.abs(excess(k, 0 * k, 0.8, 0.3, 0.25)).max() == 0


def test_inertia_is_the_integral_over_all_waves():
    vehicle = Vehicle("1", "car", 1000, 0, 0, 0.5, 4, 2, 1, 0.0, 10.0, 50.0, 15.0, STILL, STILL)
    scenario = Scenario(effects={"moving_load": 0.3, "point_load": 1.0})
    points = np.array([[55.0, 52.0, 40.0], [2.0, 3.0, 4.0], [0.7, 0.9, 0.8]])
    k = np.linspace(0, 40, 4001)[1:]
    angle = np.linspace(0, 2 * np.pi, 361)[:-1]
    K, T = np.meshgrid(k, angle, indexing="ij")
    kx, ky = K * np.cos(T), K * np.sin(T)
    for tangent in ((1.0, 0.0, 0.0), (0.6, 0.8, 0.0)):
        tangents = np.tile(np.array(tangent)[:, None], 3)
        found = Inertia(scenario, points, tangents).extension(vehicle, np.array([10.0]))[0] / (1000 * 9.81)
        along = kx * tangent[0] + ky * tangent[1]
        for node, (x, y, z) in enumerate(points.T):
            wave = -(along**2) * excess(K, kx, z, 0.3, 0.25) * np.cos(kx * (x - 50) + ky * y)
            known = wave.sum() * (k[1] - k[0]) * (angle[1] - angle[0]) / (2 * np.pi) ** 2
            assert found[node] == pytest.approx(known, rel=0.05, abs=3e-5)
