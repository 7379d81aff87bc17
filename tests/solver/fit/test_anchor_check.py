"""Which anchor is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from solver.fit.anchor_check import contradiction, disagree, misses
from solver.fit.spline import fit_spline
from solver.survey.anchors import Anchor


def with_third(case, **wrong: float):
    """The problem with a third, exact anchor in the middle, moved by `wrong`, m."""
    middle = len(case.truth) // 2
    place = dict(zip("xyz", case.truth[middle], strict=True))
    moved = {axis: value + wrong.get(axis, 0.0) for axis, value in place.items()}
    third = Anchor(name="third", channel=int(case.problem.channel[middle]), **moved, sigma_xy=0.05, sigma_z=0.05)
    return replace(case.problem, anchors=[*case.problem.anchors, third])


def test_an_anchor_s_miss_is_the_sum_of_squares_of_each_axis_over_its_own_sigma(survey) -> None:
    x, y, z = survey.result.route[10]
    off = Anchor("off", float(survey.result.channel[10]), x + 0.2, y - 0.3, z + 1.2, 0.1, 0.3)
    assert misses(replace(survey.problem, anchors=[off]), survey.result) == pytest.approx([2**2 + 3**2 + 4**2])


def test_anchors_that_scatter_by_their_sigmas_disagree_in_one_survey_of_ten_thousand(survey) -> None:
    """Five anchors in 2,000 surveys; and where they scatter twice as much they do in most."""
    random, result = np.random.default_rng(1), survey.result
    at = [3, 12, 25, 38, 50]

    def said(times: float, surveys: int) -> float:
        found = 0
        for error in times * random.normal(size=(surveys, 5, 3)) * [0.05, 0.05, 0.2]:
            places = zip(result.channel[at].tolist(), result.route[at] + error, strict=True)
            anchors = [Anchor(str(channel), channel, *place, 0.05, 0.2) for channel, place in places]
            found += disagree(replace(survey.problem, anchors=anchors), result)
        return found / surveys

    assert said(1.0, 2000) < 2e-3 and said(2.0, 200) > 0.7


def test_good_anchors_agree(case) -> None:
    problem = with_third(case)
    result = fit_spline(problem)
    assert (misses(problem, result) < 16).all()
    assert contradiction(problem, result) is None


@pytest.mark.parametrize(("wrong", "distance"), [({"y": 1.0}, 1.0), ({"x": 2.0}, 2.0)])
def test_the_wrong_anchor_is_named(case, wrong: dict[str, float], distance: float) -> None:
    problem = with_third(case, **wrong)
    result = fit_spline(problem)
    found = contradiction(problem, result)
    assert found is not None and [one.name for one in found.suspects] == ["third"]
    assert found.distance == pytest.approx(distance, abs=0.2)
    assert found.sentence.startswith("anchor third is ")


def test_two_of_which_nothing_tells_the_wrong_one_are_both_named(case) -> None:
    """Two anchors at one place, a meter of depth apart: the loads tell depth only through the Poisson ratio."""
    problem = with_third(case)
    third = replace(problem.anchors[-1], z=problem.anchors[-1].z - 0.15, sigma_z=0.01)
    fourth = replace(third, name="fourth", z=third.z + 0.3)
    problem = replace(problem, anchors=[third, fourth])
    found = contradiction(problem, fit_spline(problem))
    assert found is not None and {one.name for one in found.suspects} == {"third", "fourth"}
    assert "nothing tells which" in found.sentence


def test_without_anchors_none_is_wrong(case) -> None:
    problem = replace(case.problem, anchors=[])
    assert contradiction(problem, fit_spline(problem)) is None
