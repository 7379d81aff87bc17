"""Filters that a record went through show in its noise, whatever vehicles do beside it."""

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d, median_filter

from solver.catalogue.catalogue import built_in
from solver.effect import Recorded
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


def shown(record: np.ndarray, far: np.ndarray) -> list[str]:
    """Effects that leave a trace in a record."""
    recorded = Recorded(record, far, RATE, SPACING)
    return [name for name, one in built_in().items() if one.trace is not None and one.trace(recorded) is not None]


@pytest.mark.parametrize(("speeds", "highest"), [((2.5, 25.0), 1.0), ((5.0, 40.0), 0.7), ((2.0, 60.0), 1.6)])
def test_a_fan_filter_shows_in_the_quiet_samples_whatever_it_kept(speeds, highest):
    record, far = survey()
    kept = fk_filter(torch.from_numpy(record), 1 / RATE, SPACING, speeds=speeds, highest=highest).numpy()
    assert shown(kept, far) == ["fk_filter"]


@pytest.mark.parametrize("window", [(3, 3), (5, 9), (1, 7)])
def test_a_median_is_not_a_fan_filter_though_it_smooths(window):
    record, far = survey()
    assert shown(median_filter(record, window), far) == ["median_filter"]


def test_nothing_shows_where_nothing_was_filtered_or_in_time_alone():
    record, far = survey()
    assert shown(record, far) == []
    smooth = np.apply_along_axis(np.convolve, 0, record, np.hanning(9), "same")
    assert shown(smooth, far) == []


@pytest.mark.parametrize("step", [0.02, 0.3, 1.0, 2.5])
@pytest.mark.parametrize("memory", [0.0, 0.5, 2.0])
def test_rounding_is_not_a_median_filter(step, memory):
    """Equal neighbors are the rule where the step is as coarse as the noise, more so where noise has a memory."""
    _, far = survey()
    white = np.random.default_rng(2).normal(size=far.shape)
    noise = gaussian_filter1d(white, memory, axis=0) if memory else white
    noise /= noise.std()
    assert shown(step * np.rint(noise / step), far) == []


def test_a_median_shows_in_a_record_that_was_rounded_finely():
    record, far = survey()
    assert shown(0.05 * np.rint(median_filter(record, (3, 5)) / 0.05), far) == ["median_filter"]
