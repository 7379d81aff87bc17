"""The parts of the noise audit, on numbers whose answer is known."""

from itertools import pairwise

import numpy as np
import pytest

from solver.criticism.audit import correlation, stretches

RNG = np.random.default_rng(5)


def test_correlation_is_the_mean_product_of_pairs_in_use():
    value = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    use = np.ones((3, 2), bool)
    assert correlation(value, use, 1, 0) == pytest.approx((1 * 3 + 3 * 5 + 2 * 4 + 4 * 6) / 4)
    assert correlation(value, use, 2, 0) == pytest.approx((1 * 5 + 2 * 6) / 2)
    assert correlation(value, use, 1, 1) == pytest.approx((1 * 2 + 3 * 4 + 5 * 6) / 3)


def test_samples_out_of_use_count_nowhere():
    """Though they are not numbers."""
    value = np.array([[1.0], [np.nan], [5.0], [7.0]])
    use = np.array([[True], [False], [True], [True]])
    assert correlation(value, use, 1, 0) == 35.0
    assert correlation(value, use, 2, 0) == 5.0
    assert correlation(value, np.zeros((4, 1), bool), 1, 0) == 0.0


@pytest.mark.parametrize("axis", [0, 1])
def test_of_noise_with_memory_the_correlation_is_reported(axis):
    white = RNG.normal(size=(4000, 30))
    mixed = 0.8 * white + 0.6 * np.roll(white, 1, axis)
    assert correlation(mixed, np.ones(mixed.shape, bool), 1, axis) == pytest.approx(0.48, abs=0.02)
    assert correlation(white, np.ones(mixed.shape, bool), 1, axis) == pytest.approx(0.0, abs=0.02)


def test_stretches_cover_the_record_with_as_many_quiet_samples_each():
    use = np.zeros((3000, 4), bool)
    use[500:900] = use[1500:2800] = True
    parts = stretches(use)
    assert len(parts) == 6 and parts[0].start == 0 and parts[-1].stop == 3000
    assert all(one.stop == other.start for one, other in pairwise(parts))
    counts = [int(use[part].sum()) for part in parts]
    assert sum(counts) == use.sum() and max(counts) - min(counts) <= 4


@pytest.mark.parametrize(("quiet", "parts"), [(0, 0), (60, 1), (110, 2), (1000, 6)])
def test_few_quiet_samples_make_few_stretches(quiet, parts):
    """A variance of fewer than 200 samples says nothing of how steady the noise is."""
    use = np.zeros((1000, 4), bool)
    use[:quiet] = True
    assert len(stretches(use)) == parts
