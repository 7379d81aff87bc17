"""Whitening of noise that another generator made: colored in time, shared by all channels, overlapping gauges."""

import tracemalloc

import numpy as np
import pytest
import torch
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from solver.noise.law import NoiseLaw
from solver.noise.quiet_windows import noise_level
from solver.noise.sample_runs import blocks_of
from solver.noise.whitening import Whitener, noise_law, positive

SAMPLES, CHANNELS = 6000, 24


def colored(rng: np.random.Generator, *shape: int, pole: float) -> np.ndarray:
    """AR(1) noise of unit variance along the first axis."""
    start = rng.normal(size=(1, *shape[1:]))
    white = np.sqrt(1 - pole**2) * rng.normal(size=shape)
    return lfilter([1.0], [1.0, -pole], white, axis=0, zi=pole * start)[0]


def street_noise(seed: int = 0, common: float = 0.6, smooth: int = 1) -> np.ndarray:
    """[sample, channel]: red noise of each channel (mean over `smooth` neighbors) and a redder common mode."""
    rng = np.random.default_rng(seed)
    wide = colored(rng, SAMPLES, CHANNELS + smooth - 1, pole=0.5)
    own = sum(wide[:, k : k + CHANNELS] for k in range(smooth)) / np.sqrt(smooth)
    return own + common * colored(rng, SAMPLES, 1, pole=0.8)


def law_of(noise: np.ndarray) -> NoiseLaw:
    return noise_law(noise, np.ones(noise.shape, bool), sampling_rate=5.0)


def whiten(noise: np.ndarray, law: NoiseLaw, samples: np.ndarray | None = None) -> np.ndarray:
    level, channel = torch.ones(noise.shape[1], dtype=torch.float64), np.arange(noise.shape[1])
    at = np.arange(len(noise)) if samples is None else samples
    return Whitener(level, at, channel, law)(torch.from_numpy(noise)).numpy()


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float((one * other).mean() / np.sqrt((one**2).mean() * (other**2).mean()))


@pytest.mark.parametrize(("gauge", "channels"), [(10, 120), (40, 400)])
def test_noise_of_overlapping_gauges_becomes_white(gauge, channels):
    # An interrogator reads phases and takes their difference over a gauge: channels a gauge apart share one phase.
    phase = np.random.default_rng(2).normal(size=(1200, channels + gauge))
    noise = (phase[:, gauge:] - phase[:, :-gauge]) / np.sqrt(2)
    law = noise_law(noise[:600], np.ones((600, channels), bool), 5.0, gauge)
    assert law.across[gauge] == pytest.approx(-0.5, abs=0.03)
    white = whiten(noise[600:], law)
    assert float((white**2).mean()) == pytest.approx(1, abs=0.08)
    assert max(abs(correlation(white[:, lag:], white[:, :-lag])) for lag in range(1, 2 * gauge + 5)) < 0.1


def test_the_nearest_autocovariance_is_one():
    """What no noise can have (its spectrum is negative) becomes what noise can have."""
    spoiled = np.array([1.0, 0.9, 0.2, -0.6, -0.2, 0.0, 0.0, 0.0])
    assert np.linalg.eigvalsh(toeplitz(spoiled)).min() < 0 < np.linalg.eigvalsh(toeplitz(positive(spoiled))).min()


def test_the_law_of_known_noise_is_found():
    law = law_of(street_noise())
    assert law.common_share == pytest.approx(0.36 / 1.36, abs=0.04)
    np.testing.assert_allclose(law.own[:4], 0.5 ** np.arange(4), atol=0.05)
    np.testing.assert_allclose(law.common[:4], 0.36 * 0.8 ** np.arange(4), atol=0.08)
    assert law.across.tolist() == [1.0]


def test_what_neighbors_share_is_not_taken_for_a_common_mode():
    law = law_of(street_noise(seed=1, smooth=5))
    assert law.common_share == pytest.approx(0.36 / 1.36, abs=0.04)
    np.testing.assert_allclose(law.across[:6], 1 - np.arange(6) / 5, atol=0.03)


@pytest.mark.parametrize("smooth", [1, 5])
def test_whitened_noise_is_white(smooth):
    law = law_of(street_noise(seed=1, smooth=smooth))
    white = whiten(street_noise(seed=2, smooth=smooth), law)
    assert white.var() == pytest.approx(1.0, abs=0.04)
    for lag in range(1, 6):
        assert abs(correlation(white[lag:], white[:-lag])) < 0.02
    between = np.corrcoef(white.T)[np.triu_indices(CHANNELS, 1)]
    assert np.abs(between.mean()) < 0.01 and np.abs(between).max() < (0.06 if smooth == 1 else 0.12)
    assert white.mean(1).var() * CHANNELS == pytest.approx(1.0, abs=0.08)


def test_every_stretch_starts_anew():
    """Samples of different passes are as white as those of one, from the first on."""
    law = law_of(street_noise(seed=3))
    samples = np.flatnonzero(np.arange(SAMPLES) % 100 < 40)
    white = whiten(street_noise(seed=4)[samples], law, samples)
    first = np.flatnonzero(samples % 100 == 0)
    assert white[first].var() == pytest.approx(1.0, abs=0.15)
    assert white[first + 1].var() == pytest.approx(1.0, abs=0.15)
    assert white.var() == pytest.approx(1.0, abs=0.04)
    assert blocks_of(samples)[:2] == [slice(0, 40), slice(40, 80)]


def test_chi_square_is_that_of_the_full_covariance():
    """|W r|^2 = r' C^-1 r with C written out in full, and |W|^2 its determinant."""
    law = NoiseLaw(0.5 ** np.arange(6), 0.3 * 0.8 ** np.arange(6), np.ones(1))
    samples, channels = 6, 4
    own = np.kron(toeplitz(law.own), np.eye(channels))
    common = np.kron(toeplitz(law.common), np.ones((channels, channels)))
    level = np.array([1.0, 2.0, 0.5, 1.5])
    scale = np.tile(level, samples)
    covariance = scale[:, None] * (own + common) * scale
    r = np.random.default_rng(5).normal(size=(samples, channels))
    whitener = Whitener(torch.from_numpy(level), np.arange(samples), np.arange(channels), law)
    white = whitener(torch.from_numpy(r)).numpy()
    assert (white**2).sum() == pytest.approx(r.ravel() @ np.linalg.solve(covariance, r.ravel()), rel=1e-9)


def test_maps_are_whitened_each_by_itself():
    law = law_of(street_noise(seed=6))
    values = torch.from_numpy(np.random.default_rng(7).normal(size=(3, 50, CHANNELS)))
    whitener = Whitener(torch.ones(CHANNELS, dtype=torch.float64), np.arange(50), np.arange(CHANNELS), law)
    torch.testing.assert_close(whitener(values)[1], whitener(values[1]))


def test_white_noise_stays_as_it_is():
    noise = np.random.default_rng(8).normal(size=(SAMPLES, CHANNELS))
    law = law_of(noise)
    assert law.common_share == 0.0 and law.across.tolist() == [1.0]
    np.testing.assert_allclose(whiten(noise, NoiseLaw.white()), noise)
    assert np.abs(whiten(noise, law) - noise).max() < 0.4


def test_vehicles_and_gaps_are_not_noise():
    noise = street_noise(seed=9)
    still = np.ones(noise.shape, bool)
    still[1000:1500] = False
    loud = noise + np.where(still, 0.0, 30.0)
    loud[3000:3100, 5] = np.nan
    law, plain = noise_law(loud, still, 5.0), law_of(noise)
    np.testing.assert_allclose(law.own[:5], plain.own[:5], atol=0.03)


def test_spikes_are_not_noise():
    """Samples 30 sds away, one in two hundred, would make the noise's variance five times as large."""
    noise = street_noise(seed=10, common=0.0)
    spiky = np.where(np.random.default_rng(12).random(noise.shape) < 0.005, 30.0, noise)
    np.testing.assert_allclose(law_of(spiky).own[:5], law_of(noise).own[:5], atol=0.03)


def test_noise_that_is_rounded_to_zero_is_as_large_as_its_level_near_vehicles():
    """Noise of 0.3 steps is mostly rounded to 0; where a vehicle lifts it, it and its rounding errors are there."""
    level = (0.3**2 + 1 / 12) ** 0.5
    record = np.rint(np.random.default_rng(11).normal(0, 0.3, (SAMPLES, CHANNELS))) / level
    rounding = np.array([1 / 12]) / level**2
    law = noise_law(record, np.ones(record.shape, bool), 5.0, rounding=rounding)
    assert record.var() < 0.6
    assert law.own[0] == pytest.approx(1.0, abs=0.02)
    assert law.hidden[0] == pytest.approx(1 - record.var(), abs=0.01)


def test_too_few_samples_tell_nothing():
    noise = street_noise()[:20, :3]
    assert noise_law(noise, np.ones(noise.shape, bool), 5.0).own.tolist() == [1.0]


def test_hours_between_two_spans_change_no_law_and_cost_no_memory():
    noise = street_noise()
    gap = np.full((40 * SAMPLES, CHANNELS), np.nan)
    apart = np.concatenate([noise[: SAMPLES // 2], gap, noise[SAMPLES // 2 :]])
    short = np.concatenate([noise[: SAMPLES // 2], gap[:200], noise[SAMPLES // 2 :]])
    still = np.ones(apart.shape, bool)
    tracemalloc.start()
    try:
        law, level = noise_law(apart, still, sampling_rate=5.0), noise_level(apart, still)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    wanted = law_of(short)
    assert np.allclose(law.own, wanted.own, rtol=1e-12)
    assert np.allclose(law.common, wanted.common, rtol=1e-12)
    assert np.allclose(level, noise_level(noise, np.ones(noise.shape, bool)), rtol=1e-12)
    assert peak < 0.6 * apart.nbytes
