"""Maps of width and sensitivity against finite differences and against the closed form."""

import numpy as np
import pytest
import torch

from solver.load.wheel_layout import LAYOUTS, POINT, layout_of
from solver.start.response_maps import response_maps
from solver.start.straight_fiber import straight_strain_rate
from vision.contract import InputError

OFFSET, DEPTH = np.linspace(0.5, 12.0, 8), np.array([0.5, 0.9, 1.8])


def rate(y: float, z: float, nu: float, kind: str = "car") -> np.ndarray:
    along = torch.linspace(-95, 95, 381, dtype=torch.float64)
    at = (torch.tensor(value, dtype=torch.float64) for value in (y, z, nu))
    y, z, nu = at
    return straight_strain_rate(y, z, along, nu, layout_of(kind), 10.0).numpy()


def test_four_wheels_are_the_sum_of_point_loads():
    car = LAYOUTS["car"]
    along = torch.linspace(-20, 20, 41, dtype=torch.float64)
    z, nu = torch.tensor(0.9, dtype=torch.float64), torch.tensor(0.25, dtype=torch.float64)
    total = torch.zeros(41, dtype=torch.float64)
    for ahead, share in ((0.5, car.front_share), (-0.5, 1 - car.front_share)):
        for right in (-0.5, 0.5):
            y = torch.tensor(3.0 - right * car.track, dtype=torch.float64)
            total += share / 2 * straight_strain_rate(y, z, along - ahead * car.wheelbase, nu, POINT, 10.0)
    four = straight_strain_rate(torch.tensor(3.0, dtype=torch.float64), z, along, nu, car, 10.0)
    torch.testing.assert_close(four, total)


def test_the_strain_rate_is_antisymmetric_about_a_symmetric_vehicle():
    values = rate(4.0, 0.9, 0.25, "vehicle")
    np.testing.assert_allclose(values, -values[::-1], atol=1e-15)


@pytest.mark.parametrize("kind", ["vehicle", "bus"])
def test_sensitivities_are_the_derivatives(kind: str):
    maps = response_maps(OFFSET, DEPTH, kind)
    base = {"y": OFFSET[3], "z": DEPTH[1], "nu": 0.25}
    here = rate(**base, kind=kind)
    for name, value in base.items():
        step = 1e-5
        slope = (rate(**base | {name: value + step}, kind=kind) - rate(**base | {name: value - step}, kind=kind)) / (
            2 * step
        )
        size = np.linalg.norm(here)
        assert maps.sensitivity[name][1, 3] == pytest.approx(np.linalg.norm(slope) / size, rel=1e-5)
        left = slope - here * (here @ slope) / size**2
        assert maps.told[name][1, 3] == pytest.approx(np.linalg.norm(left) / size, rel=1e-5)
    assert maps.strength[1, 3] == pytest.approx(np.abs(here).max())


def test_what_a_free_weight_leaves_is_never_more_than_the_whole():
    maps = response_maps(OFFSET, DEPTH)
    for name in ("y", "z", "nu"):
        assert (maps.told[name] <= maps.sensitivity[name] + 1e-12).all()
        assert (maps.told[name] > 0).all()


def test_far_fibers_look_wide_weak_and_say_less_of_their_depth():
    maps = response_maps(np.linspace(4, 12, 9), np.array([0.9]))
    assert (np.diff(maps.width[0]) > 0).all()
    assert (np.diff(maps.strength[0]) < 0).all()
    assert (np.diff(maps.told["z"][0]) < 0).all()


def test_the_width_is_that_of_the_coupling_curve():
    from solver.start.coupling_curve import coupling_curve

    curve = coupling_curve("van", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    maps = response_maps(np.array([5.0, 8.0, 11.0]), np.array([0.9]), "van")
    np.testing.assert_allclose(maps.width[0], curve.width_at(np.array([5.0, 8.0, 11.0])), atol=0.1)


def test_the_figure_shows_every_map():
    figure = response_maps(OFFSET, DEPTH).draw()
    titles = [axis.get_title() for axis in figure.axes]
    assert titles[:3] == ["width of the response, m", "strength, powers of ten", "depth over offset, powers of ten"]
    assert sum("change per" in title for title in titles) == 3


def test_a_fiber_above_the_ground_is_refused():
    with pytest.raises(InputError, match="under the ground"):
        response_maps(OFFSET, np.array([0.0, 1.0]))
