"""Matrices without the zeros of columns that act for a short while."""

import numpy as np
import pytest
import torch
from torch import Tensor

from solver.fit import windowed
from solver.fit.acting_rows import alike
from solver.fit.windowed import Part, Windowed, joined

SAMPLES, CHANNELS = 60, 5


def maps(*windows: tuple[int, int]) -> Tensor:
    """Random maps [column, sample, channel], each zero beyond its window of samples."""
    torch.manual_seed(3)
    every = torch.zeros(len(windows), SAMPLES, CHANNELS, dtype=torch.float64)
    for one, (first, last) in zip(every, windows, strict=True):
        one[first:last] = torch.randn(last - first, CHANNELS, dtype=torch.float64)
    return every


def remembering(columns: Tensor) -> Tensor:
    """A filter of maps [column, sample, channel] that looks two samples back and mixes channels."""
    past = torch.zeros_like(columns)
    past[:, 2:] = columns[:, :-2]
    return columns - 0.5 * past.cumsum(2)


def dense(windowed: Windowed) -> Tensor:
    return torch.stack([windowed.times(one) for one in torch.eye(windowed.width, dtype=torch.float64)], 1)


def test_maps_that_act_at_different_times_are_filtered_as_each_by_itself():
    # The second begins while the filter remembers the first, the third acts all the while, the fourth never.
    every = maps((0, 10), (11, 30), (0, SAMPLES), (0, 0), (40, SAMPLES), (41, 59))
    found = Windowed.through(every, remembering, 2)
    torch.testing.assert_close(dense(found), remembering(every).flatten(1).T)
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
    torch.testing.assert_close(both.gram, both.transposed_times(both))
    torch.testing.assert_close(one.along(b[:, 0]), a.T @ b[:, 0])
    ways = torch.randn(2, 7, dtype=torch.float64)
    torch.testing.assert_close(both.times(ways), ways @ torch.cat([a, b], 1).T)
    torch.testing.assert_close(dense(both.between(17, 44)), torch.cat([a, b], 1)[17:44])
    assert np.isclose(one.norm, a.norm())


def test_a_matrix_is_kept_where_it_is_not_zero():
    matrix = maps((0, 12), (30, 40), (31, 41), (0, SAMPLES)).flatten(1).T
    found = Windowed.of(matrix, CHANNELS)
    torch.testing.assert_close(dense(found), matrix)
    assert sorted(tuple(part.columns.tolist()) for part in found.parts) == [(0,), (1, 2), (3,)]


def test_a_matrix_of_zeros_has_no_parts() -> None:
    found = Windowed.of(torch.zeros(SAMPLES * CHANNELS, 3, dtype=torch.float64), CHANNELS)
    assert found.parts == () and (found.rows, found.width) == (SAMPLES * CHANNELS, 3)
    assert found.norm == found.extent == 0.0
    assert not found.times(torch.ones(3, dtype=torch.float64)).any()
    assert not found.transposed_times(found).any()


def test_rows_of_zeros_below_add_no_part() -> None:
    one = Windowed.of(maps((0, 12), (30, 40)).flatten(1).T, CHANNELS)
    more = one.above(torch.zeros(4, 2, dtype=torch.float64))
    assert more.parts == one.parts and more.rows == one.rows + 4


def test_windows_without_a_row_in_common_have_no_product() -> None:
    """A column meets those of its time alone."""
    one = Windowed.of(maps((0, 12), (40, 50), (10, 20)).flatten(1).T, CHANNELS)
    product = one.transposed_times(one)
    assert product[0, 1] == product[1, 0] == product[1, 2] == 0
    assert product[0, 2] == product[2, 0] != 0


@pytest.mark.parametrize(("stretched", "groups"), [(0.25, 1), (0.35, 2)])
def test_columns_are_kept_together_where_their_windows_nearly_agree(stretched: float, groups: int) -> None:
    """Up to 1.3 times as many rows as each has itself."""
    shift = round(40 * stretched)
    assert len(alike(torch.tensor([[0, 40], [shift, 40 + shift]]))) == groups


def test_joined_parts_hold_what_each_held() -> None:
    parts = [
        Part(torch.tensor([4]), 2, 12, torch.ones(1, 10).double()),
        Part(torch.tensor([1]), 0, 11, 2 * torch.ones(1, 11).double()),
        Part(torch.tensor([2]), 60, 70, 3 * torch.ones(1, 10).double()),
    ]
    last = parts[2]
    found = {tuple(part.columns.tolist()): part for part in joined(parts)}
    assert found[(2,)] is last
    (together,) = (part for key, part in found.items() if set(key) == {1, 4})
    assert (together.first, together.last) == (0, 12)
    rows = dict(zip(together.columns.tolist(), together.values.tolist(), strict=True))
    assert rows[4] == [0.0, 0.0, *[1.0] * 10] and rows[1] == [*[2.0] * 11, 0.0]


def test_large_parts_are_not_merged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Merging holds what is merged twice, and makes products of large parts no faster."""
    monkeypatch.setattr(windowed, "MERGED", 25)
    found = joined([Part(torch.tensor([number]), 0, 10, torch.ones(1, 10).double()) for number in range(7)])
    assert [part.columns.tolist() for part in found] == [[0, 1, 2], [3, 4, 5], [6]]
