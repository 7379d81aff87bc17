"""What a gauge beside the path records as the car goes by."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from solver.drive.path import STEP, Path, path_of
from solver.drive.response import POISSON_RATIO, segments_of, strain_rate
from solver.ground.boussinesq import displacement_rate
from solver.load.wheel_layout import layout_of


@pytest.fixture(scope="module")
def path() -> Path:
    along = np.linspace(0.0, 3.0, 200)
    return path_of(np.stack([200 * along, 60 * np.sin(along)], 1))


@pytest.mark.parametrize("vehicle_class", ["car", "bicycle"])
@pytest.mark.parametrize("gauge_length", [10.0, 7.3])
def test_a_gauge_records_how_its_ends_move_apart(path, vehicle_class, gauge_length):
    random = np.random.default_rng(1)
    count, depth = 40, 0.8
    place = path.points[random.integers(0, len(path.points), count)] + random.normal(0.0, 5.0, (count, 2))
    driven = SimpleNamespace(position=place, velocity=random.normal(0.0, 12.0, (count, 2)))
    cell, sample = random.integers(0, len(path.points), count), random.permutation(count)
    shift = random.normal(0.0, 4.0, count)
    asked = SimpleNamespace(gauge_length=gauge_length), path, SimpleNamespace(vehicle_class=vehicle_class)
    found = strain_rate(*asked, SimpleNamespace(driven=driven), cell, shift, sample, depth)
    layout = layout_of(vehicle_class)
    for n in range(count):
        velocity = driven.velocity[sample[n]]
        ahead, expected = velocity / np.hypot(*velocity), 0.0
        for sign in (1, -1):
            steps = sign * gauge_length / 2 / STEP
            near = np.clip(cell[n] + round(steps), 0, len(path.points) - 1)
            end = path.points[near] + (steps - round(steps)) * STEP * path.along[near] + shift[n] * path.across[near]
            for of, share in (
                (layout.wheelbase / 2, layout.front_share),
                (-layout.wheelbase / 2, 1 - layout.front_share),
            ):
                offset = torch.tensor([*(end - driven.position[sample[n]] - of * ahead), depth]).double()
                rate = displacement_rate(offset, torch.from_numpy(velocity), POISSON_RATIO)[:2].numpy()
                expected += sign * share * float(rate @ path.along[near]) / gauge_length
        assert found[n] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_segments_are_runs_of_samples_of_one_leg_in_reach_of_a_cell():
    cell = np.array([0, 1, 2, 3, 4, 9, 4, 3, 2, 1])
    near = np.array([True, True, True, False, True, True, True, True, True, True])
    leg = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 1])
    begin, segment = segments_of(SimpleNamespace(cell=cell, near=near, leg=leg), 6, STEP, np.arange(6) != 1)
    assert begin.tolist() == [0, 2, 2, 4, 7, 9, 11]
    by_cell = [segment[first:last].tolist() for first, last in pairwise(begin)]
    assert by_cell[0] == [[0, 2, 0], [9, 10, 1]]
    assert by_cell[2] == [[1, 3, 0], [7, 10, 1]]
    assert by_cell[3] == [[2, 3, 0], [4, 5, 0], [6, 9, 1]]
    assert by_cell[4:] == [[[4, 5, 0], [6, 8, 1]], [[4, 5, 0], [6, 7, 1]]]


def test_a_car_that_is_nowhere_near_is_heard_nowhere():
    nowhere = SimpleNamespace(cell=np.zeros(3, np.int64), near=np.zeros(3, bool), leg=np.zeros(3, np.int64))
    begin, segment = segments_of(nowhere, 4, 10.0, np.ones(4, bool))
    assert begin.tolist() == [0] * 5 and segment.shape == (0, 3)
