"""How well a route found from some passes explains the passes it never saw."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from solver.fit.least_squares import MapFit, State, solve
from solver.fit.problem import Problem
from solver.model import Traffic, Vehicles

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


def shared_numbers(fit: MapFit, state: State, new: MapFit) -> torch.Tensor:
    """Numbers of the effects that all passes share, for a fit of other passes; those of single passes at their null."""
    numbers = new.extension.numbers()
    for old, slot in zip(fit.extension.slots, new.extension.slots, strict=True):
        if slot.parameter.scope not in ("pass", "track"):
            numbers[slot.where] = state.numbers[old.where]
    return numbers


def carried(fit: MapFit, state: State, chosen: np.ndarray, new: MapFit) -> State:
    """A state of all passes as a start for a fit of those `chosen`; what is smooth along a pass begins at null."""
    numbers = shared_numbers(fit, state, new)
    for old, slot in zip(fit.extension.slots, new.extension.slots, strict=True):
        if slot.parameter.scope == "pass":
            numbers[slot.where] = state.numbers[old.where][torch.from_numpy(chosen)]
    fields_of = vars(state.vehicles)
    vehicles = Vehicles(**{name: value[torch.from_numpy(chosen)] for name, value in fields_of.items()})
    return State(state.coefficients, vehicles, state.poisson_ratio, numbers)


def held_out_chi2(
    problem: Problem,
    advance: Callable[[int], None] = lambda n: None,
    *,
    folds: int = FOLDS,
    at: tuple[MapFit, State] | None = None,
) -> float | None:
    """Chi2 per degree of freedom of held-out passes, each refitting only its own amplitude, shift and wheels.

    Passes are dealt to `folds` groups; each group is left out once, the route and all that is common to passes fitted
    to the others and then held. `advance` is called with 1 after each group.

    Parameters
    ----------
    problem : the survey
    at : where the fit of all passes ended, to begin from; from the rough route where None

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
        others = np.setdiff1d(np.arange(count), group)
        seen = MapFit(part(problem, others))
        ground = solve(seen, seen.start() if at is None else carried(*at, others, seen)).state
        unseen = MapFit(part(problem, group), known_ground=True)
        numbers = shared_numbers(seen, ground, unseen)
        end = solve(unseen, unseen.start_at(ground.coefficients, ground.poisson_ratio, numbers)).state
        alone = own_samples(problem, group)
        weights = unseen.normal(end)[2]
        # What held-out passes are shifted or changed by is misfit too: a clock that is off shows there.
        misfit += float((unseen.whitened(end, weights)[alone] ** 2).sum()) + unseen.prior_cost(end)
        freedom += float((weights.good * weights.soft)[alone].sum()) - int(unseen.free.sum())
        advance(1)
    return misfit / freedom if freedom > 0 else None
