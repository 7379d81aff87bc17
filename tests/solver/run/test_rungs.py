"""How far routes moved from rung to rung, over the channels that both constrain."""

from dataclasses import replace

import numpy as np
import pytest

from solver.run.ladder import apart, climbed, first_rung, known_route, moved, rungs_of
from solver.run.run import run_of


def rows(*places: tuple[float, float, float, float]):
    return tuple(places)


def test_apart_is_the_largest_distance_where_both_are():
    one = rows((1, 0, 0, 1), (2, 1, 0, 1), (3, 2, 0, 1))
    other = rows((2, 1, 0.3, 1.4), (3, 2, 0, 1.1), (4, 9, 9, 9))
    assert apart(one, other) == apart(other, one) == 0.5
    assert apart(one, one) == 0.0
    assert np.isnan(apart(one, rows((7, 0, 0, 0))))


def test_known_route_has_the_constrained_channels_to_a_tenth_of_a_millimeter(survey):
    flags = np.zeros(len(survey.result.channel), bool)
    flags[[3, 9]] = True
    result = replace(survey.result, constrained=flags, route=survey.result.route + 1.23e-6)
    found = known_route(result)
    assert [row[0] for row in found] == result.channel[[3, 9]].tolist()
    np.testing.assert_allclose([row[1:] for row in found], result.route[[3, 9]], atol=5.1e-5)


def test_moved_is_in_the_larger_of_both_sigmas(survey):
    one = survey.result
    other = replace(one, route=one.route + np.array([0.0, 0.3, 0.0]), covariance=one.covariance * 9)
    expected = 0.3 / other.sigma[one.constrained, 1].min()
    assert moved(one, other) == pytest.approx(expected)
    assert moved(other, one) == pytest.approx(expected)
    nowhere = replace(one, constrained=np.zeros_like(one.constrained))
    assert np.isnan(moved(one, nowhere))


def test_a_run_begins_its_ladder_and_each_that_grows_out_of_it_adds_a_rung(survey):
    first = run_of(survey.result, **survey.arguments)
    assert rungs_of(first) == (first_rung(first),) and rungs_of(first)[0].route_change == 0.0
    runs = [first]
    for meters in (0.2, -0.5):
        route = runs[-1].result.route + np.array([0.0, meters, 0.0])
        grown = replace(first, result=replace(first.result, route=route))
        runs.append(replace(grown, rungs=climbed(runs[-1], grown)))
    last = runs[-1].rungs
    assert rungs_of(runs[-1]) == last and last[:2] == runs[1].rungs
    assert [one.route_change for one in last] == pytest.approx([0.0, 0.2, 0.5])
    assert [one.route_change_from_first for one in last] == pytest.approx([0.0, 0.2, 0.3])
