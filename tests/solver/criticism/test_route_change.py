"""How far candidates move the route, on routes written out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.candidate import Candidate, idle_candidate
from solver.criticism.finding import Diagnosis
from solver.criticism.route_change import from_run, moved, moves, route_of, with_moves
from solver.fit.map_fit import MapFit
from solver.fit.state import State


@pytest.fixture(scope="module")
def ended() -> tuple[MapFit, State]:
    return trial_survey()


def aside(state: State, meters: float) -> State:
    """The route moved across by so much, all along."""
    coefficients = state.coefficients.clone()
    coefficients[:, 1] += meters
    return replace(state, coefficients=coefficients)


def bench_of(fit: MapFit, state: State, across: float, name: str = "a") -> Any:
    """A bench on which the score of an effect moves the route across."""

    def following(score: Any) -> torch.Tensor:
        return (aside(state, across).vector() - state.vector())[fit.free]

    scorer = SimpleNamespace(fit=fit, state=state, following=following)
    return SimpleNamespace(scorer=scorer, table=[SimpleNamespace(effect=SimpleNamespace(name=name))])


def test_the_route_is_where_its_channels_are(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    np.testing.assert_allclose(route_of(fit, state), fit.problem.start, atol=0.02)
    some = fit.problem.channel[[2, 9]]
    np.testing.assert_allclose(route_of(fit, state, some), route_of(fit, state)[[2, 9]], atol=1e-12)


def test_a_candidate_moves_as_its_full_fit_else_as_its_score(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    bench = bench_of(fit, state, 0.3)
    tried: Any = {"b": SimpleNamespace(fit=fit, solution=SimpleNamespace(state=aside(state, -0.7)))}
    across = np.tile([0.0, 1.0, 0.0], (len(fit.problem.channel), 1))
    np.testing.assert_allclose(moves(bench, "a", tried), 0.3 * across, atol=1e-9)
    np.testing.assert_allclose(moves(bench, "b", tried), -0.7 * across, atol=1e-9)
    assert moves(bench, "c", tried) is None
    assert moved(bench, "a", tried) == pytest.approx(0.3) and moved(bench, "b", tried) == pytest.approx(0.7)
    assert moved(bench, "c", tried) is None


def test_where_a_fit_lost_its_numbers_nothing_is_told(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    lost: Any = {"a": SimpleNamespace(fit=fit, solution=SimpleNamespace(state=aside(state, np.nan)))}
    assert moved(bench_of(fit, state, 0.3), "a", lost) is None


def listed(*names: str) -> tuple[Candidate, ...]:
    return tuple(idle_candidate(built_in()[name]) for name in names)


def test_every_candidate_is_told_its_own(ended: tuple[MapFit, State]) -> None:
    bench = bench_of(*ended, 0.25, "gauge_length")
    found = with_moves(bench, listed("clock_offset", "gauge_length"), {})
    assert [one.route_change for one in found] == [None, pytest.approx(0.25)]


def test_a_run_compares_with_its_own_route_where_that_is_constrained(ended: tuple[MapFit, State]) -> None:
    fit, state = ended
    audit: Any = None
    fits = {"gauge_length": (fit, aside(state, 0.5))}
    found = Diagnosis("inconclusive", "", listed("clock_offset", "gauge_length"), audit, 0.1, fits=fits)
    route = route_of(fit, state)
    route[3, 1] += 9.0  # where nothing is known
    known = np.arange(len(route)) != 3
    run: Any = SimpleNamespace(result=SimpleNamespace(constrained=known, channel=fit.problem.channel, route=route))
    told = from_run(run, found)
    assert [one.route_change for one in told.candidates] == [None, pytest.approx(0.5)]
    assert from_run(run, replace(found, fits={})).candidates == found.candidates
    nowhere: Any = SimpleNamespace(result=replace_of(run.result, constrained=np.zeros_like(known)))
    assert from_run(nowhere, found) is found


def replace_of(result: SimpleNamespace, **changes: Any) -> SimpleNamespace:
    return SimpleNamespace(**(vars(result) | changes))
