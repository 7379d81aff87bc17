"""Whether passes that were not fitted are explained better with an effect than without."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import case_of

from solver.catalogue.catalogue import built_in
from solver.criticism.growth import fitted_with
from solver.fit.held_out import held_out
from solver.fit.held_out_gain import HeldOutGain, held_out_gain
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.state import State
from solver.simulator import Scenario, simulate


def ended(problem: Problem) -> tuple[MapFit, State]:
    fit = MapFit(problem)
    return fit, solve(fit, fit.start()).state


def with_effect(problem: Problem, name: str) -> Problem:
    return replace(problem, effects=(built_in()[name],))


def test_what_an_effect_that_is_there_changes_it_gains(street) -> None:
    wrong = case_of(street, gauge_length=12.5).problem
    gain = held_out_gain(ended(wrong), ended(with_effect(wrong, "gauge_length")))
    assert gain is not None and gain.per_dof > 0.1
    assert gain.fall + gain.blurred == pytest.approx(gain.change, abs=4 * 2 * np.sqrt(gain.change))
    assert not gain.refuses(1.0)
    back = HeldOutGain(-gain.fall, gain.freedom, -gain.blurred, gain.blur, gain.change)
    assert back.refuses(1.0), "to take it out again is refused"


def test_an_effect_that_no_group_of_passes_shows_gains_nothing_and_is_not_refused(case) -> None:
    assert held_out_gain(ended(case.problem), ended(with_effect(case.problem, "saturation"))) is None


def test_one_pass_alone_holds_nothing_out() -> None:
    alone = case_of(simulate(Scenario(seed=3, passes=1, snr_db=25.0))).problem
    assert held_out_gain(ended(alone), ended(with_effect(alone, "gauge_length"))) is None


def test_only_passes_that_clip_and_were_fitted_speak_for_those_that_do_too() -> None:
    """Half of the groups here has the one vehicle that clips; the other cannot know of it."""
    seen = simulate(Scenario(seed=7, passes=6, snr_db=20.0, effects={"saturation": 0.5}))
    problem = case_of(seen).problem
    gain = held_out_gain(ended(problem), ended(with_effect(problem, "saturation")))
    every = held_out(problem)
    assert every is not None and gain is not None
    assert gain.freedom < 0.7 * every.freedom and not gain.refuses(1.0)


def test_passes_without_a_long_vehicle_say_nothing_of_how_long_one_is() -> None:
    """One vehicle of three is long. Fitted to the others its length is anything: held out it would be wrong."""
    seen = simulate(Scenario(seed=8, passes=3, snr_db=25.0, effects={"long_vehicle": 16.0}))
    problem = case_of(seen).problem
    fit, state = ended(problem)
    refit = fitted_with(fit, state, built_in()["long_vehicle"], lambda n: None)
    gain, every = held_out_gain((fit, state), (refit.fit, refit.solution.state)), held_out(problem)
    assert refit.estimate.round(1).tolist() == [1.0, 0.0, 0.0]
    assert every is not None and gain is not None
    assert gain.freedom < 0.7 * every.freedom and gain.fall > 0 and not gain.refuses(1.0)
