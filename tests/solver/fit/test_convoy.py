"""Crowd by crowd the equations are those of all passes at once."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.fit import convoy
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.pose import with_slow_errors
from solver.fit.problem import Problem
from solver.fit.stretches import looked_back_at, one_by_one
from solver.noise.law import NoiseLaw
from solver.noise.whitening import Whitener
from solver.signal_path.traffic import Traffic

#: Noise that remembers more samples than lie between two vehicles, that all channels share, and that neighbors share.
LAW = NoiseLaw(0.7 * 0.8 ** np.arange(30.0), 0.3 * 0.9 ** np.arange(30.0), np.array([1.0, 0.4, 0.1]))


@pytest.fixture(params=["white", "colored", "uncertain tracks"])
def problem(case, request: pytest.FixtureRequest) -> Problem:
    """Every second channel of four vehicles' samples, some before and after each."""
    every = slice(None, None, 2)
    few = replace(
        case.problem,
        record=case.problem.record[:, every],
        noise=case.problem.noise[every],
        channel=case.problem.channel[every],
        start=case.problem.start[every],
        law=NoiseLaw.white() if request.param == "white" else LAW,
    )
    if request.param == "uncertain tracks":
        unsure = [replace(one, sigma=one.sigma + 0.2) for one in few.passes]
        few = with_slow_errors(replace(few, passes=unsure, traffic=Traffic.of(unsure, few.traffic.samples)))
    return few


def test_crowds_share_the_samples_and_the_vehicles(problem: Problem) -> None:
    crowds = one_by_one(problem)
    assert len(crowds) == 4
    assert np.concatenate([one.traffic.samples for one in crowds]).tolist() == problem.traffic.samples.tolist()
    assert [one.track_id for crowd in crowds for one in crowd.passes] == [one.track_id for one in problem.passes]
    backs = looked_back_at(problem, crowds)
    assert len(backs[0]) == 0 and all(len(back) <= len(problem.law.own) - 1 for back in backs)
    backward = replace(problem, passes=problem.passes[::-1], traffic=Traffic.of(problem.passes[::-1]))
    assert one_by_one(backward) == [backward]


@pytest.mark.parametrize("kept", [1e9, 0.0])
def test_a_visit_is_that_of_one_problem(problem: Problem, kept: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where derivatives are computed twice since there is no room for them."""
    monkeypatch.setattr(convoy, "KEPT", kept)
    chain, whole = Chain.of(problem), Chain.single(MapFit(problem))
    assert len(chain.links) == 4 and len(whole.links) == 1
    assert any(len(link.back) for link in chain.links) == (len(problem.law.own) > 1)
    state = chain.start()
    torch.testing.assert_close(state.vector(), whole.start().vector(), rtol=1e-9, atol=0.0)
    first, expected = chain.visit(state), whole.visit(state)
    moved = chain.stepped(first.state, first.open.step(1e-2))
    steps = whole.stepped(expected.state, expected.open.step(1e-2)).vector() - state.vector()
    torch.testing.assert_close(moved.vector() - state.vector(), steps, rtol=1e-6, atol=1e-9 * float(steps.abs().max()))
    second, expected = chain.visit(moved, first.weights), whole.visit(moved, expected.weights)
    assert second.cost == pytest.approx(expected.cost, rel=1e-10)
    assert second.misfit == pytest.approx(expected.misfit, rel=1e-10)
    assert second.normal.decrement == pytest.approx(expected.normal.decrement, rel=1e-7)
    assert chain.cost(second) == pytest.approx(whole.cost(expected), rel=1e-10)
    torch.testing.assert_close(second.state.vehicles.amplitude, expected.state.vehicles.amplitude, rtol=1e-9, atol=0.0)
    assert chain.settled(moved)[1] == pytest.approx(whole.settled(moved)[1], rel=1e-10)


def test_very_many_passes_part_their_noise(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solver.fit.stretches.TOGETHER", 2)
    backs = looked_back_at(problem, one_by_one(problem))
    assert len(backs[2]) == 0
    assert max(len(one) for one in Chain.of(problem).convoys) <= 2


def test_a_whitener_that_looks_back_gives_the_rest_of_the_whole() -> None:
    values = torch.from_numpy(np.random.default_rng(1).normal(size=(90, 5)))
    level, channel = torch.linspace(1, 2, 5, dtype=torch.float64), np.arange(5)
    samples = np.append(np.arange(70), np.arange(80, 100))
    whole = Whitener(level, samples, channel, LAW)(values)
    torch.testing.assert_close(Whitener(level, samples[21:], channel, LAW, 29)(values[21:]), whole[50:])
