"""How well a route found from some passes explains the passes it never saw."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from solver.fit.carried import carried, carried_with_vehicles, chained, legs, slots_of
from solver.fit.chain import Chain, Link
from solver.fit.least_squares import Solution, solve
from solver.fit.map_fit import MapFit
from solver.fit.numbers import SINGLE
from solver.fit.posterior import Posterior
from solver.fit.problem import Problem
from solver.fit.side_by_side import side_by_side
from solver.fit.state import State
from solver.fit.stretches import FIRST, is_long, nearby, part, parts, some
from solver.fit.track_trust import strict_tracks, track_spread
from solver.survey.limits import vehicle_reach
from solver.trajectory.vehicle_pass import Pass

FOLDS = 2
#: Standard deviations of chi2 from its mean at which an effect shows in the passes that are seen.
SHOWN = 2.0
#: The fit of all passes, and where it ended.
Whole = tuple[Chain, State]


@dataclass(frozen=True)
class HeldOut:
    """Misfit of passes that a fit has not seen.

    Parameters
    ----------
    chi2 : misfit, the cost of each pass's own numbers included
    freedom : degrees of freedom
    blurred, blur : part of `chi2` that the uncertainty of route and ground adds, and its variance beyond that of noise;
        few passes leave much, however right the model
    """

    chi2: float
    freedom: float
    blurred: float
    blur: float

    @property
    def chi2_per_dof(self) -> float:
        """Misfit per degree of freedom."""
        return self.chi2 / self.freedom


def own_samples(link: Link, others: Sequence[Pass]) -> torch.Tensor:
    """Samples [sample] of a link in which no other vehicle is within reach."""
    problem = link.fit.problem
    reach = vehicle_reach(problem.gauge_length)
    near = [found.rows for one in others if (found := nearby(one, problem.start, reach)) is not None]
    mine = np.unique(np.concatenate([one.rows for one in problem.passes]))
    rest = np.concatenate([np.setdiff1d(problem.traffic.samples, mine), *near])
    return torch.from_numpy(~np.isin(problem.traffic.samples, rest))


def unshown(chain: Chain, end: Solution) -> list[str]:
    """Effects with numbers common to all passes that a fit cannot tell from zero (Wald 1943, Trans. AMS 54, 426).

    Of sizes of single passes each counts by itself.
    """
    every = list(zip(slots_of(chain), chain.slots, strict=True))
    posterior, numbers = Posterior(chain, end.at), chain.layout.where("numbers")
    found = []
    for effect in chain.links[0].fit.extension.effects:
        if all(p.scope in SINGLE for p in effect.parameters):
            continue
        mine = [(slot, where) for slot, where in every if slot.effect is effect and not slot.parameter.is_shape]
        away = torch.cat([end.state.numbers[where] - slot.parameter.null for slot, where in mine])
        place = numbers[torch.cat([where for _, where in mine])]
        open_ = chain.free[place]
        off = away[open_].numpy()
        if all(slot.parameter.scope in SINGLE for slot, _ in mine):
            wald = float(np.square(off / posterior.sigmas()[place[open_]].numpy()).sum())
        else:
            at = chain.rank(place[open_])
            wald = float(off @ np.linalg.solve(posterior.border_covariance[np.ix_(at, at)], off))
        if wald < len(off) + SHOWN * (2 * len(off)) ** 0.5:
            found.append(effect.name)
    return found


def by_direction(passes: Sequence[Pass]) -> np.ndarray:
    """Numbers [pass] of the passes, those of one direction first: dealt by turns, each group gets both.

    >>> from types import SimpleNamespace
    >>> by_direction([SimpleNamespace(velocity=np.array([[v, 0.1]])) for v in (9.0, -12.0, 15.0, -17.0)]).tolist()
    [0, 2, 1, 3]
    """
    velocity = np.array([one.velocity.mean(0) for one in passes])
    return np.argsort(velocity @ velocity[0] < 0, kind="stable")


@dataclass(frozen=True)
class Fold:
    """Chains of the fitted passes, of those held out with the ground fixed, and of the latter with the ground free.

    `rest` are fitted passes that share samples with those held out.
    """

    seen: Chain
    held: Chain
    free: Chain
    rest: Sequence[Pass]

    @classmethod
    def of(cls, problem: Problem, group: np.ndarray) -> "Fold":
        """Of a group [pass] that is held out."""
        others = np.setdiff1d(np.arange(len(problem.passes)), group)
        mine = part(problem, group)
        seen = Chain.of(part(problem, others))
        return cls(seen, Chain.of(mine, known_ground=True), Chain.of(mine), [problem.passes[i] for i in others])

    @classmethod
    def dealt(cls, problem: Problem) -> "Fold":
        """Of a long fiber: the crowds of each stretch are dealt out in turn, and some of each half suffice."""
        seen, held = (
            [some(mine, FIRST) for stretch in parts(problem) if (mine := stretch[first::FOLDS])] for first in (1, 0)
        )
        free = Chain.of(problem, groups=held)
        return cls(Chain.of(problem, groups=seen), Chain.of(problem, known_ground=True, groups=held), free, [])

    @classmethod
    def apart(cls, problem: Problem, rest: Problem) -> "Fold":
        """Of passes that no fit was ever given: a problem of its own, over the same channels."""
        basis = problem.basis
        held, free = Chain.of(rest, known_ground=True, basis=basis), Chain.of(rest, basis=basis)
        return cls(Chain.of(problem), held, free, problem.passes)

    def fitted(self, whole: Whole | None) -> Solution:
        """Fit the passes that are seen, from where the fit of all ended."""
        return solve(self.seen, carried_with_vehicles(whole, self.seen) if whole else self.seen.start())

    def ended(self, ground: Solution, whole: Whole | None) -> Solution:
        """Fit of what the held-out passes have of their own, on the route and ground that the others found."""
        held = self.held
        start = carried((self.seen, ground.state), held)
        if whole and set(legs(held)) <= set(legs(whole[0])):
            start = replace(start, vehicles=carried_with_vehicles(whole, held).vehicles)
        return solve(held, start)

    def alone(self) -> list[torch.Tensor]:
        """Samples [sample] of each link in which no fitted vehicle is within reach."""
        return [own_samples(link, self.rest) for link in self.held.links]

    def judged(self, ground: Solution, end: Solution) -> HeldOut:
        """Misfit of the held-out passes where their own fit ended."""
        held = self.held
        # What held-out passes are shifted or changed by is misfit too: a clock that is off shows there.
        misfit, freedom, every = held.prior.cost(end.state), -float(held.free.sum()), 0.0
        for alone, residual, weights in zip(self.alone(), end.at.residuals, end.at.weights, strict=True):
            misfit += float((residual[alone] ** 2).sum())
            counts = weights.good * weights.soft
            freedom, every = freedom + float(counts[alone].sum()), every + float(counts.sum())
        share = np.clip(freedom / max(every, 1.0), 0.0, 1.0)
        mean, variance = blur(ground, self.seen, self.free, end.state)
        return HeldOut(misfit, freedom, share * mean, share * variance)


def blur(ground: Solution, seen: Chain, free: Chain, at: State) -> tuple[float, float]:
    """Misfit that the uncertain ground adds to held-out passes: mean, and variance beyond that of the noise.

    With the covariance C that the passes `seen` leave, and the information A that the others have of the same numbers,
    after eliminating their own: tr(A C), and 2 tr(A C A C) + 4 tr(A C) (Seber and Lee 2003, Linear Regression Analysis,
    1.5).

    Parameters
    ----------
    ground : where the fit of those seen ended
    free : chain of those held out, the ground not held
    at : where they ended
    """
    normal, known = free.visit(at).normal, Posterior(seen, ground.at)
    mean = square = 0.0
    for number, block in enumerate(normal.blocks):
        information = block.matrix.copy()
        for own in (one for one in normal.parts if one.stretch == number):
            information -= own.cross.T @ np.linalg.solve(own.own, own.cross)
        where = block.where(normal.size)
        if normal.border != ground.at.normal.border:
            # Numbers that the two do not have in common are taken for known.
            where, information = where[: block.count], information[: block.count, : block.count]
        together = information @ known.columns(where)[where]
        mean, square = mean + float(np.trace(together)), square + float(np.trace(together @ together))
    return max(mean, 0.0), 2 * square + 4 * max(mean, 0.0)


#: Makes a fold of a survey.
Make = Callable[[Problem], Fold]


def held_out(
    problem: Problem,
    advance: Callable[[int], None] = lambda n: None,
    *,
    folds: int = FOLDS,
    at: tuple[MapFit | Chain, State] | None = None,
    rest: Problem | None = None,
) -> HeldOut | None:
    """Misfit of held-out passes, each refitting only its own amplitude, shift and wheels.

    Passes are dealt to `folds` groups; each group is left out once, the route and all that is common to passes fitted
    to the others and then held. Effects that these do not show are left out of the model: they predict nothing about
    the group. Tracks may be off by as much as they differ (`strict_tracks`): free to be off by more, they would absorb
    a shift common to all, in held-out passes too. On a long fiber one group has enough samples. `advance` is called
    with 1 after each.

    Parameters
    ----------
    problem : the survey
    at : where the fit of all passes ended, to begin from; from the rough route where None
    rest : the survey with passes that were never fitted, over the same channels: they alone are the test

    Returns
    -------
    None where there are fewer than two passes, or never one vehicle alone
    """
    if len(problem.passes) < 2 and rest is None:
        return None
    whole = at and (chained(at[0]), at[1])
    spread = (track_spread(whole[0].passes, whole[1].vehicles.along.numpy()),) if whole else ()
    problem = strict_tracks(problem, *spread)
    made = dealt(problem, folds)
    if rest is not None:
        strict = strict_tracks(rest, *spread)
        made = [lambda seen: Fold.apart(seen, replace(strict, effects=seen.effects))]

    def judged(make: Make) -> HeldOut:
        fold, ground, _ = shown(make, problem, whole)
        return fold.judged(ground, fold.ended(ground, whole))

    found = side_by_side(judged, made, advance)
    freedom = sum(one.freedom for one in found)
    if freedom <= 0:
        return None
    chi2, blurred, width = (sum(getattr(one, name) for one in found) for name in ("chi2", "blurred", "blur"))
    return HeldOut(chi2, freedom, blurred, width)


def dealt(problem: Problem, folds: int = FOLDS) -> list[Make]:
    """What makes each fold of a survey: of two directions each gets passes of both."""
    if is_long(problem):
        return [Fold.dealt]
    every = by_direction(problem.passes)
    folds = min(folds, len(every))
    return [partial(Fold.of, group=np.sort(every[first::folds])) for first in range(folds)]


def shown(make: Make, problem: Problem, whole: Whole | None) -> tuple[Fold, Solution, list[str]]:
    """A fold, the fit of its passes that are seen, and the effects that these do not show and that its model lacks.

    Such an effect predicts nothing about the passes held out.
    """
    fold = make(problem)
    ground = fold.fitted(whole)
    silent = unshown(fold.seen, ground)
    if silent:
        fold = make(replace(problem, effects=tuple(one for one in problem.effects if one.name not in silent)))
        ground = fold.fitted(whole)
    return fold, ground, silent
