"""Knots where a fiber bends, and the corners that a fit tells."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.cable.fiber import SplineBasis
from solver.fit.anchor_check import contradiction
from solver.fit.chain import Chain
from solver.fit.corners import find_corners
from solver.fit.least_squares import solve
from solver.fit.prior import Prior, shape_rows
from solver.fit.problem import CLOSEST, KNOT_SPACING, Problem
from solver.fit.refinement import Equations, add_knots, close_around, finer, insert_knots, worth_adding
from solver.fit.result import FitResult
from solver.fit.stretches import is_long
from solver.run import route_fits
from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator import Scenario, Survey, simulate, write_survey
from solver.survey.survey import Survey as Read

UNEVEN = SplineBasis.of([0.0, 10.0, 12.0, 13.0, 20.0, 30.0])


def located(shape: str, seed: int, folder: Path) -> tuple[Survey, Run]:
    survey = simulate(Scenario(seed=seed, passes=6, snr_db=18.0, laid=shape))
    return survey, locate(Read.read(write_survey(survey, folder / "s")))


def test_functions_on_uneven_knots_are_those_of_a_part_and_of_tensors() -> None:
    at = np.linspace(0.0, 30.0, 61)
    for order in range(3):
        np.testing.assert_allclose(UNEVEN.weights(torch.from_numpy(at), order), UNEVEN.at(at, order), atol=1e-12)
    inside = at[(at > 12.0) & (at < 20.0)]
    np.testing.assert_allclose(UNEVEN.part(2, 4).at(inside), UNEVEN.at(inside)[:, 2:7], atol=1e-12)


@pytest.mark.parametrize("coarse", [UNEVEN, SplineBasis.even(0.0, 500.0, 2.5)])
def test_a_finer_basis_holds_the_functions_of_the_coarser_one(coarse: SplineBasis) -> None:
    """However many knots there are."""
    fine, at = finer(coarse), np.linspace(coarse.start, coarse.stop, 500)
    np.testing.assert_allclose(fine.at(at) @ insert_knots(np.eye(coarse.size), coarse, fine), coarse.at(at), atol=1e-10)
    assert np.diff(fine.breaks).min() >= CLOSEST
    long = SplineBasis.even(0.0, 5000.0, KNOT_SPACING)
    route = np.random.default_rng(1).normal(size=(long.size, 3))
    at, finest = np.linspace(0.0, 5000.0, 4000), finer(finer(long))
    np.testing.assert_allclose(finest.along(insert_knots(route, long, finest), at), long.along(route, at), atol=1e-10)


def test_knots_lie_close_around_added_ones_and_nowhere_else() -> None:
    breaks = close_around(SplineBasis.even(0.0, 60.0, 10.0), np.array([32.0])).breaks
    inside = (breaks >= 20.0) & (breaks <= 40.0)
    assert np.diff(breaks[inside]).max() <= 1.0 and np.isin(np.arange(0.0, 61.0, 10.0), breaks).all()
    assert breaks[~inside].tolist() == [0.0, 10.0, 50.0, 60.0]


def test_the_prior_bends_by_its_jacobian_and_pulls_less_on_a_corner() -> None:
    random = torch.Generator().manual_seed(1)
    route = torch.randn(UNEVEN.size, 3, generator=random, dtype=torch.float64) * 0.3
    route += torch.stack(
        [torch.linspace(-10, 40, UNEVEN.size), torch.full((UNEVEN.size,), 4.0), torch.ones(UNEVEN.size)], 1
    )
    numeric = torch.autograd.functional.jacobian(
        lambda x: shape_rows(UNEVEN, Prior(), x.reshape(-1, 3)).residual, route.flatten()
    )
    torch.testing.assert_close(shape_rows(UNEVEN, Prior(), route).jacobian, numeric)


def log_evidence(data: np.ndarray, design: np.ndarray, precision: np.ndarray) -> float:
    """Ln density of data of unit noise, of a linear model whose numbers have a prior about 0."""
    spread = np.eye(len(data)) + design @ np.linalg.solve(precision, design.T)
    return float(-data @ np.linalg.solve(spread, data) - np.linalg.slogdet(spread)[1]) / 2


def test_the_bayes_factor_of_more_numbers_is_the_ratio_of_the_evidences() -> None:
    """Beside others that are free as well, and that the prior ties to them."""
    random = np.random.default_rng(4)
    design, root, data = random.normal(size=(40, 7)), random.normal(size=(7, 9)), random.normal(size=40)
    known = root @ root.T
    left = Equations(design.T @ design + known, known.copy(), design.T @ data)
    left.eliminate(np.arange(4))
    wanted = log_evidence(data, design, known) - log_evidence(data, design[:, :4], known[:4, :4])
    assert left.bayes_factor(np.arange(4, 7), 1.0) == pytest.approx(wanted, rel=1e-9)


def asked_for(gains: list[float], chi2_per_dof: float) -> list[int]:
    """Knots that are added, of some that each bring so much; the data are 10 times as sharp as the prior."""
    groups = {knot: np.arange(3 * knot, 3 * knot + 3) for knot in range(len(gains))}
    right = np.repeat(np.sqrt(np.array(gains) * 100.0 / 3), 3)
    left = Equations(100.0 * np.eye(len(right)), np.eye(len(right)), right)
    return worth_adding(left, groups, list(groups), chi2_per_dof)


def test_knots_are_added_where_they_explain_more_than_noise_and_more_than_others_do() -> None:
    """Three numbers that the data sharpen 100 times cost 3 ln 100; half of what they bring must exceed that by 6."""
    enough = 6.0 + 3 * np.log(100.0)
    others = [2.0] * 7
    assert asked_for([0.95 * enough, *others], 1.0) == []
    assert asked_for([1.05 * enough, *others], 1.0) == [0]
    # Where four times as much as noise is left, a knot must bring four times as much.
    assert asked_for([3.8 * enough, *others], 4.0) == []
    assert asked_for([4.2 * enough, *others], 4.0) == [0]
    # Where every knot explains a part of what the model lacks, none stands out but one that explains far more.
    assert asked_for([4.0 * enough] * 8, 1.0) == []
    assert asked_for([100.0 * enough, *[4.0 * enough] * 7], 1.0) == [0]


def test_what_is_told_of_a_corner_is_as_uncertain_as_the_coefficients_are() -> None:
    """Routes drawn from the covariance, which the misfit widens, turn and step by amounts that scatter so.

    Errors of x and y go together, so that a direction between them is surer than one across it.
    """
    basis, random = SplineBasis.even(0.0, 40.0, 1.0), np.random.default_rng(6)
    s = np.linspace(0.0, 40.0, 400)
    bent = np.radians(20.0 + 60.0 * np.clip((s - 14.0) / 2, 0.0, 1.0))
    deep = 1.0 + np.clip((s - 29.0) / 2, 0.0, 1.0) * 0.8
    way = np.cumsum(np.column_stack([np.cos(bent), np.sin(bent)]), 0) * (s[1] - s[0])
    made = basis.interpolate(s, np.column_stack([way, deep]))
    alike = np.linalg.cholesky(np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    root = np.kron(np.eye(basis.size), 0.01 * alike)
    covariance = root @ root.T

    def corners(coefficients: np.ndarray) -> Any:
        fit = SimpleNamespace(basis=basis, problem=SimpleNamespace(zero_distance=0.0, channel_spacing=1.0))
        state = SimpleNamespace(coefficients=torch.from_numpy(coefficients))
        posterior: Any = SimpleNamespace(
            chain=fit,
            visit=SimpleNamespace(state=state),
            scale=4.0,
            columns=lambda where: covariance[:, where],
        )
        return find_corners(posterior, 0.0, 40.0)

    told = corners(made)
    assert [one.kind for one in told] == ["corner", "step"]
    assert [one.amount for one in told] == pytest.approx([60.0, 0.8], rel=0.05)
    drawn = [corners(made + 2.0 * (root @ random.normal(size=made.size)).reshape(made.shape)) for _ in range(60)]
    amounts = np.array([[one.amount for one in each] for each in drawn])
    # The sd of 60 draws scatters by 9 %; parts of a corner begin and end elsewhere in each.
    np.testing.assert_allclose(amounts.std(0), [one.sigma for one in told], rtol=0.3)


def test_corners_get_knots_and_are_told_and_no_more_knots_are_asked_for(tmp_path: Path) -> None:
    survey, run = located("jog", 31, tmp_path)
    channel = run.result.channel
    seen = (channel >= survey.active[0]) & (channel <= survey.active[1])
    off = np.linalg.norm((run.result.route - survey.route[channel])[seen], axis=1)
    assert off.max() < 0.4 and np.diff(run.problem.basis.breaks).min() < 1.0
    assert np.diff(run.problem.basis.breaks).max() > 0.9 * KNOT_SPACING
    turns = [one for one in run.corners if one.kind == "corner"]
    assert len(turns) >= 3 and abs(sum(one.amount for one in turns)) < 15.0
    assert any(turns[0].words in note for note in run.facts["warnings"])
    chain = Chain.of(run.problem)
    assert add_knots(chain, solve(chain, chain.start()).state, run.result.chi2_per_dof) is None


@pytest.fixture(scope="module")
def crossed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Run]:
    return located("crossing", 2, tmp_path_factory.mktemp("crossing"))


def test_a_fiber_that_crosses_the_road_is_begun_there(crossed: tuple[Survey, Run]) -> None:
    survey, run = crossed
    channel = run.result.channel
    seen = (channel >= survey.active[0]) & (channel <= survey.active[1])
    assert np.linalg.norm((run.result.route - survey.route[channel])[seen], axis=1).max() < 0.4
    assert sorted(round(abs(one.amount), -1) for one in run.corners if one.kind == "corner") == [90.0, 90.0]


def test_what_a_route_misses_an_anchor_by_is_left_where_the_anchor_is(crossed: tuple[Survey, Run]) -> None:
    """A corner beyond the view, where no vehicle is recorded, showed at its anchor alone: no knots were asked for."""
    _, run = crossed
    end = torch.from_numpy(run.result.vector)

    def left(problem: Problem) -> float:
        chain = Chain.of(problem)
        return chain.misfits(chain.visit(chain.state_of(end)), np.array([0.0, 1000.0]))[0].item()

    first, *others = run.problem.anchors
    moved = [replace(first, x=first.x + 100.0 * first.sigma_xy), *others]
    off = (run.result.route[list(run.result.channel).index(first.channel), 0] - first.x) / first.sigma_xy
    wanted = (off - 100.0) ** 2 - off**2
    assert left(replace(run.problem, anchors=moved)) - left(run.problem) == pytest.approx(wanted, rel=0.01)


def test_an_anchor_that_a_crossing_contradicts_is_named(
    crossed: tuple[Survey, Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It kept the fit from the crossing, so that all anchors and the tracks were blamed."""
    _, run = crossed
    last = max(run.problem.anchors, key=lambda one: one.channel)
    wrong = replace(last, y=-last.y)
    anchors = [one if one is not last else wrong for one in run.problem.anchors]
    begun = replace(run.problem, anchors=anchors)

    def with_crossing(problem: Problem) -> Any:
        return SimpleNamespace(problem=problem), None, float(wrong in problem.anchors)

    def is_explained(result: FitResult, problem: Problem) -> bool:
        return result is run.result and wrong not in problem.anchors

    monkeypatch.setattr(route_fits, "with_crossing", with_crossing)
    monkeypatch.setattr(route_fits, "fit_from", lambda start, *_: (run.result, start[0].problem))
    monkeypatch.setattr(route_fits, "is_explained", is_explained)
    monkeypatch.setattr(route_fits, "fit_bends", lambda result, problem, method: (result, problem))
    before = replace(run.result, chi2_per_dof=1.3), begun
    found, problem = route_fits.without_anchor(before, begun, with_crossing(begun), "spline")
    assert found is run.result and wrong not in problem.anchors
    told = contradiction(replace(run.problem, anchors=anchors), run.result)
    assert told is not None and told.corner in run.corners
    assert told.sentence.startswith(f"anchor {wrong.name} is ")
    assert told.distance == pytest.approx(2 * abs(last.y), abs=0.2)
    assert ", which turns 90 degrees to the " in told.sentence


def test_a_step_in_depth_is_told(tmp_path: Path) -> None:
    survey, run = located("step", 34, tmp_path)
    steps = [one for one in run.corners if one.kind == "step"]
    assert len(steps) == 1
    channel = run.result.channel
    seen = (channel >= survey.active[0]) & (channel <= survey.active[1])
    assert np.abs((run.result.route - survey.route[channel])[seen]).max() < 0.3


def test_a_corner_is_found_beside_what_else_the_model_lacks(tmp_path: Path) -> None:
    """More is left all along the fiber than knots explain; most of what is left at the corners they do."""
    scenario = Scenario(seed=31, passes=4, snr_db=18.0, laid="jog", effects={"wheel_layout": 1.0})
    survey = simulate(scenario)
    run = locate(Read.read(write_survey(survey, tmp_path / "s")))
    channel = run.result.channel
    seen = (channel >= survey.active[0]) & (channel <= survey.active[1])
    off = np.linalg.norm((run.result.route - survey.route[channel])[seen], axis=1)
    assert off.max() < 0.4 and sum(one.kind == "corner" for one in run.corners) >= 3
    assert run.result.chi2_per_dof > 1.1


@pytest.mark.usefixtures("cut_short")
def test_a_long_fiber_gets_knots_where_it_turns_alone(tmp_path: Path) -> None:
    scenario = Scenario(seed=34, passes=4, snr_db=18.0, laid="jog", view=(0.0, 60.0), channels=140)
    survey = simulate(scenario)
    run = locate(Read.read(write_survey(survey, tmp_path / "s")))
    channel = run.result.channel
    seen = (channel >= survey.active[0]) & (channel <= survey.active[1])
    off = np.linalg.norm((run.result.route - survey.route[channel])[seen], axis=1)
    breaks = run.problem.basis.breaks
    assert is_long(run.problem) and off.max() < 0.4
    turns = [one.distance for one in run.corners if one.kind == "corner"]
    close = breaks[1:][np.diff(breaks) < 0.4 * KNOT_SPACING]
    # Those around an added knot fill its interval and the next.
    reach = 2 * KNOT_SPACING
    assert len(turns) >= 3 and close.min() > min(turns) - reach and close.max() < max(turns) + reach
