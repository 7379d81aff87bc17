"""How sharply a fit with a candidate ends."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.ending import Ending, normal_matrix
from solver.criticism.refit import with_effect
from solver.criticism.scorer import Scorer
from solver.criticism.sums import factor_of, load_cost, sharpness
from solver.effect import Parameter, Surroundings, effect
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.interrogator.interrogator import Interrogator

KNOWN = built_in()


@pytest.fixture(scope="module")
def record():
    """The survey of all classes, with noise of a hundredth of what it is at its loudest."""
    fit, state = trial_survey()
    level = 0.01 * float(np.abs(fit.problem.record).max())
    noise = level * np.random.default_rng(4).normal(size=fit.problem.record.shape)
    problem = replace(fit.problem, record=fit.problem.record + noise, noise=torch.full_like(fit.problem.noise, level))
    return problem, state


def begun(record, name):
    """A fit with an effect in the model, and a look at where it begins."""
    problem, state = record
    fit = MapFit(with_effect(problem, KNOWN[name]))
    numbers = fit.extension.numbers({})
    chain = Chain.single(fit)
    return fit, chain, chain.visit(replace(state, numbers=numbers))


@pytest.mark.parametrize("name", ["gauge_length", "channel_coupling", "dynamic_load", "layered_ground"])
def test_it_leaves_what_the_whole_covariance_says(record, name):
    """Data alone, in plausible sizes: the inverse of the posterior covariance, less the prior; the shape is held."""
    fit, chain, visit = begun(record, name)
    told = Ending.of(fit, visit, KNOWN[name]).spectrum
    slots = fit.extension.slots
    matrix, place = normal_matrix(chain, visit)
    rows = place[chain.layout["numbers"].start + np.arange(len(visit.state.numbers))]
    precision = np.linalg.inv(np.linalg.inv(matrix)[np.ix_(rows, rows)])
    size = np.concatenate([np.full(s.where.stop - s.where.start, s.parameter.plausible) for s in slots])
    mine = np.concatenate([np.full(s.where.stop - s.where.start, not s.parameter.is_shape) for s in slots])
    left = (precision * size[:, None] * size)[np.ix_(mine, mine)] - np.eye(mine.sum())
    np.testing.assert_allclose(told.information, np.linalg.eigvalsh(left).clip(0), rtol=1e-6, atol=1e-6)


def test_all_else_and_the_candidate_are_the_whole(record):
    fit, _, visit = begun(record, "channel_coupling")
    end = Ending.of(fit, visit, KNOWN["channel_coupling"])
    p = KNOWN["channel_coupling"].amplitudes[0]
    whole = np.linalg.slogdet(visit.normal.dense()[0])[1] / 2 + load_cost(visit.state.vehicles.amplitude)
    size = len(end.spectrum.information) * np.log(p.plausible)
    assert end.sharpness + np.log1p(end.spectrum.information).sum() / 2 - size == pytest.approx(whole, abs=1e-6)


def test_what_changes_nothing_leaves_all_else_as_sharp(record):
    """At null, all else ends as it did without the candidate: the score test's own normal matrix says the same."""
    problem, state = record
    fit, _, visit = begun(record, "clock_offset")
    without = Scorer(MapFit(problem), state)
    assert Ending.of(fit, visit, KNOWN["clock_offset"]).sharpness == pytest.approx(without.sharpness, abs=1e-6)
    assert sharpness(factor_of(torch.eye(5, dtype=torch.float64))) == pytest.approx(0.0, abs=1e-9)


@effect("dull", "interrogator", [Parameter("gain", "1", 1.0, null=1.0)], physics="Less output.", source="A test.")
def dull(interrogator: Interrogator, p: dict[str, Any], survey: Surroundings) -> Interrogator:
    return replace(interrogator, gain=interrogator.gain * p["gain"])


def test_a_law_that_makes_less_of_a_load_is_none_the_more_probable(record):
    """Loads ten times as large of a tenth of the output are the same model."""
    problem, state = record
    fit = MapFit(with_effect(problem, dull))
    chain, ends = Chain.single(fit), []
    for gain in (1.0, 0.1):
        vehicles = replace(state.vehicles, amplitude=state.vehicles.amplitude / gain)
        visit = chain.visit(replace(state, vehicles=vehicles, numbers=torch.tensor([gain], dtype=torch.float64)))
        ends.append((visit, Ending.of(fit, visit, dull).sharpness))
    (one, sharp), (ten, as_sharp) = ends
    torch.testing.assert_close(ten.models, one.models)
    assert as_sharp == pytest.approx(sharp, abs=1e-6)


def test_numbers_that_ended_at_their_prior_of_one_size_come_from_that_score(record):
    """The score U of numbers n that were fitted: (I + 1) n."""
    fit, chain, visit = begun(record, "channel_coupling")
    numbers = torch.from_numpy(np.random.default_rng(0).normal(size=len(visit.state.numbers)))
    p = KNOWN["channel_coupling"].amplitudes[0]
    moved = chain.visit(replace(visit.state, numbers=p.null + p.plausible * numbers))
    spectrum = Ending.of(fit, moved, KNOWN["channel_coupling"]).spectrum
    back = spectrum.along / (spectrum.information + 1) ** 2
    assert back.sum() == pytest.approx(float(numbers.square().sum()), rel=1e-4)
