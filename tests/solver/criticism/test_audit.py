"""The parts of the noise audit, on numbers whose answer is known."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.trial_survey import trial_survey
from solver.criticism.audit import audit, correlation, signal_growth, stretches
from solver.noise.law import NoiseLaw
from solver.signal_path.traffic import Traffic

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


def street(noise: np.ndarray, level: float = 1.0) -> Any:
    """The trial survey, long quiet before its vehicles, in noise that its law takes for white."""
    problem = trial_survey()[0].problem
    quiet = len(noise) - len(problem.record)
    passes = [replace(one, rows=one.rows + quiet) for one in problem.passes]
    return replace(
        problem,
        record=noise,
        noise=torch.full_like(problem.noise, level),
        passes=passes,
        traffic=Traffic.of(passes),
        law=NoiseLaw.white(),
    )


def audited(noise: np.ndarray) -> Any:
    problem = street(noise)
    residual, model = RNG.normal(size=(2, len(problem.traffic.samples), noise.shape[1]))
    return audit(problem, residual, model)


SHAPE = (2000, 24)


def test_white_noise_passes() -> None:
    found = audited(RNG.normal(size=SHAPE))
    assert found.passed and not found.leveled
    assert found.variance == pytest.approx(1.0, abs=0.03) and found.unsteady < 1.2
    assert abs(found.in_time) < 0.03 and abs(found.across) < 0.03
    assert (found.signal_noise, found.loud) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda white: 1.3 * white, "whitened noise has variance 1."),
        (lambda white: 0.8 * white + 0.6 * np.roll(white, 1, 0), "is correlated in time (+0.4"),
        (lambda white: 0.8 * white + 0.6 * white[:, :1], "is correlated between channels (+0."),
        (lambda white: white * np.where(np.arange(2000) < 500, 1.3, 0.8)[:, None], "as strong in some parts"),
    ],
)
def test_noise_that_is_not_as_told_is_a_fault_in_words(change: Any, fault: str) -> None:
    found = audited(change(RNG.normal(size=SHAPE)))
    assert not found.passed and any(fault in words for words in found.faults), found.faults


def test_too_little_quiet_says_nothing_of_the_noise() -> None:
    """And that is the fault, with what to do."""
    problem = trial_survey()[0].problem
    found = audited(RNG.normal(size=problem.record.shape))
    assert np.isnan(found.variance) and not found.passed and found.signal_noise == 0.0
    (fault,) = found.faults
    assert fault.startswith(f"only {found.samples} samples") and "record some minutes of quiet" in fault


@pytest.mark.parametrize(("growth", "loud"), [(0.0, 1.0), (0.02, None)])
def test_noise_in_proportion_to_the_signal_is_measured(growth: float, loud: float | None) -> None:
    """Its variance is 1 + growth times the signal's square, told by a high difference along the fiber."""
    model = np.cumsum(RNG.normal(size=(600, 1)), 0) * 0.3 * np.ones((1, 24))
    residual = RNG.normal(size=model.shape) * np.sqrt(1 + growth * model**2)
    channel = np.arange(24)
    found, ratio = signal_growth(residual, model, np.ones(model.shape, bool), channel, np.ones(24))
    assert found == pytest.approx(growth, rel=0.35)
    assert ratio == 1.0 if loud else ratio > 1.15


def test_channels_that_do_not_follow_one_another_say_nothing_of_growth() -> None:
    model = np.ones((600, 24)) * np.arange(600)[:, None]
    residual = RNG.normal(size=model.shape) * (1 + model)
    whole = np.ones(model.shape, bool)
    assert signal_growth(residual, model, whole, 3 * np.arange(24), np.ones(24)) == (0.0, 1.0)
    assert signal_growth(residual[:, :8], model[:, :8], whole[:, :8], np.arange(8), np.ones(8)) == (0.0, 1.0)
