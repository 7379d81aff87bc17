"""Power where no vehicle is known: boxes by brute force, and the speed of what moves."""

import numpy as np
import pytest

from solver.criticism.comparison.unseen import Box, best_box, corner_sums, joined, speed_of, starts
from solver.criticism.comparison.windows import ladder, power_statistic

RNG = np.random.default_rng(9)


def test_corner_sums_give_the_sum_of_any_box():
    values = RNG.normal(size=(7, 5))
    sums = corner_sums(values)
    for top, bottom, left, right in ((0, 7, 0, 5), (2, 5, 1, 4), (6, 7, 4, 5)):
        found = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        assert found == pytest.approx(values[top:bottom, left:right].sum())


@pytest.mark.parametrize(("size", "length"), [(10, 1), (10, 8), (100, 33), (5, 5)])
def test_starts_stay_inside_and_a_quarter_of_the_length_apart(size, length):
    first = starts(size, length)
    assert first[0] == 0 and first[-1] + length <= size
    assert set(np.diff(first).tolist()) <= {max(1, length // 4)}


def test_the_best_box_is_the_largest_of_all_and_leaves_no_block():
    blocks = [slice(0, 16), slice(16, 30)]
    energy = RNG.chisquare(1, (30, 12))
    energy[13:19, 8:] *= 4  # across the border of the blocks
    energy[20:26, 3:7] *= 8
    number = np.ones_like(energy)
    best, count = best_box(energy, number, blocks)
    every = {}
    for block in blocks:
        height = block.stop - block.start
        for tall in ladder(height)[1:]:
            for wide in ladder(12)[1:]:
                for top in starts(height, tall) + block.start:
                    for left in starts(12, wide):
                        part = slice(top, top + tall), slice(left, left + wide)
                        z = power_statistic(energy[part].sum(), np.array(float(tall * wide)))
                        every[(top, top + tall), (left, left + wide)] = float(z)
    assert count == len(every)
    assert (best.rows, best.columns) == max(every, key=every.__getitem__)
    assert best.z == pytest.approx(max(every.values()))


def box(row: int, column: int) -> Box:
    return Box((row, row + 4), (column, column + 4), 9.0)


def test_boxes_that_are_close_in_both_are_one_group():
    a, b, c, d = box(0, 0), box(6, 2), box(12, 4), box(6, 40)
    groups = joined([a, c, d, b], (3, 3))
    assert sorted(map(len, groups)) == [1, 3]
    assert [d] in groups
    assert sorted(map(len, joined([a, b, c], (2, 3)))) == [1, 1, 1], "at the margin they are apart"


@pytest.mark.parametrize("speed", [-12.0, 6.0, 25.0])
def test_the_speed_of_what_moves_is_reported(speed):
    time, distance = np.arange(200) / 10, np.arange(80.0)
    middle = distance[40] + speed * (time - 10)
    residual = RNG.normal(size=(200, 80)) + 5 * np.exp(-(((distance - middle[:, None]) / 4) ** 2))
    found = speed_of(np.ones((200, 80), bool), residual, time, distance, 1.0)
    assert found == pytest.approx(speed, rel=0.1)


def test_noise_stands_still_and_a_moment_has_no_speed():
    time, distance = np.arange(100) / 10, np.arange(50.0)
    noise, where = RNG.normal(size=(100, 50)), np.ones((100, 50), bool)
    assert speed_of(where, noise, time, distance, 1.0) is None
    assert speed_of(np.zeros_like(where), noise, time, distance, 1.0) is None
    brief = where & (time[:, None] < 1.0)
    assert speed_of(brief, 9 + noise, time, distance, 1.0) is None
