"""Refits with a candidate in the model: what the score test predicts, confirmed in full."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.score import Score, evidence
from solver.effects.effect import Effect
from solver.fit.least_squares import HUBER, MapFit, Solution, State, solve
from solver.fit.problem import Problem

#: Steps of each round of the race, and how many go on after it.
ROUNDS = ((4, 4), (5, 3), (20, 3))


def loss(fit: MapFit, state: State, good: Tensor) -> float:
    """Robust misfit plus priors: Huber's loss of the whitened residual, so that fits can be compared.

    Parameters
    ----------
    good : [sample, channel], samples that count; the same for all fits that are compared
    """
    difference = torch.where(fit.measured, fit.data - fit.model(state), 0.0)
    size = (fit.whiten(difference * good) * good).abs()
    misfit = torch.where(size < HUBER, size**2, 2 * HUBER * size - HUBER**2).sum()
    return float(misfit) + fit.belief(state)


@dataclass(frozen=True)
class Refit:
    """A fit with a candidate in the model.

    Parameters
    ----------
    effect : the candidate
    fit, solution : with it
    fall : how far the robust misfit fell
    evidence : ln of the Bayes factor, from that fall
    estimate : [number], its numbers without its shape's
    """

    effect: Effect
    fit: MapFit
    solution: Solution
    fall: float
    evidence: float
    estimate: NDArray[np.float64]


def with_effect(problem: Problem, effect: Effect) -> Problem:
    """The same survey with one more effect in its model."""
    return replace(problem, effects=(*problem.effects, effect))


def amplitudes(fit: MapFit, state: State) -> NDArray[np.float64]:
    """Numbers [number] of the last effect in the model, those of its shape left out."""
    slots = [s for s in fit.extension.slots if s.effect is fit.extension.effects[-1] and not s.parameter.is_shape]
    return np.concatenate([state.numbers[slot.where].numpy() for slot in slots])


def started(fit: MapFit, state: State, score: Score) -> State:
    """The state of a fit without the candidate, moved toward the score test's estimate as far as the misfit falls."""
    extension = fit.extension
    slots = [slot for slot in extension.slots if slot.effect is score.effect]
    base = extension.numbers({score.effect.name: score.shape})
    base[: len(state.numbers)] = state.numbers
    change = torch.zeros_like(base)
    estimate = torch.from_numpy(score.estimate)
    first = 0
    for slot in slots:
        if slot.parameter.is_shape:
            continue
        count = slot.where.stop - slot.where.start
        if score.shared and slot.parameter.scope == "pass":
            change[slot.where] = estimate[first]
            first += 1
        else:
            change[slot.where] = estimate[first : first + count]
            first += count
    change = torch.nan_to_num(change).clamp(-1e6, 1e6)
    every = fit.linearized(replace(state, numbers=base)).weights
    best = replace(state, numbers=base)
    cost = np.inf
    for step in (1.0, 0.5, 0.2, 0.05):
        trial = fit.bounded(replace(state, numbers=base + step * change))
        trial = fit.settled(trial, every)
        new = fit.cost(trial, every)
        if new < cost:
            best, cost = trial, new
    return best


def race(
    fit: MapFit,
    state: State,
    scores: Sequence[Score],
    before: float,
    good: Tensor,
    advance: Callable[[int], None] = lambda n: None,
) -> dict[str, Refit]:
    """Fit everything again with each candidate in the model; those that fall behind stop early.

    The score test says how the misfit falls at first; where an effect is large, or the route has absorbed it, only full
    fits tell. All take a few steps, the better half goes on, the best two to the end.

    Parameters
    ----------
    fit, state : without the candidates, converged
    scores : of the candidates
    before : `loss` of the fit without them
    good : [sample, channel], samples that count
    """
    if not scores:
        return {}
    fits = {score.effect.name: MapFit(with_effect(fit.problem, score.effect)) for score in scores}
    by_name = {score.effect.name: score for score in scores}
    states = {name: started(fits[name], state, by_name[name]) for name in fits}
    solutions: dict[str, Solution] = {}
    falls: dict[str, float] = {}
    running = list(fits)
    favorite = scores[0].effect.name

    def standing(name: str) -> float:
        return evidence(falls[name], by_name[name].freedom, by_name[name].trials)

    for steps, kept in ROUNDS:
        for name in running:
            if name not in solutions or not solutions[name].converged:
                solutions[name] = solve(fits[name], states[name], iterations=steps)
                states[name] = solutions[name].state
                falls[name] = before - loss(fits[name], states[name], good)
            advance(1)
        running.sort(key=standing, reverse=True)
        # One with many numbers starts slowly: the favorite of the score test runs to the end.
        running = list(dict.fromkeys([*running[:kept], favorite]))
    return {
        name: Refit(
            by_name[name].effect,
            fits[name],
            solutions[name],
            falls[name],
            standing(name),
            amplitudes(fits[name], states[name]),
        )
        for name in fits
    }
