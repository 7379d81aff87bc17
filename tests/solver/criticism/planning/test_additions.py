"""What an addition brings, against Gaussian updates written out."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.criticism.planning.additions import (
    APART,
    MOST,
    NEAR,
    Known,
    Option,
    Sigmas,
    anchor_options,
    beyond,
    lane_words,
    single,
    way_to,
    ways,
)
from solver.survey.plan_section import LaneSection

RNG = np.random.default_rng(10)
PLACES, SHARED = 4, 6


def spread(size: int) -> np.ndarray:
    root = RNG.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


@pytest.fixture
def known() -> Known:
    return Known(spread(SHARED), RNG.normal(size=(PLACES, SHARED)), RNG.normal(size=(PLACES, SHARED)))


def simple(across: float, depth: float) -> Known:
    """One number across and one in depth, at one place."""
    return Known(np.diag([across**2, depth**2]), np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]))


def seen(kind: str, words: str, across: float = np.inf, depth: float = np.inf) -> Option:
    """What is measured with these sigmas."""
    return Option(kind, words, np.diag([across**-2.0, depth**-2.0]))


def test_variances_are_quadratic_forms_of_every_place(known: Known) -> None:
    many = np.stack([spread(SHARED) for _ in range(3)])
    across, depth = known.variances(many)
    for number, one in enumerate(many):
        np.testing.assert_allclose(across[number], (known.across @ one @ known.across.T).diagonal())
        np.testing.assert_allclose(depth[number], (known.depth @ one @ known.depth.T).diagonal())


def test_the_sigmas_are_the_largest_in_view(known: Known) -> None:
    across, depth = known.variances(known.covariance)
    assert known.sigmas == Sigmas(across.max() ** 0.5, depth.max() ** 0.5)


def test_a_measurement_updates_as_kalman_does(known: Known) -> None:
    rows, noise = RNG.normal(size=(2, SHARED)), np.diag([0.3, 2.0])
    found = known.with_more(rows.T @ np.linalg.inv(noise) @ rows)
    p = known.covariance
    gain = p @ rows.T @ np.linalg.inv(rows @ p @ rows.T + noise)
    np.testing.assert_allclose(found.covariance, p - gain @ rows @ p, atol=1e-9)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    assert found.across is known.across and found.depth is known.depth


def test_more_information_in_any_order_is_the_same(known: Known) -> None:
    one, other = spread(SHARED), spread(SHARED)
    first, second = known.with_more(one).with_more(other), known.with_more(other).with_more(one)
    np.testing.assert_allclose(first.covariance, second.covariance, atol=1e-12)
    assert first.sigmas.across < known.sigmas.across


@pytest.mark.parametrize(
    ("wanted", "missing"),
    [
        (Sigmas(0.1, 0.1), np.log(4) / 2),  # 0.2 m across is twice as much, in depth it is met
        (Sigmas(0.2, 0.05), 0.0),
        (Sigmas(np.inf, np.inf), 0.0),
        (Sigmas(0.1, 0.025), (np.log(4) + np.log(4)) / 2),
    ],
)
def test_what_is_missing_is_the_mean_ln_variance_beyond(wanted: Sigmas, missing: float) -> None:
    at = simple(0.2, 0.05)
    assert float(beyond(at, at.covariance, wanted)) == pytest.approx(missing, abs=1e-12)


def test_the_best_option_is_taken_again_and_again() -> None:
    """0.4 m measured to 0.4 m, n times, is 0.4 / sqrt(n + 1)."""
    options = [seen("pass", "worse", across=1.0), seen("pass", "better", across=0.4)]
    way = way_to("passes", simple(0.4, 0.1), options, Sigmas(0.19, np.inf))
    assert [one.words for one in way.additions] == ["better"] * 4 and way.reached
    assert [one.after.across for one in way.additions] == pytest.approx([0.4 / (n + 1) ** 0.5 for n in range(1, 5)])


def test_an_anchor_is_put_at_a_place_once() -> None:
    options = [seen("anchor", "here", across=0.1), seen("anchor", "there", across=0.2)]
    way = way_to("anchors", simple(1.0, 0.1), options, Sigmas(0.01, np.inf))
    assert [one.words for one in way.additions] == ["here", "there"] and not way.reached


def test_nothing_is_added_that_hardly_helps_and_never_too_much() -> None:
    start = simple(1.0, 0.1)
    assert way_to("passes", start, [seen("pass", "blind", across=100.0)], Sigmas(0.5, np.inf)).additions == ()
    assert way_to("passes", start, [seen("pass", "deep", depth=0.1)], Sigmas(0.5, np.inf)).additions == ()
    many = way_to("passes", start, [seen("pass", "weak", across=1.0)], Sigmas(0.1, np.inf))
    assert len(many.additions) == MOST and not many.reached
    assert all(a.after.across > b.after.across for a, b in pairwise(many.additions))


def test_both_are_tried_together_only_where_neither_is_enough() -> None:
    start, passes = simple(1.0, 1.0), [seen("pass", "one pass", across=0.1)]
    anchors = [seen("anchor", "here", depth=0.1)]
    assert [one.kind for one in ways(start, passes, anchors, Sigmas(0.5, np.inf))] == ["passes", "anchors"]
    every = ways(start, passes, anchors, Sigmas(0.5, 0.5))
    assert [(one.kind, one.reached) for one in every] == [("passes", False), ("anchors", False), ("both", True)]
    assert {one.words for one in every[-1].additions} == {"one pass", "here"}


def test_single_additions_stand_by_what_they_narrow() -> None:
    start = simple(1.0, 1.0)
    options = [seen("pass", "little", across=2.0), seen("anchor", "much", across=0.1, depth=0.1), seen("pass", "none")]
    found = single(start, options)
    assert [one.words for one in found] == ["much", "little", "none"]
    assert found[0].after.across == pytest.approx((1 / 101) ** 0.5) and found[-1].after == start.sigmas


def test_an_anchor_tells_all_three_coordinates_where_it_is() -> None:
    """With a basis of hats an anchor at a knot tells that knot's three numbers and no other."""

    class Hats:
        size = 4

        def at(self, x: np.ndarray) -> np.ndarray:
            return np.maximum(1 - np.abs(np.asarray(x)[:, None] / APART - np.arange(4)), 0.0)

    plan = SimpleNamespace(anchor_sigma=0.2, length=3 * APART)
    planned: Any = SimpleNamespace(problem=SimpleNamespace(basis=Hats()), site=SimpleNamespace(plan=plan))
    known: Any = SimpleNamespace(covariance=np.eye(3 * 4 + 2))
    options = anchor_options(planned, known)
    assert [one.words for one in options] == [f"{NEAR}{x} m" for x in (0, 5, 10, 15)]
    for place, one in enumerate(options):
        expected = np.zeros(14)
        expected[3 * place : 3 * place + 3] = 1 / 0.2**2
        np.testing.assert_allclose(one.information, np.diag(expected), atol=1e-12)


def test_lanes_are_near_or_far_by_their_distance_from_the_fiber() -> None:
    lanes = [LaneSection(y=y, toward="+x") for y in (0.0, -3.5, 8.0)]
    words = [lane_words(lanes, one, 4.0).split(" (")[0] for one in lanes]
    assert words == ["near lane", "far lane", "near lane"]
    assert lane_words(lanes[:1], lanes[0], 4.0) == "lane (y 0 m, toward +x)"
    three = [LaneSection(y=y, toward="-x") for y in (0.0, -3.5, -7.0)]
    assert [lane_words(three, one, 4.0).split(" (")[0] for one in three] == ["near lane", "lane", "far lane"]
