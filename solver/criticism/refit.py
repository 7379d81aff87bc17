"""Refits with a candidate in the model: what the score test predicts, confirmed in full."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.ending import Ending, sizes
from solver.criticism.policy import POLICY
from solver.criticism.score import Score
from solver.effect import Effect, Parameter
from solver.fit.chain import Chain
from solver.fit.least_squares import Solution
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior
from solver.fit.problem import Problem
from solver.fit.robust import HUBER
from solver.fit.state import Linearized, State, Weights
from solver.signal_path.extension import Slot

#: Times its size from where a known effect of one number is fitted a second time.
FARTHER = 2.0


def counted(fit: MapFit, at: Linearized) -> Tensor:
    """How far each whitened residual [sample, channel] counts: 0 to 1.

    Nothing where not measured or a spike; less than 1 where a track is uncertain or noise grows with the signal.
    """
    return at.weights.good / (1 + fit.added_variance(at.local, at.model)).sqrt()


def misfit(fit: MapFit, state: State, counts: Tensor, model: Tensor | None = None) -> float:
    """Huber's loss of the whitened residual, so that fits can be compared.

    Parameters
    ----------
    counts : [sample, channel], see `counted`; the same for all fits that are compared
    model : [sample, channel], 1/s, at the state, if known
    """
    model = fit.model(state) if model is None else model
    size = (fit.whiten(fit.unexplained(model) * (counts > 0)) * counts).abs()
    return float(torch.where(size < HUBER, size**2, 2 * HUBER * size - HUBER**2).sum())


def loss(fit: MapFit, state: State, counts: Tensor, model: Tensor | None = None) -> float:
    """Robust misfit plus priors; arguments as of `misfit`."""
    return misfit(fit, state, counts, model) + fit.prior.total(state)


@dataclass(frozen=True)
class Refit:
    """A fit with a candidate in the model.

    Parameters
    ----------
    score : of the candidate
    fit, solution : with it
    fall : how far the robust misfit fell
    before : how sharply the fit without it ends, as of `Ending`
    slow : what the tracks' slow errors explain beside it less what they explain without it, ln of Bayes factors; at
        most 0, and None where that is not known yet
    """

    score: Score
    fit: MapFit
    solution: Solution
    fall: float
    before: float
    slow: float | None = None

    @property
    def effect(self) -> Effect:
        """The candidate."""
        return self.score.effect

    def at(self, solution: Solution, fall: float) -> "Refit":
        """The same fit elsewhere."""
        return replace(self, solution=solution, fall=fall, slow=None)

    @property
    def evidence(self) -> float:
        """Ln of the Bayes factor, from that fall."""
        return self.standing(0.0)

    @property
    def hoped(self) -> float:
        """The evidence that it may still come to."""
        return self.standing(0.0 if self.solution.converged else POLICY.hope * self.solution.at.open.decrement**2)

    def may_reach(self, least: float, more: float) -> bool:
        """Whether it may come to that evidence: soon, or at length, if its score test says so and the fall goes on.

        Parameters
        ----------
        least : evidence
        more : fall of the misfit, if all steps that are left gain as much as late ones
        """
        return self.hoped > least or min(self.standing(more), self.score.evidence) > least

    def standing(self, more: float) -> float:
        """Evidence if the misfit fell by so much more; what numbers pay to their prior is not scaled by the noise."""
        variance, left = self.score.variance, self.ending.spectrum
        gain = (self.fall + more + self.paid) / variance - self.paid
        told = left.told(variance) - left.smaller(variance) + self.ending.sharpness - self.before
        return gain / 2 - told + (self.slow or 0.0) - float(np.log(self.score.trials))

    @cached_property
    def ending(self) -> Ending:
        """How sharply it ended."""
        return Ending.of(self.fit, self.solution.at, self.effect)

    @cached_property
    def paid(self) -> float:
        """Squares of the numbers, in plausible sizes: what they pay to their prior."""
        slots = [slot for slot in self.slots if not slot.parameter.is_shape]
        return float((sizes(slots, self.solution.state.numbers)[1] ** 2).sum())

    @property
    def estimate(self) -> NDArray[np.float64]:
        """Numbers [number] of the candidate without its shape's."""
        return np.concatenate([self.numbers(slot) for slot in self.slots if not slot.parameter.is_shape])

    @cached_property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviations [number] of those, as a run with the candidate in its model will have them.

        Of a fit that was stopped on its way, and so is no run's, they are those of its last step.
        """
        if self.fit.problem.signal_noise == 0 or not self.solution.converged:
            chain, end = Chain.single(self.fit), self.solution.at
        else:
            chain = Chain.single(MapFit(as_located(self.fit.problem)))
            end = chain.visit(self.solution.state)
        sigma = Posterior(chain, end).sigmas()
        numbers = sigma[chain.layout["numbers"]]
        every = [numbers[slot.where] for slot in self.slots if not slot.parameter.is_shape]
        return np.asarray(torch.cat(every))

    @property
    def pushed(self) -> bool:
        """Whether the fit drove it to an impossible size: one number to its bound, or many far beyond their prior."""
        sizes = [(slot.parameter, self.numbers(slot)) for slot in self.slots if not slot.parameter.is_shape]
        return any(too_large(p, size) if len(size) > 1 else not p.lower < size[0] < p.upper for p, size in sizes)

    @property
    def shape(self) -> dict[str, float]:
        """Values of its shape parameters."""
        return {slot.parameter.name: float(self.numbers(slot)[0]) for slot in self.slots if slot.parameter.is_shape}

    @property
    def single(self) -> bool:
        """Whether it is a known effect of one number, or of one for each pass, beside its shape's."""
        return not self.effect.generic and [p.scope for p in self.effect.amplitudes] in (["one"], ["pass"])

    def farther(self, weights: Weights) -> State:
        """Where it ended, with its one number farther from null and the vehicles as heavy as then fits best."""
        parameter = self.amplitude.parameter
        size = self.solution.state.numbers[self.amplitude.where]
        return self._sized(size + (FARTHER - 1) * (size - parameter.null), weights)

    def extremes(self, weights: Weights) -> list[State]:
        """The same with its one number as far from null as it can be, either way, where its bounds let it."""
        p = self.amplitude.parameter
        sizes = (
            max(p.null - POLICY.extreme * p.plausible, p.lower),
            min(p.null + POLICY.extreme * p.plausible, p.upper),
        )
        return [self._sized(size, weights) for size in sizes if size != p.null]

    def _sized(self, size: float | Tensor, weights: Weights) -> State:
        state = self.solution.state
        numbers = state.numbers.clone()
        numbers[self.amplitude.where] = size
        return self.fit.settled(self.fit.bounded(replace(state, numbers=numbers)), weights)

    @property
    def amplitude(self) -> Slot:
        """Where its first number is."""
        return next(slot for slot in self.slots if not slot.parameter.is_shape)

    @property
    def slots(self) -> list[Slot]:
        """Where its numbers are."""
        return [slot for slot in self.fit.extension.slots if slot.effect is self.effect]

    def numbers(self, slot: Slot) -> NDArray[np.float64]:
        """Numbers [number] of one parameter."""
        return np.asarray(self.solution.state.numbers[slot.where])


def too_large(parameter: Parameter, size: NDArray[np.float64]) -> bool:
    """Whether many unbounded numbers are together larger than their prior allows."""
    bounded = np.isfinite(parameter.lower) or np.isfinite(parameter.upper)
    return not bounded and float(np.sqrt(np.mean((size - parameter.null) ** 2))) > POLICY.extreme * parameter.plausible


def as_located(problem: Problem) -> Problem:
    """The survey with noise as `locate` and `add` take it.

    While effects are ranked the noise may grow with the signal; but such growth may be what a missing effect leaves.
    """
    return replace(problem, signal_noise=0.0)


def with_effect(problem: Problem, effect: Effect) -> Problem:
    """The same survey with one more effect in its model."""
    return replace(problem, effects=(*problem.effects, effect))
