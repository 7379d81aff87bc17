"""Filters that a record went through show in its noise, whatever vehicles do beside it."""

import numpy as np
import pytest
import torch
from scipy.ndimage import median_filter

from solver.criticism.spectrum import filtered_by
from solver.processing import fk_filter

RATE, SPACING = 5.0, 1.0


def survey() -> tuple[np.ndarray, np.ndarray]:
    """Noise with a memory and vehicles far above it, and where these are far [sample, channel]."""
    rng = np.random.default_rng(6)
    white = rng.normal(size=(900, 110))
    record = white + 0.5 * np.roll(white, 1, 0)
    place = np.arange(110.0)
    far = np.ones(record.shape, bool)
    for start in range(40, 850, 90):
        distance = place - 15.0 * (np.arange(900)[:, None] - start) / RATE
        record += 300 * distance * np.exp(-((distance / 6) ** 2))
        far &= np.abs(distance) > 35
    return record, far


@pytest.mark.parametrize(("speeds", "highest"), [((2.5, 25.0), 1.0), ((5.0, 40.0), 0.7), ((2.0, 60.0), 1.6)])
def test_a_fan_filter_shows_in_the_quiet_samples_whatever_it_kept(speeds, highest):
    record, far = survey()
    kept = fk_filter(torch.from_numpy(record), 1 / RATE, SPACING, speeds=speeds, highest=highest).numpy()
    found = filtered_by(kept, far, RATE, SPACING)
    assert found is not None and found[0] == "fk_filter"


@pytest.mark.parametrize("window", [(3, 3), (5, 9), (1, 7)])
def test_a_median_is_no_fan_filter_though_it_smooths(window):
    record, far = survey()
    found = filtered_by(median_filter(record, window), far, RATE, SPACING)
    assert found is not None and found[0] == "median_filter"


def test_nothing_shows_where_nothing_was_filtered_or_in_time_alone():
    record, far = survey()
    assert filtered_by(record, far, RATE, SPACING) is None
    smooth = np.apply_along_axis(np.convolve, 0, record, np.hanning(9), "same")
    assert filtered_by(smooth, far, RATE, SPACING) is None
