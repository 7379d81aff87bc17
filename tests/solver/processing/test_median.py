"""The median filter against scipy's, and where it differs on purpose: what is not measured."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from solver.processing import median, median_filtered
from solver.survey.das import DASRecord
from vision.contract import InputError


def filtered(strain_rate: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    channel = np.arange(strain_rate.shape[1])
    time = np.arange(len(strain_rate)) / 5.0
    record = DASRecord(strain_rate, time, np.datetime64(0, "ns"), channel * 1.0, channel, 10.0, 1.0, 5.0, (), {})
    return median_filtered(record, size).strain_rate


@pytest.mark.parametrize("size", [(3, 3), (1, 5), (5, 1), (7, 3)])
def test_inside_it_is_the_median_of_the_window(size: tuple[int, int], monkeypatch: pytest.MonkeyPatch):
    strain_rate = np.random.default_rng(0).normal(size=(40, 30))
    monkeypatch.setattr(median, "BLOCK", 3000)  # several blocks
    expected = median_filter(strain_rate, size)
    np.testing.assert_array_equal(filtered(strain_rate, size)[4:-4, 4:-4], expected[4:-4, 4:-4])


def test_spikes_go_and_steps_stay():
    step = np.repeat([[0.0], [1.0]], 10, axis=0) * np.ones(12)
    spiky = step.copy()
    spiky[[3, 8, 15], [2, 7, 11]] = 50.0
    np.testing.assert_array_equal(filtered(spiky, (3, 3)), step)


def test_gaps_and_dead_channels_do_not_count_and_stay():
    rng = np.random.default_rng(1)
    strain_rate = rng.normal(size=(30, 20))
    strain_rate[10:14] = np.nan
    strain_rate[:, 5] = np.nan
    result = filtered(strain_rate, (3, 3))
    assert (np.isnan(result) == np.isnan(strain_rate)).all()
    assert result[9, 4] == np.median(strain_rate[8:10, 3:5])
    assert result[0, 0] == np.median(strain_rate[:2, :2])


@pytest.mark.parametrize("size", [(2, 3), (3, 0), (3, -1)])
def test_even_windows_are_refused(size: tuple[int, int]):
    with pytest.raises(InputError, match="odd"):
        filtered(np.zeros((5, 5)), size)
