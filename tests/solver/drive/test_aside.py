"""How deep the fiber of a drive lies: told where the car passes close by, else what was assumed."""

from typing import Any

import numpy as np

import roadfiber as rf
from solver.drive.aside import PLACES, ROUGH, weighed

DEPTHS, PRIOR = np.linspace(0.3, 1.65, 7), (0.9, 0.3)


def test_a_stretch_that_hears_the_car_has_its_own_depth_and_others_the_prior() -> None:
    cell = np.arange(0.0, 500.0, 10.0)
    sums = np.zeros((5, 7, len(PLACES)))
    sums[2] = -((DEPTHS[:, None] - 0.6) ** 2 / 0.02 + (PLACES - 4.0) ** 2 / 2.0) / 0.3
    lateral, sigma, deep, deep_sigma = weighed(sums, cell, 8.0, DEPTHS, PRIOR)
    middle = np.flatnonzero(cell == 250.0)[0]
    assert 0.6 < deep[middle] < 0.72
    assert ROUGH < deep_sigma[middle] < 0.22
    assert abs(lateral[middle] - 4.0) < 0.3 and sigma[middle] < 2.5
    assert deep[[0, -1]].tolist() == [0.9, 0.9]
    np.testing.assert_allclose(deep_sigma[[0, -1]], 0.3)


def test_depth_is_told_where_the_car_passes_close_by(run: rf.DriveRun, truth: dict[str, Any]) -> None:
    real = np.array(truth["route_xyz"])[:, 2]
    table = run.route[run.arrays["heard"] & ~np.array(truth["in_loop"])]
    off = (table["z"] - real[table.index]).to_numpy()
    told = table["sigma_z"].to_numpy() < 0.22
    assert told.mean() > 0.1
    assert np.sqrt((off[told] ** 2).mean()) < 0.2
    assert (np.abs(off) < 1.96 * table["sigma_z"]).mean() > 0.9
    assert table["sigma_z"].max() <= 0.3 + 1e-9
