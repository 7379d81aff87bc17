"""Errors of tracks do not make a fiber lie deeper, however many passes there are."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import roadfiber as rf
from solver import simulator
from solver.fit.pose import LESS, MANY, UNCERTAIN, with_slow_errors
from solver.trajectory.vehicle_pass import track_sigma


def test_a_fiber_under_many_tracks_is_as_deep_as_it_is(tmp_path: Path) -> None:
    """By 2.4 sigmas too deep, and Poisson's ratio 2.5 too small, where tracks count as they are."""
    scenario = simulator.Scenario(seed=22, passes=60, snr_db=18.0, track_noise="camera", view=(0.0, 40.0), channels=121)
    made = simulator.simulate(scenario)
    run = rf.locate(simulator.write_survey(made, tmp_path / "survey"), all_passes=True, corridor="fit")
    result = run.result
    assert [one.slow_error for one in run.problem.effects] == [True]
    assert LESS < track_sigma(run.problem.passes) < UNCERTAIN
    here = np.isin(result.channel, np.arange(made.active[0], made.active[1] + 1))
    error = result.route[here, 2] - made.route[result.channel[here], 2]
    assert np.sqrt(((error / result.sigma[here, 2]) ** 2).mean()) < 1.2
    ratio = result.parameters["poisson_ratio"]
    assert abs(ratio.value - 0.25) < 1.5 * ratio.sigma
    few = replace(run.problem, effects=(), passes=run.problem.passes[: MANY - 1])
    assert with_slow_errors(few) is few
