"""One route from several surveys of a fiber, each with its own record, noise and vehicles.

The normal equations of all are summed, priors and anchors counted once: the same as one fit of all passes, which an
average of the routes is not (Bierman 1977, Factorization Methods for Discrete Sequential Estimation, chapter 2).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from solver.fit.chain import Chain
from solver.fit.least_squares import Solution, solve
from solver.fit.links import linked
from solver.fit.map_fit import MapFit
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.state import State
from solver.fit.stretches import is_long, looked_back_at, one_by_one, parts
from solver.signal_path.traffic import Traffic, Vehicles


def whole_of(problems: Sequence[Problem]) -> Problem:
    """What the surveys have together: channels, passes, anchors, and where a route begins; no record.

    The route begins at the mean of theirs, each channel counting where it was fitted.
    """
    first = problems[0]
    channel = np.unique(np.concatenate([one.channel for one in problems]))
    start, count = np.zeros((len(channel), 3)), np.zeros((len(channel), 1))
    for one in problems:
        at = np.searchsorted(channel, one.channel)
        start[at] += one.start
        count[at] += 1
    passes = [one for problem in problems for one in problem.passes]
    anchors = {(a.name, a.channel): a for problem in problems for a in problem.anchors}
    return replace(
        first,
        record=np.full((0, len(channel)), np.nan),
        noise=torch.ones(len(channel), dtype=torch.float64),
        channel=channel,
        passes=passes,
        traffic=Traffic.of(passes),
        anchors=list(anchors.values()),
        start=start / count,
        knots=max((one.knots for one in problems), key=len),
    )


def joint_chain(problems: Sequence[Problem]) -> Chain:
    """The crowds of all surveys along one route; on a long fiber those of each stretch, as its fits have them."""
    whole = whole_of(problems)
    if is_long(whole):
        return Chain.of(whole, groups=[stretch for one in problems for stretch in parts(one)])
    groups = [one_by_one(one) for one in problems]
    backs = [back for one, group in zip(problems, groups, strict=True) for back in looked_back_at(one, group)]
    return Chain(whole, *linked(whole, groups, whole.basis, False, backs))


def fitted(problem: Problem) -> Chain | MapFit:
    """What a survey was fitted as by itself."""
    return Chain.of(problem) if is_long(problem) else MapFit(problem)


def joint_start(chain: Chain, problems: Sequence[Problem], results: Sequence[FitResult]) -> State:
    """The mean route, and every vehicle as its own survey's fit left it; numbers of effects as they begin."""
    ends = zip(problems, results, strict=True)
    states = [fitted(one).state_of(torch.from_numpy(found.vector)) for one, found in ends]
    begun = torch.from_numpy(chain.basis.interpolate(chain.problem.distance, chain.problem.start))
    fields = Vehicles.of(chain.passes).__dict__
    vehicles = Vehicles(**{name: torch.cat([getattr(one.vehicles, name) for one in states]) for name in fields})
    ratio = torch.stack([one.poisson_ratio for one in states]).mean()
    return State(begun, vehicles, ratio, chain.prior.numbers.mean)


def joint_fit(problems: Sequence[Problem], results: Sequence[FitResult]) -> tuple[Chain, Solution]:
    """Fit one route to several surveys, from where the fit of each ended.

    Parameters
    ----------
    problems : of one fiber, in one frame, with the same effects; `start` is where each fit ended
    results : of each
    """
    chain = joint_chain(problems)
    return chain, solve(chain, joint_start(chain, problems, results))
