import numpy as np
import pytest
import torch

from solver.load.wheel_layout import layout_of
from solver.start.coupling_curve import coupling_curve, rising_branch
from solver.start.straight_fiber import straight_strain_rate
from solver.start.wavelets import bank, best_scale
from vision.contract import InputError

GROUND = {"depth": 0.9, "gauge_length": 10.0, "poisson_ratio": 0.25}
CLASSES = ("vehicle", "car", "van", "truck", "bus")


def response(offset: list[float], along: np.ndarray, kind: str) -> np.ndarray:
    one = torch.ones((), dtype=torch.float64)
    place = (torch.tensor(offset, dtype=torch.float64), 0.9 * one, torch.from_numpy(along), 0.25 * one)
    return straight_strain_rate(*place, layout_of(kind), 10.0).numpy()


def closed_form(offset: float, along: np.ndarray, depth: float, gauge: float, nu: float) -> np.ndarray:
    """Strain rate of a point load at 1 m/s: central difference in time of the textbook displacement's strain."""

    def extension(x: np.ndarray) -> np.ndarray:
        def u(h: np.ndarray) -> np.ndarray:
            r = np.sqrt(h**2 + offset**2 + depth**2)
            return h / r**2 * (depth / r - (1 - 2 * nu) / (1 + depth / r))

        return (u(x + gauge / 2) - u(x - gauge / 2)) / gauge

    step = 1e-4
    return (extension(along - step) - extension(along + step)) / (2 * step)


def test_response_of_a_point_load_is_the_closed_form():
    along = np.linspace(-40, 40, 81)
    rate = response([1.0, 4.0], along, "vehicle")
    for offset, row in zip((1.0, 4.0), rate, strict=True):
        np.testing.assert_allclose(row, closed_form(offset, along, 0.9, 10.0, 0.25), atol=1e-7 * np.abs(row).max())


@pytest.mark.parametrize("kind", CLASSES)
def test_width_rises_with_the_offset_and_is_inverted(kind: str):
    curve = coupling_curve(kind, **GROUND)
    beyond = curve.offset >= curve.nearest
    assert (np.diff(curve.width[beyond]) > 0).all()
    assert curve.nearest <= 4.0
    offset = np.linspace(curve.nearest, 20.0, 50)
    np.testing.assert_allclose(curve.offset_of(curve.width_at(offset)), offset, atol=1e-6)
    np.testing.assert_allclose(curve.width_at(-offset), curve.width_at(offset))


def test_width_is_the_scale_that_the_filter_finds():
    curve = coupling_curve("car", **GROUND)
    scales = np.arange(2.0, 20.25, 0.5)
    wavelets = bank(scales)
    along = np.arange(len(wavelets), dtype=float) - len(wavelets) // 2
    for offset in (4.0, 8.0, 11.0):
        shape = response([offset], along, "car")
        assert abs(best_scale(shape @ wavelets, scales)[0] - curve.width_at(offset)) < 0.1


def test_under_the_wheels_the_width_tells_nothing():
    curve = coupling_curve("car", **GROUND)
    assert curve.width_at(0.0) == curve.width_at(curve.nearest)
    assert curve.offset_of(0.5 * curve.width[0]) == curve.nearest
    assert curve.offset_of(100.0) == 20.0


def test_longer_vehicles_and_deeper_fibers_look_wider():
    widths = [float(coupling_curve(kind, **GROUND).width_at(5.0)) for kind in CLASSES]
    assert widths == sorted(widths)
    depths = [float(coupling_curve("car", **{**GROUND, "depth": z}).width_at(5.0)) for z in (0.4, 0.9, 1.5)]
    assert depths == sorted(depths)


def test_amplitude_falls_with_the_offset():
    curve = coupling_curve("vehicle", **GROUND)
    assert (np.diff(curve.amplitude[curve.offset >= curve.nearest]) < 0).all()


@pytest.mark.parametrize("gauge_length", [2.0, 5.0, 20.0, 40.0])
@pytest.mark.parametrize("poisson_ratio", [0.0, 0.25, 0.4, 0.49])
def test_any_gauge_and_ground_gives_a_curve_that_never_falls(gauge_length: float, poisson_ratio: float):
    curve = coupling_curve("bus", depth=0.9, gauge_length=gauge_length, poisson_ratio=poisson_ratio)
    assert np.isfinite(curve.width).all()
    assert (np.diff(curve.width) >= 0).all()
    assert 0 <= curve.nearest <= 20.0


def test_rising_branch_keeps_a_steady_rise():
    width = np.array([5.0, 5.1, 5.3, 5.6])
    np.testing.assert_array_equal(rising_branch(width), width)


@pytest.mark.parametrize("wrong", [{"depth": 0.0}, {"gauge_length": -1.0}])
def test_a_fiber_above_the_ground_or_without_a_gauge_is_refused(wrong: dict):
    with pytest.raises(InputError, match="above 0"):
        coupling_curve("car", **{**GROUND, **wrong})
