"""When the side of the road counts as known."""

from dataclasses import replace

import numpy as np
import pytest

from solver import locate
from solver.fit.sides import reopened


@pytest.fixture
def two_sides(survey, monkeypatch):
    """Fit a survey's two mirror starts with ends of one's choice; whether the side is ambiguous."""

    def ends(*results):
        left = replace(survey.problem, start=survey.problem.start * [1, -1, 1])
        found = iter(results)
        monkeypatch.setattr(locate, "METHODS", {"spline": (lambda problem, advance: next(found), 40)})
        monkeypatch.setattr(locate, "fit_spline", lambda problem, advance, hopeless: next(found))
        return locate.fit_sides([survey.problem, left], "spline")[0].ambiguous_side

    return ends


def mirrored(result, **changes):
    return replace(result, route=result.route * [1, -1, 1], **changes)


def test_converged_fits_decide_by_their_chi2(survey, two_sides):
    result = replace(survey.result, chi2=1000.0)
    assert two_sides(result, mirrored(result, chi2=1005.0))
    assert not two_sides(result, mirrored(result, chi2=1050.0))
    assert not two_sides(result, replace(result, chi2=1001.0)), "both fits ended on one side"


def test_a_fit_that_was_given_up_is_ruled_out(survey, two_sides):
    result = replace(survey.result, chi2=1000.0)
    assert not two_sides(result, mirrored(result, chi2=2000.0, converged=False, iterations=6))


@pytest.mark.parametrize("worse", [5.0, 50.0, 5000.0])
def test_fits_that_did_not_converge_decide_nothing(survey, two_sides, worse):
    result = replace(survey.result, chi2=1000.0, iterations=40)
    behind = mirrored(result, chi2=1000.0 + worse, converged=False)
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
