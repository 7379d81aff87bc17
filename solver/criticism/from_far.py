"""Fits of known effects that start from far beyond what is plausible."""

from collections.abc import Mapping

import numpy as np

from solver.criticism.policy import POLICY
from solver.criticism.race import FAR_PACE, PACE, ROUNDS, Course
from solver.criticism.refit import Refit
from solver.criticism.scorer import Scorer
from solver.fit.side_by_side import side_by_side
from solver.fit.state import State


def from_far(scorer: Scorer, tried: Mapping[str, Refit]) -> dict[str, Refit]:
    """Known effects of one size that fit better from far beyond what is plausible, where something unknown comes near.

    What the route and the ground have followed a long way, as a wide pulse, may have a second minimum where little of
    it is there, and the discrepancy models then imitate the rest.
    """
    most = max((one.evidence for one in tried.values()), default=0.0)
    unknown = max((one.evidence for one in tried.values() if one.effect.generic), default=-np.inf)
    if unknown < most - POLICY.far:
        return {}
    course = Course.of(scorer)

    def gone(start: tuple[Refit, State]) -> Refit:
        (known, far), gained = start, np.inf
        one, end = known, course.run(known.fit, far, FAR_PACE)
        for left in range(ROUNDS - 1, -1, -1):
            if end is None:
                break
            # What it falls by in its first steps, from where nothing fits, tells nothing of the next ones.
            gained, one = (np.inf if one is known else end[1] - one.fall), one.at(*end)
            if one.solution.converged or max(one.hoped, one.standing(left * gained)) < POLICY.stay * most:
                break
            end = course.run(one.fit, one.solution, PACE)
        return one if one.fall > known.fall else known

    starts = [(one, far) for one in tried.values() if one.single for far in one.extremes(course.weights)]
    better: dict[str, Refit] = {}
    for (known, _), one in zip(starts, side_by_side(gone, starts), strict=True):
        if one.fall > better.get(one.effect.name, known).fall:
            better[one.effect.name] = one
    return better
