"""Faults of a survey itself: found, and gone once mended; and what the audit says of noise that is not white."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import FAULTS
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.audit import NoiseAudit, audit, signal_growth
from solver.criticism.left_out import find_cycle_skips, find_faded_channels
from solver.criticism.repairs import SEARCHES, certain, find_unseen_vehicle, mended
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.signal_path.traffic import Traffic


@pytest.fixture(scope="module")
def survey() -> Problem:
    """A survey at 20 dB with white noise and nothing wrong, and some quiet after it."""
    problem = trial_survey()[0].problem
    level = float(np.sqrt(np.nanmean(problem.record**2))) / 10
    record = np.pad(problem.record, ((0, 100), (0, 0)))
    record = record + level * np.random.default_rng(3).normal(size=record.shape)
    return replace(problem, record=record, noise=torch.full_like(problem.noise, level))


def fitted(problem: Problem) -> tuple[MapFit, State]:
    """A fit of a survey, and where it ends."""
    fit = MapFit(problem)
    return fit, solve(fit, fit.start()).state


def misfit(fit: MapFit, state: State) -> float:
    """Mean square of what is left of the measured samples, noise variances."""
    return float(fit.residual(state).square().sum() / fit.measured.sum())


def test_every_fault_of_the_catalogue_is_searched_for() -> None:
    assert set(SEARCHES) == set(FAULTS)


def test_a_sound_survey_has_no_fault(survey: Problem) -> None:
    fit, state = fitted(survey)
    assert find_faded_channels(fit, state) is None
    assert find_cycle_skips(fit, state) is None


def test_channels_that_record_nothing_are_found_named_and_left_out(survey: Problem) -> None:
    dead = survey.channel[[7, 20]]
    record = survey.record.copy()
    noise = np.random.default_rng(4).normal(size=(len(record), 2)) * float(survey.noise[0])
    record[:, np.isin(survey.channel, dead)] = noise
    fit, state = fitted(replace(survey, record=record))
    fault = find_faded_channels(fit, state)
    assert fault is not None
    assert f"({dead[0]}, {dead[1]})" in fault.words
    assert fault.estimate == pytest.approx(2 / len(survey.channel))
    new, end = mended(fit, state, fault)
    assert find_faded_channels(new, end.state) is None
    assert np.isnan(new.problem.record[:, np.isin(survey.channel, dead)]).all()
    # What the two did not hear is no longer misfit of the others: it comes down to the noise.
    assert misfit(fit, state) > 1.5
    assert misfit(new, end.state) == pytest.approx(1, abs=0.1)


def test_channels_that_record_something_else_are_not_faded(survey: Problem) -> None:
    """Samples of sharp wheels, too few a second, had kept every second channel out of step with point loads."""
    other = np.isin(survey.channel, survey.channel[[7, 20]])
    record = survey.record.copy()
    slope = np.gradient(record[:, other], axis=0)
    record[:, other] = slope * np.sqrt(np.mean(record[:, other] ** 2, 0) / np.mean(slope**2, 0))
    fit, state = fitted(replace(survey, record=record))
    assert find_faded_channels(fit, state) is None


def test_channels_that_record_something_else_are_not_faded_where_others_are_as_quiet(survey: Problem) -> None:
    """What sharp wheels leave in samples too few varies from channel to channel: 1024 of the blind trials."""
    place = np.arange(len(survey.channel))
    record = survey.record.copy()
    other = place == 13
    slope = np.gradient(record[:, other], axis=0)
    record[:, other] = slope * np.sqrt(np.mean(record[:, other] ** 2, 0) / np.mean(slope**2, 0))
    record *= np.where(place % 4 == 1, 0.55, 1.0)
    fit, state = fitted(replace(survey, record=record))
    assert find_faded_channels(fit, state) is None
    # One as quiet as that which hears nothing at all is.
    record[:, 13] = np.random.default_rng(5).normal(size=len(record)) * float(survey.noise[0])
    fault = find_faded_channels(*fitted(replace(survey, record=record)))
    assert fault is not None
    assert f"({survey.channel[13]})" in fault.words


def test_a_gain_that_changes_smoothly_is_not_fading(survey: Problem) -> None:
    gain = np.exp(np.cos(np.linspace(0, np.pi, len(survey.channel))))
    fit, state = fitted(replace(survey, record=survey.record * gain))
    assert find_faded_channels(fit, state) is None


def test_an_unseen_vehicle_is_found_at_its_own_speed(survey: Problem) -> None:
    missing, *known = survey.passes
    fit, state = fitted(replace(survey, passes=known, traffic=Traffic.of(known, survey.traffic.samples)))
    fault = find_unseen_vehicle(fit, state)
    assert fault is not None
    assert fault.fall > 100
    new, end = mended(fit, state, fault)
    assert new.problem.passes[-1].speed == pytest.approx(missing.speed, rel=0.05)
    assert misfit(new, end.state) < 0.7 * misfit(fit, state)


def test_samples_count_as_far_as_they_are_measured_and_tracks_certain_there(survey: Problem) -> None:
    """What a vehicle leaves that slowed down out of view is no other vehicle."""
    one, *rest = survey.passes
    late = np.arange(len(one.rows)) > 0.6 * len(one.rows)
    vague = replace(one, sigma=np.where(late[:, None], 2.0, one.sigma), in_view=~late)
    record = survey.record.copy()
    record[-30:, 5] = np.nan
    traffic = Traffic.of([vague, *rest], survey.traffic.samples)
    fit, state = fitted(replace(survey, record=record, passes=[vague, *rest], traffic=traffic))
    counts = certain(fit, state)
    assert (counts[-30:, 5] == 0).all() and (counts[-30:, :5] == 1).all()
    heard = np.abs(fit.model(state).numpy()) > 5 * survey.noise.numpy()
    loud = np.zeros_like(counts, bool)
    loud[fit.problem.traffic.samples] = heard
    out_of_view = loud & np.isin(np.arange(len(record)), one.rows[late])[:, None]
    assert np.median(counts[out_of_view]) < 0.2 < 0.9 < np.median(counts[loud & ~out_of_view])


def audited(problem: Problem, record: np.ndarray) -> NoiseAudit:
    """The audit of a record, with the fit of the sound survey."""
    fit, state = fitted(problem)
    at = replace(problem, record=record)
    return audit(at, MapFit(at).residual(state).numpy(), (fit.model(state) / problem.noise).numpy())


@pytest.mark.parametrize(("power", "growth", "loud"), [(0.0, 0.0, 1.0), (0.5, 0.01, None), (-0.5, 0.0, None)])
def test_noise_that_grows_or_shrinks_with_the_signal_is_seen(power: float, growth: float, loud: float | None) -> None:
    rng = np.random.default_rng(6)
    channel = np.arange(60)
    model = 10 * np.exp(-((np.linspace(-3, 3, 400)[:, None] - rng.uniform(-1, 1)) ** 2)) * np.cos(channel / 9)
    noise = rng.normal(size=model.shape) * (1 + 0.01 * model**2) ** power
    found, ratio = signal_growth(noise, model, np.ones(model.shape, bool), channel, np.ones(60))
    assert found == pytest.approx(growth, rel=0.3)
    assert ratio == loud if loud else np.sign(ratio - 1) == np.sign(power)


def test_noise_that_neighbors_share_is_not_white_noise(survey: Problem) -> None:
    noise = np.random.default_rng(5).normal(size=(survey.record.shape[0], survey.record.shape[1] + 2))
    level = float(survey.noise[0])
    shared = level / np.sqrt(3) * (noise[:, :-2] + noise[:, 1:-1] + noise[:, 2:])
    found = audited(survey, shared)
    assert found.nearby > 0.5
    assert any("neighboring channels" in fault for fault in found.faults)
