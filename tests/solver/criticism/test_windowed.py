"""Matrices without the zeros of columns that act for a short while."""

import numpy as np
import torch
from torch import Tensor

from solver.criticism.windowed import Windowed

SAMPLES, CHANNELS = 60, 5


def maps(*windows: tuple[int, int]) -> Tensor:
    """Random maps [column, sample, channel], each zero beyond its window of samples."""
    torch.manual_seed(3)
    every = torch.zeros(len(windows), SAMPLES, CHANNELS, dtype=torch.float64)
    for one, (first, last) in zip(every, windows, strict=True):
        one[first:last] = torch.randn(last - first, CHANNELS, dtype=torch.float64)
    return every


def remembering(columns: Tensor) -> Tensor:
    """A filter of maps [sample, channel, column] that looks two samples back and mixes channels."""
    past = torch.zeros_like(columns)
    past[2:] = columns[:-2]
    return columns - 0.5 * past.cumsum(1)


def dense(windowed: Windowed) -> Tensor:
    return torch.stack([windowed.times(one) for one in torch.eye(windowed.width, dtype=torch.float64)], 1)


def test_maps_that_act_at_different_times_are_filtered_as_each_by_itself():
    # The second begins while the filter remembers the first, the third acts all the while, the fourth never.
    every = maps((0, 10), (11, 30), (0, SAMPLES), (0, 0), (40, SAMPLES), (41, 59))
    widths = []

    def linear(packed: Tensor) -> Tensor:
        widths.append(packed.shape[2])
        return remembering(packed)

    found = Windowed.through(every, linear, 2)
    expected = remembering(every.permute(1, 2, 0)).flatten(0, 1)
    torch.testing.assert_close(dense(found), expected)
    assert widths == [3]
    assert found.extent < 3.1


def test_products_are_those_of_the_whole_matrices():
    one, other = (
        Windowed.through(maps(*windows), remembering, 2)
        for windows in ([(0, 12), (3, 14), (20, 44), (0, SAMPLES)], [(10, 25), (0, 0), (50, SAMPLES)])
    )
    below = torch.zeros(CHANNELS, 4, dtype=torch.float64)
    below[1, 2] = 3.0
    one, other = one.above(below), other.above(torch.ones(CHANNELS, 3, dtype=torch.float64))
    both = Windowed.beside([one, other])
    a, b = dense(one), dense(other)
    assert a.shape == (SAMPLES * CHANNELS + CHANNELS, 4)
    assert a[SAMPLES * CHANNELS + 1, 2] == 3
    torch.testing.assert_close(dense(both), torch.cat([a, b], 1))
    torch.testing.assert_close(one.transposed_times(other), a.T @ b)
    torch.testing.assert_close(both.transposed_times(both), torch.cat([a, b], 1).T @ torch.cat([a, b], 1))
    torch.testing.assert_close(one.along(b[:, 0]), a.T @ b[:, 0])
    assert np.isclose(one.norm, a.norm())


def test_a_matrix_is_kept_where_it_is_not_zero():
    matrix = maps((0, 12), (30, 40), (31, 41), (0, SAMPLES)).flatten(1).T
    found = Windowed.of(matrix, CHANNELS)
    torch.testing.assert_close(dense(found), matrix)
    assert sorted(tuple(part.columns.tolist()) for part in found.parts) == [(0,), (1, 2), (3,)]
