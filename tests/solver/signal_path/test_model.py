"""The whole signal path against a brute-force one that loops over everything."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from solver.cable.fiber import Fiber, GaugeEnds, SplineBasis
from solver.ground.ground import Ground
from solver.signal_path.ground_motion import gauge_sums, strain_rates
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import Traffic, Vehicles
from solver.trajectory.vehicle_pass import Pass

GAUGE = 10.0
NU = 0.3
DISTANCE = np.arange(30.0, 70.0, 4.0)


def straight_pass(name: str, kind: str, speed: float, y: float, start: float, rows: np.ndarray) -> Pass:
    time = 0.2 * rows
    position = np.column_stack([start + speed * time, np.full(len(rows), y)])
    velocity = np.tile([speed, 0.0], (len(rows), 1))
    return Pass(name, kind, rows, position, velocity, np.full((len(rows), 2), 0.02), np.ones(len(rows), bool))


@pytest.fixture(scope="module")
def scene() -> tuple[SignalPath, Fiber, Vehicles, SplineBasis, torch.Tensor]:
    passes = [
        straight_pass("1", "car", 12.0, 0.0, 10.0, np.arange(0, 20)),
        straight_pass("2", "bus", -9.0, -3.5, 90.0, np.arange(12, 40)),
        straight_pass("3", "vehicle", 15.0, 0.2, -5.0, np.arange(15, 30)),
    ]
    basis = SplineBasis.even(20.0, 80.0, 10.0)
    along = np.linspace(20.0, 80.0, 40)
    bent = np.column_stack([along, 4 + np.sin(along / 12), 0.9 + 0.1 * np.cos(along / 9)])
    coefficients = torch.from_numpy(basis.interpolate(along, bent))
    ends = GaugeEnds.of(basis, DISTANCE, GAUGE)
    vehicles = Vehicles.of(passes)
    vehicles.amplitude = torch.tensor([1e-5, 8e-5, 2e-5], dtype=torch.float64)
    vehicles.along = torch.tensor([0.2, -0.1, 0.0], dtype=torch.float64)
    return SignalPath(Traffic.of(passes), GAUGE), Fiber.of(ends, coefficients), vehicles, basis, coefficients


def brute_force(path: SignalPath, basis: SplineBasis, coefficients: torch.Tensor, vehicles: Vehicles) -> np.ndarray:
    """Strain rate [sample, channel] by loops and a central difference in time of the textbook displacement."""
    traffic, step = path.traffic, 1e-4

    def displacement(point: np.ndarray, load: np.ndarray) -> np.ndarray:
        x, y = point[:2] - load
        z = point[2]
        r = np.sqrt(x * x + y * y + z * z)
        h = (z / r - (1 - 2 * NU) / (1 + z / r)) / r**2
        return np.array([x * h, y * h, (z * z / r**2 + 2 * (1 - NU)) / r])

    def strain(row: int, distance: float, shift: float) -> float:
        one = int(traffic.pass_index[row])
        heading = traffic.heading[row].numpy()
        right = np.array([-heading[1], heading[0]])
        middle = traffic.position[row].numpy() + float(vehicles.along[one]) * heading
        middle = middle + shift * traffic.velocity[row].numpy()
        base, track, front = (float(getattr(vehicles, n)[one]) for n in ("wheelbase", "track", "front_share"))
        total = 0.0
        for end in (1, -1):
            at = np.array([distance + end * GAUGE / 2])
            point = (basis.at(at) @ coefficients.numpy())[0]
            slope = (basis.at(at, 1) @ coefficients.numpy())[0]
            for axle, share in ((base / 2, front), (-base / 2, 1 - front)):
                for side in (-track / 2, track / 2):
                    load = middle + axle * heading + side * right
                    total += end * share / 2 * displacement(point, load) @ slope / np.linalg.norm(slope)
        return float(vehicles.amplitude[one]) * total / GAUGE

    out = np.zeros((len(traffic.samples), len(DISTANCE)))
    for row, sample in enumerate(traffic.sample_index):
        for column, distance in enumerate(DISTANCE):
            out[int(sample), column] += (strain(row, distance, step) - strain(row, distance, -step)) / (2 * step)
    return out


def test_against_brute_force(scene: tuple) -> None:
    path, fiber, vehicles, basis, coefficients = scene
    model = path.strain_rate(fiber, vehicles, torch.tensor(NU, dtype=torch.float64)).numpy()
    expected = brute_force(path, basis, coefficients, vehicles)
    np.testing.assert_allclose(model, expected, atol=1e-6 * np.abs(expected).max())


def test_a_long_gauge_is_the_mean_of_the_short_ones_along_it_even_around_a_corner() -> None:
    """Twenty gauges of 2.5 m, end to end, are one of 50 m; the fiber turns by a right angle at a radius of 4 m."""
    long, short, basis = 50.0, 2.5, SplineBasis.even(0.0, 100.0, 1.25)
    along = np.arange(0.0, 101.0, 0.5)
    angle = np.clip((along - 52.0) / 4.0, 0, np.pi / 2)
    steps = np.column_stack([np.cos(angle), np.sin(angle), 0 * along]) * 0.5
    bent = np.array([0.0, 7.0, 0.9]) + np.cumsum(steps, axis=0)
    coefficients = torch.from_numpy(basis.interpolate(along, bent))
    passing = straight_pass("1", "car", 12.0, 0.0, 30.0, np.arange(0, 15))
    vehicles, nu = Vehicles.of([passing]), torch.tensor(NU, dtype=torch.float64)
    vehicles.amplitude = torch.ones(1, dtype=torch.float64)

    def sensed(distance: np.ndarray, gauge: float) -> np.ndarray:
        fiber = Fiber.of(GaugeEnds.of(basis, distance, gauge, inner=True), coefficients)
        return SignalPath(Traffic.of([passing]), gauge, curved=True).strain_rate(fiber, vehicles, nu).numpy()

    middles = np.arange(30.0, 75.0, 5.0)
    apart = [sensed(middles + (k - 9.5) * short, short) for k in range(20)]
    whole = np.mean(apart, axis=0)
    assert np.abs(sensed(middles, long) - whole).max() < 0.3 * np.abs(whole).max()


def test_vehicles_superpose(scene: tuple) -> None:
    path, fiber, vehicles, _, _ = scene
    nu = torch.tensor(NU, dtype=torch.float64)
    total = path.strain_rate(fiber, vehicles, nu)
    alone = torch.zeros_like(total)
    for one in range(3):
        amplitude = torch.zeros(3, dtype=torch.float64)
        amplitude[one] = vehicles.amplitude[one]
        others = [amplitude] + [getattr(vehicles, f.name) for f in fields(vehicles)[1:]]
        alone += path.strain_rate(fiber, Vehicles(*others), nu)
    torch.testing.assert_close(total, alone)


@pytest.mark.parametrize("curved", [False, True])
def test_sensitivities_are_derivatives(scene: tuple, curved: bool) -> None:
    """In closed form by every local quantity, against PyTorch's forward mode through the whole path."""
    straight, _, vehicles, basis, coefficients = scene
    path, fiber = replace(straight, curved=curved), Fiber.of(GaugeEnds.of(basis, DISTANCE, GAUGE, curved), coefficients)
    nu = torch.tensor(NU, dtype=torch.float64)
    local = path.sensitivities(fiber, vehicles, nu)
    torch.testing.assert_close(local.rate, path.rows(fiber, vehicles.rows(path.traffic), nu), rtol=1e-12, atol=0.0)
    gauges, load, per_row = local.gauges, local.load, vehicles.rows(path.traffic)
    places = {"points": gauges.points, "weights": gauges.weights, "ratio": nu.expand(gauges.points.shape[:2])}

    def rate(name: str, shift: torch.Tensor) -> torch.Tensor:
        """Strain rate [row, channel] of unit amplitude with one quantity shifted alike for all rows and channels."""
        there = {key: x + shift if key == name else x for key, x in places.items()}
        moved = load.with_tensors({key: x + shift if key == name else x for key, x in load.tensors.items()})
        return strain_rates(moved, Ground(), *there.values())

    by = {"points": local.by_point, "weights": local.by_weight, "ratio": local.by_ratio} | dict(local.by_load)
    assert set(local.by_load) == {"position", "share", "trajectory.velocity"}
    for name, found in by.items():
        zero = torch.zeros(found.shape[2:], dtype=torch.float64)
        exact = torch.func.jacfwd(lambda shift, name=name: rate(name, shift))(zero)
        torch.testing.assert_close(found, exact, rtol=1e-9, atol=1e-12 * float(exact.abs().max()), msg=name)

    def driven(name: str, shift: torch.Tensor) -> torch.Tensor:
        return path.rows(fiber, replace(per_row, **{name: getattr(per_row, name) + shift}), nu)

    for name in (f.name for f in fields(vehicles)):
        zero = torch.zeros((), dtype=torch.float64)
        exact = torch.func.jacfwd(lambda shift, name=name: driven(name, shift))(zero)
        found = local.vehicle(name)
        torch.testing.assert_close(found, exact, rtol=1e-9, atol=1e-12 * float(exact.abs().max()), msg=name)


def test_a_route_driven_the_other_way_feels_the_same(scene: tuple) -> None:
    path, fiber, vehicles, _, _ = scene
    nu = torch.tensor(NU, dtype=torch.float64)
    reverse = Fiber(fiber.behind, fiber.ahead, -fiber.behind_slope, -fiber.ahead_slope)
    torch.testing.assert_close(path.strain_rate(fiber, vehicles, nu), path.strain_rate(reverse, vehicles, nu))


def test_taking_samples_keeps_their_strain_rate(scene: tuple) -> None:
    path, fiber, vehicles, _, _ = scene
    nu = torch.tensor(NU, dtype=torch.float64)
    chosen = np.arange(1, len(path.traffic.samples), 3)
    some = SignalPath(path.traffic.take(chosen), GAUGE)
    torch.testing.assert_close(some.strain_rate(fiber, vehicles, nu), path.strain_rate(fiber, vehicles, nu)[chosen])


def test_finer_traffic_passes_through_the_samples_and_bends_between_them():
    seconds = np.arange(20) / 5.0
    position = np.column_stack([12.0 * seconds, 0.3 * np.sin(seconds)])
    velocity = np.column_stack([np.full(20, 12.0), 0.3 * np.cos(seconds)])
    rows = np.arange(100, 120)
    one = Pass("1", "car", rows, position, velocity, np.full((20, 2), 0.02), np.ones(20, bool))
    traffic = Traffic.of([one], more=np.array([90, 91]))
    fine = traffic.finer(4)
    assert fine.over == 4 and fine.samples[[0, 1, 4, 5]].tolist() == [360, 361, 364, 400]
    assert fine.samples[fine.sampled].tolist() == [360 + 4 * k for k in (0, 1)] + (4 * rows).tolist()
    at = fine.samples[fine.sample_index] / 20.0 - 20.0
    expected = np.column_stack([12.0 * at, 0.3 * np.sin(at)])
    np.testing.assert_allclose(fine.position, expected, atol=2e-4)
    np.testing.assert_allclose(fine.heading.norm(dim=1), 1.0)
    assert fine.record_sample[:6].tolist() == [2, 2, 2, 2, 3, 3]


@pytest.mark.parametrize("channels", [1, 4])
def test_gauges_are_summed_in_one_pass_as_they_are_with_derivatives(channels: int) -> None:
    """Of several forces, whose wheels may be elsewhere for each channel."""
    random = torch.Generator().manual_seed(5)

    def drawn(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64) - 0.5

    rows, points, wheels = 6, 3, 2
    parts = [(drawn(rows, 1, wheels), drawn(rows, channels, points, wheels, 3)), (None, drawn(rows, 1, points, 1, 3))]
    parts += [(drawn(rows, channels, wheels), drawn(rows, channels, points, wheels, 3))]
    for weights in (drawn(channels, points, 3), drawn(rows, channels, points, 3)):
        plain = torch.zeros(rows, channels, dtype=torch.float64)
        for share, motion in parts:
            moved = motion.expand(rows, channels, points, wheels, 3)
            shares = torch.ones(1, 1, wheels).double() if share is None else share
            plain += (weights[..., None, :] * shares[..., None, :, None] * moved).sum((-1, -2, -3))
        torch.testing.assert_close(torch.from_numpy(gauge_sums(weights, parts)), plain)
