"""Power of the residual: sums by property, and the periodogram's normalization."""

from types import SimpleNamespace

import numpy as np
import pytest

from solver.criticism.comparison.power import FEWEST, of_pass, periodogram, powers, present

RNG = np.random.default_rng(7)


def cells(residual: np.ndarray, there: np.ndarray | None = None) -> SimpleNamespace:
    return SimpleNamespace(
        residual=residual, there=np.ones(residual.shape, bool) if there is None else there, floor=1.0, spread=1.0
    )


def test_chi2_per_sample_is_the_mean_square_of_each_value():
    residual = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    index = np.array([[0, 1, 1], [0, -1, 2]])
    there = np.array([[True, True, True], [False, True, True]])
    found = powers(cells(residual, there), index, ["a", "b", "c", "none"])
    np.testing.assert_allclose(found.chi2, [1.0, 6.5, 36.0, np.nan])
    assert found.samples.tolist() == [1, 2, 1, 0]
    np.testing.assert_allclose(found.sigma, [2**0.5, 1.0, 2**0.5, np.nan])


def test_values_of_hardly_any_sample_are_left_out():
    index = np.zeros((FEWEST, 3), int)
    index[:, 1], index[:, 2] = 1, -1
    index[0, 1] = 2
    found = present(cells(np.ones(index.shape)), index, ["many", "fewer", "one"])
    assert found.labels == ["many"] and found.samples.tolist() == [FEWEST]


def test_values_of_passes_are_spread_over_their_cells():
    approach = SimpleNamespace(owner=np.array([[0, 1], [1, -1]]))
    near = np.array([[True, True], [False, False]])
    assert of_pass(approach, near, np.array([5, 7])).tolist() == [[5, 7], [-1, -1]]


@pytest.mark.parametrize("shape", [(40, 30), (200, 90), (9, 5)])
def test_of_white_noise_every_cell_has_its_weight(shape):
    total, weight = 0.0, 0.0
    for _ in range(100_000 // (shape[0] * shape[1])):
        noise = RNG.normal(size=shape)
        power, norm = periodogram(noise, np.ones(shape, bool), 32, 24)
        total, weight = total + power, weight + norm
    assert (total / weight).mean() == pytest.approx(1.0, abs=0.04)


def test_a_wave_stands_at_its_frequency_and_wavenumber():
    t, s = np.arange(128)[:, None], np.arange(48)
    wave = np.cos(2 * np.pi * (5 / 32 * t - 3 / 24 * s))
    power, _ = periodogram(wave, np.ones(wave.shape, bool), 32, 24)
    at = np.unravel_index(power.argmax(), power.shape)
    assert at in ((5, 21), (27, 3))


def test_what_was_not_measured_adds_nothing():
    values, there = RNG.normal(size=(64, 24)), np.ones((64, 24), bool)
    there[:, 10:] = False
    changed = np.where(there, values, 1e6)
    one, weight = periodogram(values, there, 32, 24)
    other, same = periodogram(changed, there, 32, 24)
    np.testing.assert_allclose(one, other)
    assert weight == same < periodogram(values, np.ones_like(there), 32, 24)[1]
