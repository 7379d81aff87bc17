"""Whether passes that were not fitted are explained better with an effect than without."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch
from simulated import case_of

from solver.catalogue.catalogue import built_in
from solver.criticism.growth import fitted_with
from solver.fit.held_out import Fold, HeldOut, blur, held_out
from solver.fit.held_out_gain import HeldOutGain, held_out_gain
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.normal import Normal
from solver.fit.normal_parts import Block, Part
from solver.fit.problem import Problem
from solver.fit.state import State, Weights
from solver.simulator import Scenario, simulate

#: Draws of a sampled test: a share of 4 % scatters by half a percent.
DRAWS = 2000


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


def gains(true: np.ndarray, held_true: np.ndarray) -> list[HeldOutGain]:
    """Gains of 3 numbers that a linear model of 2 lacks, fitted to 12 samples and judged by 400.

    Parameters
    ----------
    true, held_true : [3], what the numbers are in the fitted samples, and in those held out
    """
    random = np.random.default_rng(1)
    fitted, held = random.normal(size=(12, 5)), random.normal(size=(400, 5))
    data = fitted[:, 2:] @ true + random.normal(size=(DRAWS, 12))
    unseen = held[:, 2:] @ held_true + random.normal(size=(DRAWS, 400))
    predicted, added = [], []
    for count in (2, 5):
        seen, other = fitted[:, :count], held[:, :count]
        predicted.append(data @ np.linalg.pinv(seen).T @ other.T)
        # What the fitted samples leave uncertain adds to the misfit of the others, see `held_out.blur`.
        share = other.T @ other @ np.linalg.inv(seen.T @ seen)
        added.append((np.trace(share), 2 * np.trace(share @ share) + 4 * np.trace(share)))
    fall = ((unseen - predicted[0]) ** 2).sum(1) - ((unseen - predicted[1]) ** 2).sum(1)
    change = ((predicted[0] - predicted[1]) ** 2).sum(1)
    (less, narrow), (more, wide) = added
    return [HeldOutGain(f, 400.0, more - less, wide - narrow, c) for f, c in zip(fall, change, strict=True)]


def test_an_effect_that_few_samples_leave_uncertain_is_not_refused_for_that() -> None:
    """Its numbers are 0, so that fitting them to a few samples makes the misfit of others larger by chance alone."""
    none = np.zeros(3)
    found = gains(none, none)
    assert np.mean([one.fall for one in found]) < -50, "held-out samples are explained worse with it"
    assert np.mean([one.refuses(1.0) for one in found]) < 0.08
    there = np.full(3, 2.0)
    assert not any(one.refuses(1.0) for one in gains(there, there))
    assert np.mean([one.refuses(1.0) for one in gains(there, -there)]) > 0.99, "it is another in the samples held out"


@pytest.mark.parametrize("variance", [1.0, 4.0])
def test_of_two_models_that_are_equally_wrong_the_larger_is_refused_by_chance_alone(variance: float) -> None:
    """Where the truth lies midway between two predictions chi2 differs by 2 |d| sigmas (Vuong 1989)."""
    random = np.random.default_rng(2)
    change = random.normal(size=50)
    noise = np.sqrt(variance) * random.normal(size=(DRAWS, 50))
    fall = ((noise + change / 2) ** 2).sum(1) - ((noise - change / 2) ** 2).sum(1)
    refused = [HeldOutGain(one, 50.0, 0.0, 0.0, float(change @ change)).refuses(variance) for one in fall]
    # Beyond two sigmas to one side lie 2.3 %.
    assert np.mean(refused) == pytest.approx(0.023, abs=0.012)


def test_the_misfit_that_an_uncertain_ground_adds_is_that_of_draws_from_its_covariance() -> None:
    """Mean and variance of chi2 of samples whose vehicle is fitted anew on a ground that others left uncertain."""
    random = np.random.default_rng(3)
    seen, ground, own = random.normal(size=(9, 4)), random.normal(size=(30, 4)), random.normal(size=(30, 2))
    every = np.arange(4)

    def equations(design: np.ndarray, *parts: Part) -> Any:
        normal = Normal(0, 4, [Block(0, 0, every, design.T @ design)], [], list(parts), np.zeros(4))
        return SimpleNamespace(normal=normal)

    vehicle = Part(own.T @ own, own.T @ ground, np.zeros(2), np.zeros(2), 0)
    free = SimpleNamespace(visit=lambda at: equations(ground, vehicle))
    mean, variance = blur(
        cast(Any, SimpleNamespace(at=equations(seen))), cast(Any, None), cast(Any, free), cast(Any, None)
    )
    off = random.multivariate_normal(np.zeros(4), np.linalg.inv(seen.T @ seen), size=20 * DRAWS)
    data = off @ ground.T + random.normal(size=(20 * DRAWS, 30))
    chi2 = ((data - data @ np.linalg.pinv(own).T @ own.T) ** 2).sum(1)
    freedom = 30 - 2
    assert chi2.mean() - freedom == pytest.approx(mean, rel=0.03)
    assert chi2.var() - 2 * freedom == pytest.approx(variance, rel=0.1)


def test_held_out_samples_are_those_of_one_vehicle_and_what_it_was_moved_by_is_misfit(survey, monkeypatch) -> None:
    """By hand: 60 rows of a car, in 10 of which a fitted vehicle is near; 2 channels of residual 2, at half weight."""
    car = survey.passes[0]
    other = replace(car, rows=car.rows[:10], position=car.position[:10])
    samples = SimpleNamespace(samples=car.rows)
    problem = SimpleNamespace(gauge_length=10.0, passes=[car], traffic=samples, start=survey.problem.start)
    link = SimpleNamespace(fit=SimpleNamespace(problem=problem))
    prior, half = SimpleNamespace(cost=lambda state: 7.0), torch.full((60, 2), 0.5, dtype=torch.float64)
    held: Any = SimpleNamespace(prior=prior, free=torch.ones(4, dtype=torch.bool), links=[link])
    at = SimpleNamespace(residuals=[4 * half], weights=[Weights(2 * half, half)])
    monkeypatch.setattr("solver.fit.held_out.blur", lambda *_: (12.0, 30.0))
    fold = Fold(cast(Any, None), held, cast(Any, None), [other])
    found = fold.judged(cast(Any, None), cast(Any, SimpleNamespace(state=None, at=at)))
    assert found.chi2 == 7.0 + 50 * 2 * 2.0**2
    assert found.freedom == 50 * 2 * 0.5 - 4
    # The ground's uncertainty adds to all samples alike: to those that count their share.
    share = found.freedom / (60 * 2 * 0.5)
    assert (found.blurred, found.blur) == pytest.approx((12.0 * share, 30.0 * share))


def test_what_is_more_uncertain_with_an_effect_counts_in_its_favor(survey, monkeypatch) -> None:
    """With it the seen passes leave a misfit of 30 in the others, without it of 10: 20 of its rise are no fault."""
    by_effects = [HeldOut(100.0, 80.0, 10.0, 4.0), HeldOut(115.0, 80.0, 30.0, 9.0)]

    def fold(problem: Problem) -> Any:
        judged = by_effects[len(problem.effects)]
        return SimpleNamespace(fitted=lambda _: None, ended=lambda *_: None, judged=lambda *_: judged)

    stand_ins = {
        "chained": lambda fit: fit,
        "track_spread": lambda *_: 0.1,
        "strict_tracks": lambda problem, _: problem,
        "dealt": lambda _: [fold],
        "side_by_side": lambda work, makes: [work(make) for make in makes],
        "shown": lambda make, problem, _: (make(problem), None, []),
        "residuals": lambda *_: {},
    }
    for name, one in stand_ins.items():
        monkeypatch.setattr(f"solver.fit.held_out_gain.{name}", one)
    state: Any = SimpleNamespace(vehicles=SimpleNamespace(along=torch.zeros(2)))
    fits: list[Any] = [
        SimpleNamespace(problem=one, passes=one.passes)
        for one in (survey.problem, with_effect(survey.problem, "gauge_length"))
    ]
    gain = held_out_gain((fits[0], state), (fits[1], state))
    assert gain == HeldOutGain(-15.0, 80.0, 20.0, 5.0, 0.0) and not gain.refuses(1.0)
    by_effects[1] = HeldOut(145.0, 80.0, 30.0, 9.0)
    rise = held_out_gain((fits[0], state), (fits[1], state))
    assert rise is not None and rise.refuses(1.0)
