"""Of many passes those are taken with which the variances fall most."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch

from solver.fit.chain import Chain
from solver.fit.choice import Choice, Informed, choose, greedy
from solver.fit.held_out import held_out
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.some_passes import alone_samples, only
from solver.fit.stretches import part
from solver.signal_path.traffic import Traffic
from solver.trajectory.vehicle_pass import Pass

RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def tiny() -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Three numbers, seven observations of one or two of their mixtures, and two kinds of what is to be known."""
    rows = [RNG.normal(size=(1 + i % 2, 3)) * (1 + i) for i in range(7)]
    return np.diag([1.0, 0.5, 2.0]), [one.T @ one for one in rows], [np.eye(3)[:2], RNG.normal(size=(2, 3))]


def left(tiny: tuple, chosen: tuple[int, ...]) -> float:
    """Mean ln variance after the observations chosen, from the dense posterior."""
    prior, informations, targets = tiny
    covariance = np.linalg.inv(prior + sum((informations[i] for i in chosen), np.zeros((3, 3))))
    return float(np.mean([np.mean([np.log(row @ covariance @ row) for row in target]) for target in targets]))


def test_each_step_takes_what_brute_force_takes(tiny: tuple) -> None:
    taken = greedy(*tiny, fewest=4, most=4)
    chosen: tuple[int, ...] = ()
    for one in taken:
        best = min((i for i in range(7) if i not in chosen), key=lambda i: left(tiny, (*chosen, i)))
        assert one.number == best
        assert one.falls.mean() == pytest.approx(left(tiny, chosen) - left(tiny, (*chosen, best)))
        chosen = (*chosen, best)
    every = [left(tiny, some) for some in combinations(range(7), 4)]
    # Nothing that was left out would have been much better.
    assert left(tiny, chosen) - min(every) < 0.1 * (max(every) - min(every))


def test_enough_is_enough(tiny: tuple) -> None:
    assert len(greedy(*tiny, fewest=1, most=7, worth=1e9)) == 1
    assert len(greedy(*tiny, fewest=3, most=7, worth=1e9)) == 3
    assert len(greedy(*tiny, fewest=1, most=7, worth=0.0)) == 7
    worth = greedy(*tiny, fewest=1, most=7, worth=0.0)[3].falls.mean()
    assert len(greedy(*tiny, fewest=1, most=7, worth=worth * 0.999)) == 4


def test_where_others_are_near_nothing_is_measured(case) -> None:
    problem = case.problem
    few = only(problem, [1, 3])
    assert [one.track_id for one in few.passes] == [problem.passes[i].track_id for i in (1, 3)]
    others = np.unique(np.concatenate([problem.passes[i].rows for i in (0, 2)]))
    assert np.isnan(few.record[others]).all() and np.isfinite(problem.record).all()
    rest = np.setdiff1d(np.arange(len(few.record)), others)
    np.testing.assert_array_equal(few.record[rest], problem.record[rest])
    assert np.isin(np.concatenate([one.rows for one in few.passes]), few.traffic.samples).all()


def test_the_information_of_a_pass_is_what_it_adds_to_the_normal_equations(case) -> None:
    one = part(case.problem, np.array([2]))
    found = Informed.of(MapFit(one))
    chain, state = found.chain, found.state
    matrix, _ = chain.dense(state, [chain.links[0].fit.linearized(state)])
    normal = chain.visit(state).normal
    shared = np.concatenate([np.arange(chain.size), chain.border.numpy()])
    where = np.searchsorted(np.sort(torch.nonzero(chain.free).flatten().numpy()), shared)
    covariance = np.linalg.inv(matrix.numpy())[np.ix_(where, where)]
    count = normal.size + normal.border
    known = found.prior[:count, :count] - np.diag(np.append(np.full(normal.size, 0.01), np.zeros(normal.border)))
    np.testing.assert_allclose(
        np.linalg.inv(covariance), known + found.matrix[:count, :count], rtol=1e-5, atol=1e-5 * np.abs(known).max()
    )


def crowded(problem: Problem, copies: int) -> Problem:
    """Every pass of a survey several times, one after the other; the second of them is never alone."""
    length, passes, records = len(problem.record), list[Pass](), []
    for copy in range(copies):
        for one in problem.passes:
            passes.append(replace(one, track_id=f"{one.track_id}.{copy}", rows=one.rows + copy * length))
        records.append(problem.record)
    passes.insert(2, replace(passes[1], track_id="beside"))
    return replace(problem, record=np.concatenate(records), passes=passes, traffic=Traffic.of(passes))


@pytest.fixture(scope="module")
def many(case) -> tuple[Problem, Choice]:
    """Five fifths of the same four vehicles, and what is chosen."""
    every = slice(None, None, 3)
    sparse = replace(
        case.problem,
        record=case.problem.record[:, every],
        noise=case.problem.noise[every],
        channel=case.problem.channel[every],
        start=case.problem.start[every],
    )
    problem = crowded(sparse, 5)
    return problem, choose(problem, fewest=6, most=6)


def test_both_ways_and_only_those_alone(many) -> None:
    problem, choice = many
    assert len(choice.taken) == 6 and choice.passes is problem.passes
    alone = alone_samples(problem.passes)
    assert not alone[1].any() and not alone[2].any()
    assert not {1, 2} & set(choice.numbers)
    assert len({problem.passes[i].speed > 0 for i in choice.numbers[:3]}) == 2
    falls = [float(one.falls.mean()) for one in choice.taken]
    assert falls == sorted(falls, reverse=True) and falls[-1] > 0
    assert choice.names == ["route", "depth", "ground"]
    assert len(choice.missing) == 4 and all((one > 0).all() for _, one in choice.missing)


def test_one_way_alone_leaves_open_what_tracks_are_off_by_alike(many) -> None:
    """Of vehicles that all go one way, one the other way is what is missing most of all that differs in that alone."""
    problem, _ = many
    one_way = [i for i, one in enumerate(problem.passes) if one.speed > 0 and i not in (1, 2)]
    choice = choose(only(problem, one_way), fewest=4, most=4)
    missing = dict(choice.missing)
    assert "toward -x" in missing
    another = choose(only(problem, one_way), fewest=5, most=5).taken[-1]
    assert float(missing["toward -x"].mean()) > float(another.falls.mean())


def test_passes_that_were_never_fitted_test_the_route(many) -> None:
    problem, choice = many
    assert not set(choice.others) & {1, 2, *choice.numbers}
    few = only(problem, choice.numbers)
    chain = Chain.of(few)
    end = solve(chain, chain.start())
    unseen = held_out(few, at=(chain, end.state), rest=only(problem, choice.others[:4]))
    assert unseen is not None and 0.85 < unseen.chi2_per_dof < 1.2
