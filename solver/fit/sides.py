"""Whether the side of the road is known, by fits that began on either side of the traffic."""

from collections.abc import Sequence

import numpy as np

from solver.fit.problem import Problem
from solver.fit.result import FitResult

#: Fall of -2 ln posterior by which one side of the road must beat the other before it counts as known (3 sigma).
DECISIVE = 9.0
#: Chi2 beyond that of the first side from which the other is not followed to its end.
HOPELESS = 100.0
#: Least distance of two routes that are on two sides, m.
ASIDE = 0.5

End = tuple[FitResult, Problem]


def hopeless(first: FitResult) -> float:
    """Chi2 beyond which a fit from another side need not be followed to its end."""
    return first.chi2 + HOPELESS * max(1.0, first.chi2_per_dof)


def apart(one: FitResult, other: FitResult) -> bool:
    """Whether two routes differ by more than their own uncertainty."""
    shift, sigma = np.abs(one.route[:, 1] - other.route[:, 1]), other.sigma[:, 1]
    known = sigma[np.isfinite(sigma)]
    return bool(np.median(shift) > max(ASIDE, 3 * float(np.median(known)) if len(known) else 0.0))


def started_apart(one: Problem, other: Problem) -> bool:
    """Whether two fits began on different sides."""
    at, there = (np.isin(a.channel, b.channel) for a, b in ((one, other), (other, one)))
    return bool(np.median(np.abs(one.start[at, 1] - other.start[there, 1])) > ASIDE)


def is_open(best: End, other: End, steps: int) -> bool:
    """Whether the other side may be the right one: nothing rules it out.

    A fit that did not converge rules out nothing, whatever its chi2 and however wide its sigmas; but one that was given
    up since it was not about to come near the best is ruled out itself.

    Parameters
    ----------
    best, other : ends of two fits, the better one first
    steps : that each could take
    """
    (first, begun), (second, elsewhere) = best, other
    given_up = not second.converged and second.iterations < steps and second.chi2 > hopeless(first)
    if first.converged and (second.converged or given_up):
        # Where the model leaves more than noise, so much more must a rival be worse to be ruled out.
        return second.cost - first.cost < DECISIVE * max(1.0, first.chi2_per_dof) and apart(second, first)
    return started_apart(begun, elsewhere)


def best_of(ends: Sequence[End], steps: int) -> tuple[End, bool]:
    """The best of some fits of one record, and whether another side is still open.

    The misfit alone does not decide: on the wrong side a fit may move all tracks by meters and weight samples down.
    """
    best, *others = sorted(ends, key=lambda end: end[0].cost)
    return best, any(is_open(best, other, steps) for other in others)


def reopened(before: bool, result: FitResult, problem: Problem) -> bool:
    """Whether the side is open after a later fit; `before`: it was so.

    Without anchors that fit must have converged too: the sides were told apart by the model before it.
    """
    return before or not (result.converged or problem.anchors)
