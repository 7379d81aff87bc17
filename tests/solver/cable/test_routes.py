"""Fibers that do not simply run beside the road: located, or said why not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from solver.catalogue.catalogue import built_in
from solver.criticism.growth import Grown, fitted_with, regrown
from solver.criticism.race import started_elsewhere
from solver.criticism.scorer import Scorer
from solver.fit.chain import Chain
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.spline import fit_spline
from solver.fit.track_trust import strict_tracks
from solver.run import route_fits
from solver.run.locate import locate
from solver.run.methods import METHODS
from solver.run.run import Run
from solver.simulator import Scenario, Survey, simulate, write_survey
from solver.start.coil import find_coil
from solver.start.fiber_line import FiberLine
from solver.survey.survey import Survey as Read

Array = NDArray[np.float64]
X = np.arange(-60.0, 161.0, 2.0)


def crossing(x: Array) -> Array:
    """From 4 m on one side of the road to 4 m on the other, within some 40 m."""
    return np.column_stack([x, -1.75 + 5.75 * np.tanh((x - 50.0) / 18.0), 0.9 + 0 * x])


def dipping(x: Array) -> Array:
    """A meter deeper over some 20 m, as under a culvert."""
    return np.column_stack([x, 4.0 + 0 * x, 0.8 + np.exp(-0.5 * ((x - 50.0) / 7.0) ** 2)])


def far(x: Array) -> Array:
    """12 m from the lane."""
    return np.column_stack([x, 12.0 + 0.2 * np.sin(x / 15.0), 0.9 + 0 * x])


def bending(x: Array) -> Array:
    """Beside the road, then away from it around a corner of 3 m radius."""
    along = x[x < 60.0]
    angle = np.linspace(0.0, np.pi / 2, 8)[1:]
    corner = np.column_stack([along[-1] + 3 * np.sin(angle), 7.0 - 3 * np.cos(angle)])
    away = np.column_stack([np.full(60, corner[-1, 0]), corner[-1, 1] + np.arange(2.0, 122.0, 2.0)])
    plan = np.vstack([np.column_stack([along, np.full(len(along), 4.0)]), corner, away])
    return np.column_stack([plan, np.full(len(plan), 0.9)])


def located(laid: Callable[[Array], Array], folder: Path) -> tuple[Survey, Run]:
    route = tuple(tuple(float(v) for v in point) for point in laid(X))
    survey = simulate(Scenario(seed=4, passes=8, route=route, noise="street", track_noise="camera", snr_db=18.0))
    return survey, locate(Read.read(write_survey(survey, folder / "s")))


def errors(survey: Survey, found: Run, most_x: float = 95.0) -> Array:
    """Distance [channel, 3] of the route found from the truth, where the camera looks."""
    truth = survey.route[found.result.channel]
    seen = (truth[:, 0] > 5.0) & (truth[:, 0] < most_x)
    assert seen.sum() > 40
    return (found.result.route - truth)[seen]


@pytest.mark.parametrize(("laid", "most"), [(crossing, 0.25), (far, 0.25)])
def test_a_fiber_that_crosses_or_is_far_is_located(laid: Callable[[Array], Array], most: float, tmp_path: Path) -> None:
    survey, found = located(laid, tmp_path)
    assert np.linalg.norm(errors(survey, found), axis=1).max() < most


def test_a_dip_takes_finer_knots_and_sigma_says_how_well_it_is_known(tmp_path: Path) -> None:
    survey, found = located(dipping, tmp_path)
    off = errors(survey, found)
    assert np.linalg.norm(off, axis=1).max() < 0.15
    truth = survey.route[found.result.channel]
    sigma = found.result.sigma[(truth[:, 0] > 5.0) & (truth[:, 0] < 95.0)]
    assert (np.abs(off) < 1.96 * sigma).mean() > 0.8
    assert len(found.problem.knots) > 10
    # So does a model that grows, as `add` and `explain` let it.
    fit = MapFit(replace(found.problem, knots=()))
    grown = Grown(fit, solve(fit, fit.start()), None, None)
    again = regrown(found, grown, [], 1.0)
    assert again.problem.knots and again.result.chi2_per_dof < grown.result(1.0).chi2_per_dof
    assert again.facts["held_out_chi2_per_dof"] is not None


def test_what_other_physics_leaves_is_not_fitted_on_finer_knots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted = list[tuple[float, ...]]()

    def fit(problem: Problem, *rest: Any, **more: Any) -> FitResult:
        fitted.append(problem.knots)
        return fit_spline(problem, *rest, **more)

    def solved(chain: Chain, *rest: Any, **more: Any) -> Solution:
        fitted.append(chain.problem.knots)
        return solve(chain, *rest, **more)

    monkeypatch.setitem(METHODS, "spline", (fit, METHODS["spline"][1]))
    monkeypatch.setattr(route_fits, "fit_spline", fit)
    monkeypatch.setattr(route_fits, "solve", solved)
    hidden = {"gauge_length": 0.15}
    scenario = Scenario(seed=4, passes=4, noise="street", track_noise="camera", snr_db=18.0, effects=hidden)
    survey = simulate(scenario)
    found = locate(Read.read(write_survey(survey, tmp_path / "s")))
    assert found.result.chi2_per_dof > 1.01 and set(fitted) == {()}


def test_a_fiber_that_bends_away_is_located_up_to_the_bend(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    survey, found = located(bending, tmp_path)
    assert np.linalg.norm(errors(survey, found, 50.0), axis=1).max() < 0.3
    print(caplog.text, found.result.route[-1])


def test_turns_that_a_long_gauge_senses_beyond_its_channels_are_found(tmp_path: Path) -> None:
    """The fiber turns off the road on either side of the view, within the gauges of channels in it."""
    gauges = {"gauge_length": 50.0, "channel_spacing": 2.0, "channels": 130}
    survey = simulate(Scenario(seed=3, passes=3, view=(0.0, 40.0), snr_db=20.0, **gauges))
    result = locate(Read.read(write_survey(survey, tmp_path / "s"))).result
    off = np.abs(result.route - survey.route[result.channel])[result.constrained]
    turned = np.ptp(survey.route[result.channel[result.constrained], 1])
    assert turned > 5.0 and off.max() < 1.2
    assert (off < 4.5 * result.sigma[result.constrained]).all()


def test_a_coil_is_seen_and_a_fit_with_it_begins_there(tmp_path: Path) -> None:
    effects = {"slack_spool": 18.0, "slack_spool_at": 0.5}
    small = {"passes": 5, "view": (0.0, 70.0), "channels": 200}
    survey = simulate(Scenario(seed=4, **small, noise="street", track_noise="camera", snr_db=18.0, effects=effects))
    found = locate(Read.read(write_survey(survey, tmp_path / "s")))
    assert found.problem.coil is not None and abs(found.problem.coil.length - 18.0) < 3.0
    # What turns there is the model, not the fiber: all of it stays.
    assert np.isin(np.arange(survey.active[0] + 10, survey.active[1] - 9), found.problem.channel).all()
    assert any("lie coiled near channel" in line for line in found.warnings)
    fit = MapFit(strict_tracks(found.problem))
    state = fit.state_of(torch.from_numpy(found.result.vector))
    refit = fitted_with(fit, state, built_in()["slack_spool"], lambda n: None)
    assert refit.estimate[0] == pytest.approx(18.0, abs=0.2)
    at = refit.solution.at
    assert at.misfit < 1.1 * float((fit.measured).sum())
    # Anchors are where their channels are, not where they would be without a coil.
    problem = found.problem
    route = Posterior(Chain.single(refit.fit), at).route(problem.distance)[0]
    assert np.linalg.norm(route - survey.route[problem.channel], axis=1).max() < 0.3


def test_fits_with_a_coil_start_from_the_detour_that_a_route_without_it_takes(tmp_path: Path) -> None:
    small = {"passes": 5, "view": (0.0, 70.0), "channels": 200, "snr_db": 18.0}
    survey = simulate(Scenario(seed=4, **small, effects={"slack_spool": 8.0, "slack_spool_at": 0.5}))
    found = locate(Read.read(write_survey(survey, tmp_path / "s")))
    assert found.problem.coil is None
    fit = MapFit(found.problem)
    scorer = Scorer(fit, fit.state_of(torch.from_numpy(found.result.vector)))
    coil = built_in()["slack_spool"]
    [(_, score)] = started_elsewhere(scorer, [coil])
    assert score.estimate == pytest.approx([8.0], abs=2.5)
    refit = fitted_with(fit, scorer.state, coil, lambda n: None)
    assert refit.estimate == pytest.approx([8.0], abs=0.2)
    assert score.shape["place"] == pytest.approx(refit.shape["place"], abs=6.0)


def test_a_straight_fiber_has_no_coil() -> None:
    rng = np.random.default_rng(3)
    channel = np.repeat(np.arange(0.0, 100.0), 4)
    x = 5.0 + 0.9 * channel + rng.normal(0, 1.0, 400)
    x[::7] += rng.uniform(-30, 30, len(x[::7]))
    assert find_coil(FiberLine(5.0, 0.9, 0.0), x, np.full(400, 12.0), channel, 1.0) is None
