"""What the score test says where nothing is missing, or only what the tracks themselves own up to."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.criticism.score import FOUND, Scorer
from solver.effects.catalogue import built_in
from solver.effects.trial_survey import trial_survey
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit


def off_by(size: float, sigma: float):
    """A survey whose tracks, told to be off by `sigma`, are off by `size` slowly, m; and where its fit ends."""
    problem = trial_survey()[0].problem
    rng = np.random.default_rng(3)
    passes, first = [], 0
    position = problem.traffic.position.clone()
    for one in problem.passes:
        rows = len(one.rows)
        phase, t = rng.uniform(0, 2 * np.pi), np.arange(rows) / problem.sampling_rate
        error = size * np.sqrt(2) * np.sin(2 * np.pi * t / 4 + phase)
        position[first : first + rows, 0] += torch.from_numpy(error)
        passes.append(replace(one, sigma=np.full((rows, 2), sigma)))
        first += rows
    traffic = replace(problem.traffic, position=position)
    level = float(np.sqrt(np.nanmean(problem.record**2))) / 30
    record = problem.record + level * rng.normal(size=problem.record.shape)
    moved = replace(problem, passes=passes, traffic=traffic, record=record, noise=torch.full_like(problem.noise, level))
    fit = MapFit(moved)
    return fit, solve(fit, fit.start()).state


@pytest.mark.parametrize("name", ["track_jitter", "generic_gain", "generic_load"])
def test_what_tracks_may_be_off_by_their_own_account_is_no_effect(name):
    scores = {
        sigma: max(s.evidence for s in Scorer(*off_by(0.04, sigma)).scores(built_in()[name])) for sigma in (0.001, 0.08)
    }
    assert scores[0.08] < FOUND
    if name == "track_jitter":
        assert scores[0.001] > scores[0.08]


def test_tracks_off_by_more_than_they_say_are_found():
    found = max(Scorer(*off_by(0.4, 0.03)).scores(built_in()["track_jitter"]), key=lambda s: s.evidence)
    assert found.evidence > FOUND
