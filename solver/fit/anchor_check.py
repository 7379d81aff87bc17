"""Anchors that contradict each other or the rest of the survey: which one, and by how much."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.special import chdtri

from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.problem import Problem
from solver.fit.result import Corner, FitResult
from solver.survey.anchors import Anchor
from solver.trajectory.agreement import WHERE_FROM

#: Chance that good anchors are called contradictory.
ALARM = 1e-4
#: Fall of -2 ln posterior by which leaving out one anchor must beat leaving out another to say which is wrong.
DECISIVE = 9.0
#: Anchors with less than this share of the contradiction are not suspected.
SUSPECT = 0.1


@dataclass(frozen=True)
class LeftOut:
    """A fit without one anchor.

    Parameters
    ----------
    anchor : that was left out
    cost : -2 ln posterior of the rest, but for a constant
    distance : of the anchor from the route without it, m
    """

    anchor: Anchor
    cost: float
    distance: float


def misses(problem: Problem, result: FitResult) -> np.ndarray:
    """Squared misfit [anchor] of the fitted route at each anchor, in its sigmas; 3 degrees of freedom."""
    if not problem.anchors:
        return np.empty(0)
    at = np.array([a.channel for a in problem.anchors])
    route = np.column_stack([np.interp(at, result.channel, column) for column in result.route.T])
    known = np.array([[a.x, a.y, a.z] for a in problem.anchors])
    sigma = np.array([[a.sigma_xy, a.sigma_xy, a.sigma_z] for a in problem.anchors])
    return np.asarray((((known - route) / sigma) ** 2).sum(1))


def disagree(problem: Problem, result: FitResult) -> bool:
    """Whether anchors are off a fit by more than good ones are in all but one of 10,000 surveys."""
    square = misses(problem, result)
    return bool(len(square) and square.sum() >= chdtri(3 * len(square), ALARM))


def without(problem: Problem, result: FitResult, anchor: Anchor) -> LeftOut:
    """Fit again without an anchor, from where the fit with it ended."""
    rest = replace(problem, anchors=[a for a in problem.anchors if a is not anchor])
    # The same span, so that costs compare.
    fit = Chain.of(rest, basis=problem.basis)
    found = solve(fit, fit.state_of(torch.from_numpy(result.vector)))
    end = found.state
    at, _, _ = fit.prior.led(end, problem.distance_of([anchor.channel]))
    place = fit.basis.along(end.coefficients.numpy(), at.numpy())[0]
    cost = found.at.misfit + fit.prior.total(end)
    return LeftOut(anchor, cost, float(np.linalg.norm(place - [anchor.x, anchor.y, anchor.z])))


@dataclass(frozen=True)
class Contradiction:
    """Anchors that cannot all be right.

    Parameters
    ----------
    suspects : the one that is wrong, or those of which one is
    distance : m, of the first from where all else puts the fiber
    others : whether there are anchors that are not suspected
    corner : of the fiber, by these, nearest to it; None where there is none
    """

    suspects: tuple[Anchor, ...]
    distance: float
    others: bool = True
    corner: Corner | None = None

    @property
    def sentence(self) -> str:
        """What a user should read."""
        names = ", ".join(sorted(one.name for one in self.suspects))
        else_ = "" if self.others else f", {WHERE_FROM}"
        if len(self.suspects) > 1:
            return (
                f"anchors {names} contradict each other, or the tracks ({self.distance:.2f} m), and nothing tells "
                f"which is wrong; check their channels and coordinates{else_}"
            )
        rest = "the other anchors and the tracks put" if self.others else "the tracks put"
        turning = f", which {self.corner.words}" if self.corner else ""
        return (
            f"anchor {names} is {self.distance:.2f} m from where {rest} the fiber{turning}; check its channel and "
            f"coordinates{else_}"
        )


def contradiction(
    problem: Problem, result: FitResult, advance: Callable[[int], None] = lambda n: None
) -> Contradiction | None:
    """Find out which anchor is wrong, or which may be; None where all agree.

    Anchors whose joint misfit good ones reach once in 10,000 surveys are left out one by one. The posterior of all the
    rest decides: where leaving out one explains the rest better than leaving out any other does, it is the wrong one.

    Parameters
    ----------
    problem, result : the survey and its fit
    advance : called with 1 after each fit
    """
    if not disagree(problem, result):
        return None
    square, fits = misses(problem, result), []
    for anchor, share in zip(problem.anchors, square / square.sum(), strict=True):
        if share > SUSPECT:
            fits.append(without(problem, result, anchor))
        advance(1)
    fits.sort(key=lambda one: one.cost)
    suspects = tuple(one.anchor for one in fits if one.cost - fits[0].cost < DECISIVE)
    turns = [one for one in result.corners if one.kind == "corner"]
    corner = min(turns, key=lambda one: abs(one.channel - suspects[0].channel), default=None)
    return Contradiction(suspects, fits[0].distance, len(suspects) < len(problem.anchors), corner)
