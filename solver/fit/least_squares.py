"""Levenberg-Marquardt on a chain of maximum a posteriori problems."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.mixing import Taken, mixed
from solver.fit.state import State
from solver.fit.visit import Visit

log = logging.getLogger("roadfiber.fit")

#: A step that would gain less than this in sigmas, over all parameters together, is not worth taking.
ENOUGH = 0.2
#: Of the first step, as a share of the normal matrix's diagonal, and of one after a step that failed, at least.
DAMPING = 1e-3
#: Numbers that a fit of a camera's view has, about.
USUAL = 100
#: Steps before a fit may be given up, and falls as predicted that it may hope for.
PATIENCE = 5


@dataclass(frozen=True)
class Solution:
    """Where Levenberg-Marquardt ended, and how.

    Parameters
    ----------
    iterations : steps it took
    converged : nothing is left to gain
    at : the problem there
    damping : of the next step
    last : the step that led there
    """

    iterations: int
    converged: bool
    at: Visit
    damping: float
    last: Taken | None = None

    @property
    def state(self) -> State:
        """What was fitted."""
        return self.at.state


def solve(
    fit: MapFit | Chain,
    start: State | Solution,
    iterations: int = 60,
    advance: Callable[[int], None] = lambda n: None,
    hopeless: float = float("inf"),
) -> Solution:
    """Levenberg-Marquardt (Marquardt 1963) until the Newton decrement is small.

    The decrement, sqrt(g' H^-1 g) with gradient g and normal matrix H, is the length of the next step in posterior
    sigmas and the norm of what is left of the residual along all that is fitted: nothing else is called converged.
    Where steps converge slowly each is mixed with the one before, see `mixed`.

    Parameters
    ----------
    start : a state, or where an earlier call ended
    iterations : at most
    advance : called with 1 before each step
    hopeless : chi2; a fit that does not approach it is given up
    """
    chain = fit if isinstance(fit, Chain) else Chain.single(fit)
    if isinstance(start, Solution):
        at, damping, last = start.at, start.damping, start.last
    else:
        at, damping, last = chain.visit(start, chain.unsettled(start)), DAMPING, None
    taken = 0
    cost = at.misfit + chain.prior.total(at.state)
    # On a long fiber the steps of thousands of numbers add up: each may be as far from its end as a short fiber's.
    enough = ENOUGH * (float(chain.free.sum()) / USUAL) ** 0.5 if chain.long else ENOUGH
    while not (converged := (left := at.open.decrement) < enough) and taken < iterations and damping < 1e8:
        # A quadratic misfit would fall by the decrement squared; this one by a few times that at most.
        if taken >= PATIENCE and at.misfit - PATIENCE * left**2 > hopeless:
            break
        taken += 1
        advance(1)
        step = at.open.step(damping)
        better = mixed(at.open, step, last)
        candidate = chain.stepped(at.state, better or step)
        new = chain.tried(candidate, at.weights, cost) if chain.buried(candidate) else None
        # Where a route nearly stands still, equations are singular to rounding: from there no step leads on.
        if new is None or new.cost > cost or not np.isfinite(new.open.decrement):
            damping, last = damping if better else max(8 * damping, DAMPING), None
            continue
        damping, last = max(damping / 8, 1e-9), Taken.of(at.open, step, better or step)
        at, cost = new, new.misfit + chain.prior.total(new.state)
        told = names(chain), len(chain.problem.passes), taken, at.misfit / samples(chain)
        log.debug("fit with %s, %d passes: step %d, chi2 per sample %.4f", *told)
    return Solution(taken, converged, at, damping, last)


def names(chain: Chain) -> str:
    """Effects in the model, by comma."""
    return ", ".join(one.name for one in chain.problem.effects)


def samples(chain: Chain) -> int:
    """Measured samples that are fitted."""
    return max(sum(int(link.fit.measured.sum()) for link in chain.links), 1)
