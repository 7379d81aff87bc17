"""When the side of the road counts as known."""

from dataclasses import replace

import numpy as np
import pytest

from solver.fit.chain import Chain
from solver.fit.sides import is_open, reopened
from solver.fit.state import Weights
from solver.run import route_fits


@pytest.fixture
def two_sides(survey, monkeypatch):
    """Fit a survey's two mirror starts with ends of one's choice; whether the side is ambiguous."""

    def ends(*results):
        left = replace(survey.problem, start=survey.problem.start * [1, -1, 1])
        found = iter(results)
        monkeypatch.setattr(route_fits, "METHODS", {"spline": (lambda problem, advance: next(found), 40)})
        monkeypatch.setattr(route_fits, "fit_spline", lambda problem, advance, hopeless: next(found))
        return route_fits.fit_sides([survey.problem, left], "spline")[0].ambiguous_side

    return ends


def mirrored(result, **changes):
    return replace(result, route=result.route * [1, -1, 1], **changes)


def test_converged_fits_decide_by_their_posterior(survey, two_sides):
    result = replace(survey.result, chi2=1000.0, cost=1000.0)
    assert two_sides(result, mirrored(result, chi2=1005.0, cost=1005.0))
    assert not two_sides(result, mirrored(result, chi2=1050.0, cost=1050.0))
    assert not two_sides(result, replace(result, chi2=1001.0, cost=1001.0)), "both fits ended on one side"


def test_the_misfit_alone_does_not_choose_the_side(survey, two_sides):
    """The wrong side fitted better by moving every track meters aside, and by trusting the samples less."""
    right = replace(survey.result, chi2=1000.0, cost=1010.0)
    wrong = mirrored(right, chi2=990.0, cost=1060.0)
    assert not two_sides(right, wrong)
    assert not two_sides(wrong, right)


def test_samples_that_are_trusted_less_cost_their_weight(case):
    chain = Chain.of(case.problem)
    visit = chain.visit(chain.start())
    half = replace(visit, misfit=visit.misfit / 2, weights=[Weights(w.good, w.soft / 2) for w in visit.weights])
    samples = float(sum(w.good.sum() for w in visit.weights))
    assert visit.misfit > 1.5 * samples, "not at the end of the fit"
    assert chain.cost(half) - chain.cost(visit) == pytest.approx(samples * np.log(2) - visit.misfit / 2, rel=1e-6)
    none = replace(visit, misfit=0.0, weights=[Weights(0 * w.good, w.soft) for w in visit.weights])
    assert chain.cost(none) > 20 * samples


def test_a_fit_that_was_given_up_is_ruled_out(survey, two_sides):
    result = replace(survey.result, chi2=1000.0, cost=1000.0)
    assert not two_sides(result, mirrored(result, chi2=2000.0, cost=2000.0, converged=False, iterations=6))


@pytest.mark.parametrize("worse", [5.0, 50.0, 5000.0])
def test_fits_that_did_not_converge_decide_nothing(survey, two_sides, worse):
    result = replace(survey.result, chi2=1000.0, cost=1000.0, iterations=40)
    behind = mirrored(result, chi2=1000.0 + worse, cost=1000.0 + worse, converged=False)
    assert two_sides(result, behind)
    assert two_sides(replace(result, converged=False), replace(behind, converged=True))
    # Sigmas are wide where the misfit is large: routes do not even count as apart.
    wide = np.tile(np.diag([9.0, 25.0, 9.0]), (len(result.route), 1, 1))
    assert two_sides(replace(result, converged=False, covariance=wide), replace(behind, covariance=wide))


def test_a_later_fit_without_anchors_must_have_converged(survey):
    lost, problem = replace(survey.result, converged=False), survey.problem
    bare = replace(problem, anchors=[])
    assert not reopened(False, lost, problem)
    assert reopened(False, lost, bare)
    assert not reopened(False, survey.result, bare)
    assert reopened(True, survey.result, bare)


@pytest.mark.parametrize("understated", [1.0, 2.0, 5.0])
def test_what_rules_a_side_out_does_not_hang_on_how_large_the_noise_was_said_to_be(survey, understated):
    """Noise that is said to be k times smaller than it is makes every chi2 and cost k^2 times larger, and no surer."""
    square, problem = understated**2, survey.problem
    best = replace(survey.result, chi2=1000.0 * square, cost=1000.0 * square, chi2_per_dof=square)

    def left_open(chi2, cost, **changes):
        rival = mirrored(best, chi2=best.chi2 + square * chi2, cost=best.cost + square * cost, **changes)
        return is_open((best, problem), (rival, problem), 40)

    assert left_open(8.0, 8.0) and not left_open(10.0, 10.0)
    # The posterior counts, not the misfit, which a fit lowers by trusting its samples less.
    assert left_open(30.0, 8.0) and not left_open(-30.0, 10.0)
    # One that was given up is ruled out where it was beyond hope in this noise.
    given_up = {"converged": False, "iterations": 6}
    route = problem.start * [1, -1, 1]
    rival = mirrored(best, chi2=best.chi2 + 90.0 * square, cost=best.cost + 90.0 * square, **given_up)
    assert is_open((best, problem), (rival, replace(problem, start=route)), 40)
    assert not left_open(110.0, 110.0, **given_up)


def test_noise_that_was_overstated_rules_no_side_out_more_easily(survey):
    best = replace(survey.result, chi2=250.0, cost=250.0, chi2_per_dof=0.25)
    assert is_open((best, survey.problem), (mirrored(best, chi2=255.0, cost=255.0), survey.problem), 40)


@pytest.mark.parametrize(("sigmas", "two"), [(2.5, False), (3.5, True)])
def test_routes_within_their_uncertainty_are_on_one_side(survey, sigmas, two):
    best = replace(survey.result, covariance=400 * survey.result.covariance)
    aside = replace(best, route=best.route + sigmas * best.sigma * [0, 1, 0])
    assert is_open((best, survey.problem), (aside, survey.problem), 40) is two
