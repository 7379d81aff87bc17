"""What an inexact law adds to the corridor of a run that has its effect."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism import law_tolerance
from solver.criticism.law_tolerance import law_error, law_errors, signal_of
from solver.criticism.policy import POLICY
from solver.criticism.scorer import Scorer
from solver.fit.map_fit import MapFit

GAUGE = built_in()["gauge_length"]


@pytest.fixture(scope="module")
def scorer(case) -> Scorer:
    """At a start where gauges are a tenth longer than told."""
    fit = MapFit(replace(case.problem, effects=(GAUGE,)))
    start = fit.start()
    return Scorer(fit, replace(start, numbers=torch.full_like(start.numbers, 0.1)))


def test_an_effect_at_its_null_has_no_law_to_be_off(scorer):
    start = replace(scorer.state, numbers=torch.zeros_like(scorer.state.numbers))
    still = Scorer(scorer.fit, start)
    assert not signal_of(still, GAUGE).any()
    np.testing.assert_allclose(law_errors(still)["gauge_length"], 0.0, atol=1e-20)


def test_what_a_law_may_be_off_by_is_a_covariance_that_grows_with_the_tolerance(scorer, monkeypatch):
    signal = signal_of(scorer, GAUGE)
    found = law_error(scorer, signal)
    assert found.shape == (len(scorer.fit.problem.channel), 3, 3)
    assert (np.linalg.eigvalsh(found) > -1e-12).all() and found[:, 1, 1].max() > 0
    monkeypatch.setattr(law_tolerance, "POLICY", replace(POLICY, tolerance=1e-4))
    assert 0 < law_error(scorer, signal)[:, 1, 1].max() < 1e-2 * found[:, 1, 1].max()


def test_a_law_that_the_record_tells_nothing_of_moves_the_route_by_its_tolerance(scorer, monkeypatch):
    """Of one smooth function along the fiber: tolerance times what the fit follows it by, if noise drowns the rest."""
    signal = signal_of(scorer, GAUGE)
    monkeypatch.setattr(scorer, "variance", 1e12)
    along = scorer.fit.extension.scopes.fiber
    columns = scorer.whitened(signal * along.T[:, None, :])
    each = [
        law_tolerance.moved_by(scorer, change) for change in scorer.led(columns, torch.eye(along.shape[1]).double()).T
    ]
    expected = POLICY.tolerance**2 * sum(move[:, :, None] * move[:, None, :] for move in each)
    np.testing.assert_allclose(law_error(scorer, signal), expected, rtol=1e-3, atol=1e-12)
