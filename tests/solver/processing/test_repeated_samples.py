"""Samples that equal their neighbors: left by a median filter, and by rounding."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from solver.processing.processing_effects import REPEATED
from solver.processing.spectrum import repeated_share


@pytest.fixture(params=range(4))
def drifting(request):
    """Heavy-tailed noise [sample, channel] whose level grows twelvefold in three minutes, and scales of channels."""
    rng = np.random.default_rng(request.param)
    level = np.exp(np.linspace(-1.5, 1.0, 1800))[:, None]
    return rng.standard_t(5, size=(1800, 13)) * level, rng.uniform(0.7, 1.4, 13)


def test_rounding_of_noise_that_is_louder_at_times_is_no_median(drifting):
    """8 % of such a record were said to be a median filter's; each part of it is as rounding leaves it."""
    noise, scale = drifting
    assert repeated_share(np.rint(noise) / scale) < 0.01 < REPEATED


def test_a_median_shows_however_loud_the_noise(drifting):
    assert repeated_share(median_filter(drifting[0], (3, 3))) > 2 * REPEATED
