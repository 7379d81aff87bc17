"""What single bad samples do to a fit: they pull no harder than noise of the record's own size."""

import numpy as np
import pytest
import torch

from solver.fit.robust import HUBER, huber, near_noise, scale_of, solved_amplitudes


def test_the_scale_is_the_noise_s_though_some_samples_are_bad() -> None:
    """Samples that err wildly, one in twenty, raise the median of Gaussian noise by a few percent."""
    residual = torch.from_numpy(3.0 * np.random.default_rng(1).normal(size=20_000))
    there = torch.ones_like(residual, dtype=torch.bool)
    assert float(scale_of(residual, there)) == pytest.approx(3.0, rel=0.03)
    residual[::20] = 1e6
    assert float(scale_of(residual, there)) == pytest.approx(3.0, rel=0.1)
    # A model that explains more than noise leaves is not believed more than the noise that was measured.
    assert float(scale_of(residual / 10, there)) == 1.0


@pytest.mark.parametrize("noise", [1.0, 5.0])
def test_no_sample_pulls_harder_than_so_many_sigmas_of_the_record_s_own_noise(noise: float) -> None:
    residual = torch.from_numpy(noise * np.random.default_rng(2).normal(size=5000))
    residual[:10] = noise * torch.linspace(10, 1000, 10, dtype=torch.float64)
    weight = huber(residual, torch.ones_like(residual, dtype=torch.bool))
    np.testing.assert_allclose(weight[:10] * residual[:10], HUBER * noise, rtol=0.05)
    assert float((weight[10:] == 1).double().mean()) > 0.999
    good = near_noise(residual, scale_of(residual, torch.ones_like(residual, dtype=torch.bool)))
    assert not bool(good[:10].any()) and bool(good[10:].all()), "spikes are so by the record's own noise"


def test_amplitudes_are_least_squares_and_that_of_a_vehicle_that_no_channel_records_is_none() -> None:
    columns, true = np.random.default_rng(3).normal(size=(50, 3)), np.array([2.0, -1.0, 7.0])
    columns[:, 2] = 0.0
    matrix, right = torch.from_numpy(columns.T @ columns), torch.from_numpy(columns.T @ (columns @ true))
    np.testing.assert_allclose(solved_amplitudes(matrix, right), [2.0, -1.0, 0.0], atol=1e-9)
