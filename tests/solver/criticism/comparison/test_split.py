"""The shares of the misfit, against columns that are written out."""

from itertools import combinations, permutations

import numpy as np
import pytest

from solver.criticism.comparison.split import LONGEST, Columns, Split, chunks, crossed, explained_by, fair_shares

RNG = np.random.default_rng(4)


def dense(columns: Columns) -> np.ndarray:
    """The columns themselves [cell, column]."""
    out = np.zeros((len(columns.field), columns.count))
    for cell, label in enumerate(columns.labels):
        if label >= 0:
            out[cell, label] = columns.field[cell]
    return out


def made(count: int) -> Columns:
    return Columns(RNG.normal(size=50), RNG.integers(-1, count, 50), count)


@pytest.mark.parametrize(("one", "other"), [(4, 4), (3, 7), (1, 5)])
def test_products_are_those_of_the_columns(one, other):
    a, b = made(one), made(other)
    np.testing.assert_allclose(crossed(a, b), dense(a).T @ dense(b), atol=1e-12)


def test_explained_is_what_least_squares_takes_from_chi2():
    columns, data = RNG.normal(size=(80, 6)) * 10.0 ** np.arange(-3, 3), RNG.normal(size=80)
    use = np.array([0, 2, 5])
    left = data - columns[:, use] @ np.linalg.lstsq(columns[:, use], data, rcond=None)[0]
    found = explained_by(columns.T @ columns, columns.T @ data, use)
    assert found == pytest.approx(data @ data - left @ left, rel=1e-5)
    assert explained_by(columns.T @ columns, columns.T @ data, use[:0]) == 0.0


def test_columns_that_say_the_same_explain_it_once():
    column, data = RNG.normal(size=(40, 1)), RNG.normal(size=40)
    twice = np.hstack([column, column])
    once = explained_by(column.T @ column, column.T @ data, np.array([0]))
    assert explained_by(twice.T @ twice, twice.T @ data, np.array([0, 1])) == pytest.approx(once, rel=1e-5)


def test_fair_shares_are_the_mean_over_all_orders():
    worth = {frozenset(s): float(RNG.uniform(0, 5)) for size in range(4) for s in combinations(range(3), size)}
    shares = np.zeros(3)
    for order in permutations(range(3)):
        for place, source in enumerate(order):
            before = frozenset(order[:place])
            shares[source] += (worth[before | {source}] - worth[before]) / 6
    np.testing.assert_allclose(fair_shares(worth, 3), shares)


@pytest.mark.parametrize("rows", [4 * LONGEST, 1000])
def test_pieces_cover_every_row_once_beyond_what_they_skip(rows):
    """And each has, before the rows that count, all that the noise remembers, or the block's start."""
    blocks = [slice(0, 517), slice(600, 620), slice(700, 1900)]
    seen = []
    for piece, skip in chunks(blocks, rows):
        seen += range(piece.start + skip, piece.stop)
        (block,) = (one for one in blocks if one.start <= piece.start and piece.stop <= one.stop)
        assert skip == min(LONGEST, piece.start + skip - block.start)
    assert seen == [row for block in blocks for row in range(block.start, block.stop)]


def test_a_share_is_of_all_of_chi2():
    split = Split(200.0, 100, {"channel gain": 30.0, "kernel": 50.0}, {}, 100.0, 20.0)
    assert split.share("kernel") == 0.25 and split.share("channel gain", "kernel") == pytest.approx(0.4)
    assert Split(0.0, 0, {"kernel": 0.0}, {}, 0.0, 0.0).share("kernel") == 0.0
