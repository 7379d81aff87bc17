"""How well a route found from some passes explains the passes it never saw."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from solver.fit.least_squares import MapFit, solve
from solver.fit.problem import Problem
from solver.model import Traffic

FOLDS = 2


def part(problem: Problem, chosen: np.ndarray) -> Problem:
    """The same survey with the passes `chosen` only."""
    passes = [problem.passes[i] for i in chosen]
    traffic = Traffic.of(passes)
    return replace(problem, passes=passes, traffic=traffic)


def own_samples(problem: Problem, chosen: np.ndarray) -> torch.Tensor:
    """Samples [sample] of `part(problem, chosen)` in which no other vehicle is within reach."""
    rest = np.concatenate([problem.passes[i].rows for i in range(len(problem.passes)) if i not in chosen])
    mine = np.unique(np.concatenate([problem.passes[i].rows for i in chosen]))
    return torch.from_numpy(~np.isin(mine, rest))


def held_out_chi2(
    problem: Problem, advance: Callable[[int], None] = lambda n: None, *, folds: int = FOLDS
) -> float | None:
    """Chi2 per degree of freedom of held-out passes, each refitting only its own amplitude, shift and wheels.

    Passes are dealt to `folds` groups; each group is left out once, the route fitted to the others and then held.
    `advance` is called with 1 after each group.

    Returns
    -------
    None where there are fewer than two passes, or never one vehicle alone
    """
    count = len(problem.passes)
    if count < 2:
        return None
    misfit = freedom = 0.0
    groups = [np.arange(first, count, min(folds, count)) for first in range(min(folds, count))]
    for group in groups:
        seen = MapFit(part(problem, np.setdiff1d(np.arange(count), group)))
        ground = solve(seen, seen.start()).state
        held = part(problem, group)
        unseen = MapFit(held, known_ground=True)
        end = solve(unseen, unseen.start_at(ground.coefficients, ground.poisson_ratio)).state
        alone = own_samples(problem, group)
        weights = unseen.normal(end)[2]
        misfit += float((unseen.whitened(end, weights)[alone] ** 2).sum())
        freedom += float((weights.good * weights.soft)[alone].sum()) - int(unseen.free.sum())
        advance(1)
    return misfit / freedom if freedom > 0 else None
