"""Changes of the data: each slope is the derivative of its change."""

import numpy as np
import pytest

from solver.criticism.comparison.changes import Change, linear, shifted, transposed

AT = np.sort(np.random.default_rng(6).uniform(0, 12, 40))
VALUES = np.stack([np.sin(AT), np.exp(-((AT - 6) ** 2))], 1)
BLOCKS = [slice(0, 22), slice(22, 25), slice(25, 40)]
CHANGES = {
    "linear": linear(VALUES),
    "shifted": shifted(VALUES, AT, BLOCKS),
    "transposed": transposed(shifted(VALUES, AT, BLOCKS)),
}


def away(row: int, block: slice) -> bool:
    """Whether a point is not so near a block's end that the shift takes it there, where the change has a kink."""
    return AT[row] - AT[block.start] > 0.2 and row < block.stop - 1


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("amount", [0.0, 0.13])
def test_the_slope_is_the_derivative(change: Change, amount: float):
    step = 1e-6
    between = (change.by(amount + step) - change.by(amount - step)) / (2 * step)
    inside = np.ones(between.shape, bool)
    if change is not CHANGES["linear"]:
        rows = [row for block in BLOCKS for row in range(block.start, block.stop) if away(row, block)]
        inside = np.zeros(len(AT), bool)
        inside[rows] = True
        inside = inside[None] if between.shape[1] == len(AT) else inside[:, None]
        inside = np.broadcast_to(inside, between.shape)
    np.testing.assert_allclose(change.slope(amount)[inside], between[inside], atol=1e-6)


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_no_amount_is_no_change(change: Change):
    np.testing.assert_allclose(change.by(0.0), 0.0, atol=1e-12)


def test_a_shift_moves_toward_larger_places():
    at = np.linspace(0, 10, 201)
    found = at * 0 + shifted(np.sin(at)[:, None], at, [slice(0, 201)]).by(0.5)[:, 0]
    np.testing.assert_allclose(found[20:], (np.sin(at - 0.5) - np.sin(at))[20:], atol=1e-6)


def test_too_few_points_stay_as_they_are():
    change = CHANGES["shifted"]
    assert not change.by(0.4)[22:25].any() and not change.slope(0.4)[22:25].any()
    assert change.by(0.4)[:22].any()


def test_a_shift_knows_nothing_of_the_other_blocks():
    other = VALUES.copy()
    other[25:] = 7.0
    np.testing.assert_array_equal(shifted(other, AT, BLOCKS).by(0.3)[:22], CHANGES["shifted"].by(0.3)[:22])
