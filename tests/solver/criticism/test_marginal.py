"""Marginal likelihoods against numerical integration and against densities of the whole residual."""

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from solver.criticism.marginal import Spectrum, fault_evidence, mixture
from solver.criticism.policy import POLICY

RNG = np.random.default_rng(4)


def ratio(residual: np.ndarray, whole: np.ndarray, without: np.ndarray) -> float:
    """Ln of how much more probable a residual is by one covariance than by another."""
    return float(multivariate_normal(cov=whole).logpdf(residual) - multivariate_normal(cov=without).logpdf(residual))


@pytest.mark.parametrize("variance", [1.0, 7.0])
def test_the_evidence_is_the_ratio_of_densities_of_the_residual(variance):
    columns, residual = RNG.normal(size=(40, 3)), RNG.normal(size=40) + 2.0
    size = np.array([0.5, 3.0, 1e-3])
    left = Spectrum.of(
        torch.from_numpy(columns.T @ columns), torch.from_numpy(columns.T @ residual), torch.from_numpy(size)
    )
    noise = variance * np.eye(40)
    spread = (columns * size) @ (columns * size).T
    scales = (1.0, POLICY.negligible)  # squared
    expected = mixture([ratio(residual, noise + scale * spread, noise) for scale in scales])
    assert left.evidence(variance) == pytest.approx(expected, rel=1e-8)


def test_the_evidence_of_one_number_is_that_of_integrating_over_its_prior():
    information, along, variance = 4.0, 10.0, 2.0
    size = np.linspace(-12, 12, 100_001)
    likelihood = np.exp((along * size - information * size**2 / 2) / variance)
    whole = np.trapezoid(likelihood * np.exp(-(size**2) / 2) / np.sqrt(2 * np.pi), size)
    found = Spectrum(np.array([information]), np.array([along**2])).evidence(variance)
    assert found == pytest.approx(np.log(whole), abs=1e-6)


def test_a_tolerated_discrepancy_is_as_large_in_each_direction_that_leaves_a_trace():
    columns, residual, off = RNG.normal(size=(30, 2)), 3 * RNG.normal(size=30), 25.0
    with_none = np.column_stack([columns, np.zeros(30)])
    one = torch.ones(3, dtype=torch.float64)
    left = Spectrum.of(torch.from_numpy(with_none.T @ with_none), torch.from_numpy(with_none.T @ residual), one)
    basis = np.linalg.qr(columns)[0]
    noise = np.eye(30) * 1.5
    expected = ratio(residual, noise + off * basis @ basis.T, noise)
    assert left.tolerated(1.5, off) == pytest.approx(expected, rel=1e-8)
    assert left.tolerated(1.5, 0.0) == 0.0


def test_what_a_law_may_be_off_by_shows_as_nothing_and_what_is_more_shows():
    """Of an effect of chi2 10,000 and a law off by 3 %: 9 sigmas squared in each direction are its own error."""
    off = 0.03**2 * 10_000
    own, more = (Spectrum(np.full(6, 1e3), np.full(6, 1e3 * left / 6)) for left in (54.0, 2000.0))
    assert own.evidence(1.0 + off) < 0 < own.evidence(1.0)
    assert more.evidence(1.0 + off) > 60


def test_a_mixture_is_a_mean_and_never_better_than_its_best():
    logs = [3.0, -2.0, 800.0]
    assert mixture(logs) == pytest.approx(800 - np.log(3))
    assert mixture([]) == 0.0


def test_a_fault_pays_for_its_numbers_and_for_where_it_was_looked_for():
    assert fault_evidence(400.0, 1, 1) > fault_evidence(400.0, 4, 1) > fault_evidence(400.0, 4, 100) > 100
    assert fault_evidence(400.0, 4, 100) == pytest.approx(fault_evidence(400.0, 4, 1) - np.log(100))
