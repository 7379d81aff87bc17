"""Scan statistics against every window by brute force."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2, norm

from solver.criticism.comparison.windows import (
    FEWEST,
    Window,
    fitted,
    gain_statistic,
    ladder,
    looked_at,
    power_statistic,
    summed,
    threshold,
    widest,
)

RNG = np.random.default_rng(2)
GROUPS = [np.array([0, 2]), np.array([1])]


@pytest.fixture
def sums() -> tuple[np.ndarray, np.ndarray]:
    """Running sums of a score and an information of three passes in two groups, strong from 12 to 17 in group 1."""
    information = RNG.uniform(0.5, 2.0, (3, 30))
    score = np.sqrt(information) * RNG.normal(size=(3, 30))
    score[1, 12:18] += 3 * np.sqrt(information[1, 12:18])
    return summed(score, GROUPS), summed(information, GROUPS)


def value(sums, group: int, first: int, last: int) -> float:
    """Statistic of one window by its own sum."""
    score, information = (part[group, last + 1] - part[group, first] for part in sums)
    return abs(score) / np.sqrt(information)


def test_running_sums_are_over_the_passes_of_each_group():
    values = np.arange(12.0).reshape(3, 4)
    found = summed(values, GROUPS)
    assert found.tolist() == [[0, 8, 18, 30, 44], [0, 4, 9, 15, 22]]


@pytest.mark.parametrize("size", [1, 2, 5, 20, 97])
def test_lengths_grow_by_no_more_than_half_and_end_with_all(size):
    lengths = ladder(size)
    assert lengths[0] == 1 and lengths[-1] == size
    assert all(a < b <= max(1.5 * a, a + 1) for a, b in pairwise(lengths))


def test_the_widest_is_the_largest_of_all_windows(sums):
    every = {
        (group, first, first + length - 1): value(sums, group, first, first + length - 1)
        for group in range(2)
        for length in ladder(30)
        for first in range(30 - length + 1)
    }
    assert len(every) == looked_at(2, 30)
    best = widest(sums, power=False)
    assert (best.group, best.first, best.last) == max(every, key=every.__getitem__)
    assert best.z == pytest.approx(max(every.values()))


def test_a_fitted_window_has_no_better_neighbor(sums):
    best = fitted(widest(sums, power=False), sums, power=False)
    assert best.group == 1 and best.z >= widest(sums, power=False).z
    for step in (-2, -1, 1, 2):
        for first, last in ((best.first + step, best.last), (best.first, best.last + step)):
            assert value(sums, best.group, first, last) <= best.z


def test_a_single_position_has_no_neighbors():
    sums = summed(np.array([[3.0]]), [np.array([0])]), summed(np.array([[1.0]]), [np.array([0])])
    assert fitted(Window(0, 0, 0, 3.0), sums, power=False) == Window(0, 0, 0, 3.0)


def test_where_nothing_is_known_there_is_no_statistic():
    assert gain_statistic(np.array([2.0, 0.0]), np.array([4.0, 0.0])).tolist() == [1.0, 0.0]
    assert power_statistic(np.array([50.0]), np.array([FEWEST - 0.1])).tolist() == [0.0]


@pytest.mark.parametrize("number", [8, 30, 300])
@pytest.mark.parametrize("tail", [0.3, 1e-2, 1e-5])
def test_the_power_statistic_has_the_tail_of_chi_square(number, tail):
    energy = chi2.isf(tail, number)
    assert float(power_statistic(np.array(energy), np.array(float(number)))) == pytest.approx(norm.isf(tail), abs=0.08)


def test_a_power_too_small_stands_out_nowhere():
    """Only too much is a finding."""
    quiet = summed(np.full((1, 40), 0.1), [np.array([0])]), summed(np.ones((1, 40)), [np.array([0])])
    assert widest(quiet, power=True).z == 0.0


def test_the_threshold_is_bonferronis():
    assert threshold(1, 0.05) == pytest.approx(norm.isf(0.05))
    assert norm.sf(threshold(500, 0.05)) * 500 == pytest.approx(0.05)
