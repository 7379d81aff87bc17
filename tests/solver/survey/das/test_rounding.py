"""The step that stored numbers were rounded to, and the noise of what was rounded."""

import numpy as np
import pytest

from solver.noise.quiet_windows import noise_level, rounded_level
from solver.noise.whitening import noise_law
from solver.survey.das.rounding import Rounding, dithered, rounding_of, step_of, steps_of
from solver.survey.das.units import Unit

NOISE = np.random.default_rng(1).normal(0, 1.0, (1500, 6))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("step", [0.03, 0.4, 1.0])
def test_the_step_of_rounded_values_is_seen(step: float, kind: type) -> None:
    values = (1e-8 * step * np.rint(NOISE[:, 0] / step)).astype(kind)
    assert step_of(values) == pytest.approx(1e-8 * step, rel=1e-4)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_values_that_were_not_rounded_have_none(kind: type) -> None:
    assert step_of((1e-8 * NOISE[:, 0]).astype(kind)) == 0.0
    assert rounding_of(1e-8 * NOISE.astype(kind), Unit("strain_rate"), 5.0, 10.0) is None


def test_quiet_beside_loud_vehicles_is_not_rounding() -> None:
    loud = NOISE[:, 0] * np.where(np.arange(1500) % 40 < 3, 300.0, 1.0)
    assert step_of(loud) == 0.0
    assert step_of(2.0 * np.rint(loud / 2.0)) == pytest.approx(2.0)


def test_some_values_between_the_steps_do_not_hide_it() -> None:
    values = np.rint(NOISE[:, 0] / 0.2) * 0.2
    values[::30] += 0.07
    assert step_of(values) == pytest.approx(0.2, rel=1e-3)


def test_a_channel_too_quiet_to_tell_has_the_step_of_the_others() -> None:
    values = np.rint(NOISE * np.array([4, 4, 4, 4, 0.3, 4]))
    assert steps_of(values).tolist() == pytest.approx([1.0] * 6)


def test_counts_that_are_strain_leave_an_error_that_is_not_white() -> None:
    strain = np.rint(5 * NOISE)
    found = rounding_of(strain, Unit("strain", 1e-9), 5.0, 10.0)
    assert found is not None and not found.whole
    from solver.survey.das.units import time_derivative

    error = time_derivative(1e-9 * np.random.default_rng(2).uniform(-0.5, 0.5, (40000, 1)), 5.0)[:, 0]
    assert found.deviation[0] == pytest.approx(error.std(), rel=0.03)
    lags = [float(np.mean(error[lag:] * error[: len(error) - lag]) / error.var()) for lag in range(4)]
    assert found.law[:4] == pytest.approx(lags, abs=0.03)


@pytest.mark.parametrize("step", [0.3, 1.2, 1.5, 2.0, 4.0])
def test_the_level_of_rounded_noise_is_that_of_noise_and_error(step: float) -> None:
    """The median alone was 0 from 1.35 on, and 1.48 steps just below."""
    values = step * np.rint(NOISE / step)
    still, rounding = np.ones(NOISE.shape, bool), Rounding(np.full(6, step), np.ones(1))
    level = rounded_level(noise_level(values, still), values, still, rounding)
    assert level == pytest.approx(np.hypot(1.0, step / np.sqrt(12)), rel=0.12)


def test_quiet_that_is_rounded_away_counts_as_noise_beside_vehicles() -> None:
    """The law of a few single steps was that of noise a tenth as loud."""
    values = 5.0 * np.rint(NOISE / 5.0)
    still, rounding = np.ones(NOISE.shape, bool), Rounding(np.full(6, 5.0), np.ones(1))
    level = rounded_level(noise_level(values, still), values, still, rounding)
    error = float(np.median(rounding.deviation / level)) ** 2 * rounding.law
    assert noise_law(values / level, still, 5.0, 1.0, error).own[0] > 0.7


def test_only_coarse_steps_are_spread() -> None:
    coarse, fine = np.rint(NOISE / 2.0) * 2.0, np.rint(NOISE / 0.01) * 0.01
    assert np.median(np.abs(dithered(coarse, Rounding(np.full(6, 2.0), np.ones(1))))) > 0.3
    assert dithered(fine, Rounding(np.full(6, 0.01), np.ones(1))) == pytest.approx(fine)
    assert dithered(fine, None) is fine
