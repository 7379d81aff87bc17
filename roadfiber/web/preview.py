"""An effect at a size chosen by hand: what it would leave of the residual, and where the route would go."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.catalogue.plain_words import told
from solver.criticism.plain_verdict import setting_of
from solver.criticism.refit import with_effect
from solver.criticism.route_change import route_of
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer
from solver.criticism.sums import factor_of
from solver.effect import Effect, Parameter
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.state import State
from vision.contract import InputError

Array = NDArray[np.float64]

#: Sizes, of the plausible one or of the one that fits, that can be chosen by hand.
REACH = 2.0
#: Parts of a step that are tried: what is far from where it began may not go in proportion.
PARTS = (1.0, 0.5, 0.2)
#: Fall of the misfit that is worth a step.
ENOUGH = 4.0


@dataclass(frozen=True)
class Dial:
    """A parameter that is moved by hand.

    Parameters
    ----------
    effect : its name
    name, unit : of the parameter; that of a share of a pattern where the effect has many numbers
    lower, upper, null, best : where it can be put, where the effect is absent, and where it fits best
    """

    effect: str
    name: str
    unit: str
    lower: float
    upper: float
    null: float
    best: float


@dataclass(frozen=True)
class Preview:
    """A run's model with an effect at some size.

    Parameters
    ----------
    value : of the effect's dial
    model : [sample, fitted], 1/s, in single precision
    misfit : chi2 per degree of freedom, that of the run where the effect is absent
    route : [fitted, 3], m
    sentence : the effect at that size in plain words
    """

    value: float
    model: NDArray[np.float32]
    misfit: float
    route: Array
    sentence: str


class Previews:
    """Previews of the effects that a run may lack.

    All else that was fitted follows as the normal equations of the run's fit say: at once to first order, in proportion
    to the size, and then by Gauss-Newton steps with the size held, until little is left to gain.

    Parameters
    ----------
    fit, state : of the run
    chi2_per_dof : of the run
    """

    def __init__(self, fit: MapFit, state: State, chi2_per_dof: float):
        self.fit, self.state, self.chi2_per_dof = fit, state, chi2_per_dof
        self.scorer = Scorer(fit, state)
        self.chi2 = self.scorer.at.misfit
        self._ready: dict[str, Ready] = {}
        self._rest: tuple[str, float, State] | None = None

    def dial(self, effect: Effect) -> Dial:
        """What can be moved by hand of an effect.

        Raises
        ------
        InputError
            If it is in the model already, or does nothing in this survey.
        """
        return self.ready(effect).dial

    def ready(self, effect: Effect) -> "Ready":
        """An effect with what the fit follows it by."""
        if effect.name not in self._ready:
            self._ready[effect.name] = ready(self.scorer, effect)
        return self._ready[effect.name]

    def at(self, effect: Effect, value: float, follow: bool = True) -> Preview:
        """The model with an effect at some size, with all else following to first order.

        Parameters
        ----------
        effect : to put in
        value : of its dial
        follow : let route, vehicles and ground follow; else all stays as it was fitted
        """
        one = self.ready(effect)
        share = (value - one.dial.null) / one.change
        numbers = one.base + share * one.pattern
        numbers[: len(self.state.numbers)] = self.state.numbers
        start, step = replace(self.state, numbers=numbers), torch.zeros_like(one.fit.mean)
        step[: len(one.step)] = share * one.step
        step[one.fit.layout["numbers"]] = 0.0
        at = self.lowest(one, start, step, (*PARTS, 0.0) if follow else (0.0,))
        self._rest = (effect.name, value, at.state) if follow else None
        return self.shown(effect, value, at)

    def lowest(self, one: "Ready", start: State, step: Tensor, parts: Sequence[float]) -> "Tried":
        """Where the misfit is first lowest along a step, of some parts of it, longest first, with the route buried.

        A part that is worse than a longer one ends the search: a key pressed on a slider is to be answered at once.
        """
        best: Tried | None = None
        for part in parts:
            state = one.fit.bounded(start.moved(start.vector() + part * step))
            if not one.fit.buried(state):
                continue
            tried = self.tried(one, state)
            if best is not None and tried.cost >= best.cost:
                break
            best = tried
        return best or self.tried(one, start)

    def tried(self, one: "Ready", state: State) -> "Tried":
        """A state with its model and cost."""
        model = one.fit.model(state)
        left = float((one.fit.whitened_of(model, self.scorer.at.weights) ** 2).sum())
        return Tried(state, model, left, left + one.fit.prior.total(state))

    def nearer(self, effect: Effect, value: float) -> Preview | None:
        """The same after a step more of all else, from where the last preview was; None where that gains little.

        Another size may be shown meanwhile, from another thread; then this is no longer asked for, and None.
        """
        rest = self._rest
        if rest is None or rest[:2] != (effect.name, value):
            return None
        one, at = self.ready(effect), rest[2]
        near = one.fit.linearized(at)
        matrix, right = Chain.single(one.fit).dense(at, [near])
        free = torch.nonzero(one.fit.free)[:, 0]
        mine = [torch.arange(one.fit.layout.size)[one.fit.layout["numbers"]][slot.where] for slot in one.slots]
        kept = ~torch.isin(free, torch.cat(mine))
        step = torch.zeros_like(one.fit.mean)
        step[free[kept]] = torch.cholesky_solve(right[kept][:, None], factor_of(matrix[kept][:, kept]))[:, 0]
        new = self.lowest(one, at, step, PARTS)
        gain = one.fit.cost(at, self.scorer.at.weights) - new.cost
        if self._rest is not rest:
            return None
        if not gain > ENOUGH:
            self._rest = None
            return None
        self._rest = (effect.name, value, new.state)
        return self.shown(effect, value, new)

    def shown(self, effect: Effect, value: float, tried: "Tried") -> Preview:
        """What is told of a state with an effect."""
        one, state = self.ready(effect), tried.state
        misfit = tried.left / max(self.chi2, 1e-300) * self.chi2_per_dof
        first = next(slot for slot in one.slots if not slot.parameter.is_shape)
        size = float(state.numbers[first.where].square().mean().sqrt()) if one.many else value
        said = told(effect, setting_of(self.fit.problem), estimate=size, shape=one.shape)
        return Preview(value, tried.model.numpy().astype(np.float32), misfit, route_of(one.fit, state), said.sentence)


@dataclass(frozen=True, eq=False)
class Tried:
    """A state that was tried: its model [sample, channel], 1/s, what it leaves, whitened, and that with the priors."""

    state: State
    model: Tensor
    left: float
    cost: float


@dataclass(frozen=True)
class Ready:
    """An effect whose size can be moved.

    Parameters
    ----------
    dial : what is moved
    fit : with the effect
    slots : of its parameters
    shape : values of its shape parameters
    base, pattern : [number] of all effects: where it is absent, and how they change up to where it fits best
    change : of the dial from where it is absent to there
    step : [parameter] of the fit without it, how they follow up to there
    many : whether it has many numbers
    """

    dial: Dial
    fit: MapFit
    slots: list[Any]
    shape: dict[str, float]
    base: Tensor
    pattern: Tensor
    change: float
    step: Tensor
    many: bool


def ready(scorer: Scorer, effect: Effect) -> Ready:
    """Score an effect at the end of a fit, and prepare to move it; raises as `Previews.dial`."""
    if effect.name in {one.name for one in scorer.fit.problem.effects}:
        raise InputError(f"{effect.name}: is in the model already; choose another effect")
    scores = sorted(scorer.scores(effect), key=lambda one: one.evidence)
    if not scores or not scores[-1].freedom:
        raise InputError(f"{effect.name}: does nothing in this survey; choose another effect")
    score = scorer.reaching(scores[-1])
    fit = MapFit(with_effect(scorer.fit.problem, effect))
    slots = [slot for slot in fit.extension.slots if slot.effect is effect]
    base = fit.extension.numbers({effect.name: score.shape})
    pattern = torch.zeros_like(base)
    first = 0
    for slot in slots:
        if not slot.parameter.is_shape:
            count = slot.where.stop - slot.where.start
            pattern[slot.where] = torch.nan_to_num(torch.from_numpy(score.estimate[first : first + count]))
            first += count
    step = torch.zeros_like(scorer.fit.mean)
    step[scorer.fit.free] = scorer.following(score)
    many = len(score.estimate) > 1
    dial, change = (share_dial(effect), 1.0) if many else number_dial(effect.amplitudes[0], score)
    return Ready(replace(dial, effect=effect.name), fit, slots, score.shape, base, pattern, change, step, many)


def share_dial(effect: Effect) -> Dial:
    """The dial of many numbers: how much of their pattern there is, where 1 fits best."""
    return Dial(effect.name, "share of what fits", "1", 0.0, REACH, 0.0, 1.0)


def number_dial(parameter: Parameter, score: Score) -> tuple[Dial, float]:
    """The dial of one number, and how far it is from where the effect is absent to where it fits best."""
    null, change = parameter.null, float(score.estimate[0]) or parameter.plausible
    reach = REACH * max(abs(change), parameter.plausible)
    lower, upper = max(parameter.lower, null - reach), min(parameter.upper, null + reach)
    best = float(np.clip(null + change, lower, upper))
    return Dial("", parameter.name, parameter.unit, lower, upper, null, best), change
