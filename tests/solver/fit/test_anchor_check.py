"""Which anchor is wrong."""

from dataclasses import replace

import pytest

from solver.fit.anchor_check import contradiction, misses
from solver.fit.spline import fit_spline
from solver.survey.anchors import Anchor


def with_third(case, **wrong: float):
    """The problem with a third, exact anchor in the middle, moved by `wrong`, m."""
    middle = len(case.truth) // 2
    place = dict(zip("xyz", case.truth[middle], strict=True))
    moved = {axis: value + wrong.get(axis, 0.0) for axis, value in place.items()}
    third = Anchor(name="third", channel=int(case.problem.channel[middle]), **moved, sigma_xy=0.05, sigma_z=0.05)
    return replace(case.problem, anchors=[*case.problem.anchors, third])


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
