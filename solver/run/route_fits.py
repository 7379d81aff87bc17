"""The fits that lead to a run's route.

From every start, without bent ends, with more knots where the fiber bends, without wrong anchors.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from solver.cable.fiber import Coil, SplineBasis
from solver.fit.anchor_check import contradiction, disagree
from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.pose import bent_ends, shortened
from solver.fit.problem import Problem
from solver.fit.refinement import FEW, close_around, on_knots, with_bends, without_knots
from solver.fit.result import FitResult
from solver.fit.sides import best_of, hopeless, reopened
from solver.fit.spline import crossing_start, ended, fit_spline
from solver.fit.state import State
from solver.fit.stretches import is_long
from solver.fit.visit import Visit
from solver.run.floor import noise_floor
from solver.run.methods import METHODS
from solver.start.first_routes import straight_on
from solver.survey.das.record import DASRecord
from vision.contract import progress

Array = NDArray[np.float64]
#: A problem, where its fit begins, and the cost there.
Start = tuple[Chain, State, float]

#: Chi2 per degree of freedom up to which a model explains the data well enough to judge anchors by it.
EXPLAINED = 1.03
#: Share of the misfit beyond that of noise that knots of the route must explain nearby: most of it. Of jogs under
#: unknown wheels they explain so much; of a wrong gauge, on seven streets, less.
BY_ROUTE = 0.5
#: Spacing of knots, m, on which a crossing of the road is looked for.
CORNER_KNOTS = 2.5


def fit_route(
    problems: Sequence[Problem],
    wider: Problem | None,
    method: str,
    record: DASRecord,
    warnings: list[str],
    disputed: list[str],
) -> tuple[FitResult, Problem]:
    """Fit a survey from all its starts; the best fit, and the problem that it solves.

    Parameters
    ----------
    problems : one for each start
    wider : of all channels that are felt; None: of no more
    method : a key of `solver.run.methods.METHODS`
    record : that the problems are of
    warnings : lines for the user are added
    disputed : sentences on anchors that contradict the others are added
    """
    recorded = int(record.channel[0]), int(record.channel[-1])
    result, problem = fit_turns(*fit_sides(problems, method), method)
    if wider is not None and method == "spline" and not is_long(problem):
        result, problem = fit_beyond(result, problem, wider, method)
    if problem.coil is not None and explains_coil(result, problem, problem.coil):
        problem = replace(problem, coil=None)
    result, problem = fit_straight(result, problem, method, recorded, warnings)
    return fit_agreeing(result, replace(problem, anchors=problems[0].anchors), method, disputed)


def explains_coil(result: FitResult, problem: Problem, coil: Coil) -> bool:
    """Whether corners take the fiber that seems to lie coiled, as at a crossing, and noise alone is left."""
    level, scatter = noise_level_of(problem, result.freedom)
    reach = coil.length + problem.gauge_length
    near = [one for one in result.corners if abs(one.distance - coil.place) < reach]
    return len(near) > 1 and result.chi2_per_dof <= level + scatter


def fit_sides(problems: Sequence[Problem], method: str) -> tuple[FitResult, Problem]:
    """Fit every start; the best is returned, marked ambiguous where another side is still open."""
    fit, steps = METHODS[method]
    ends: list[tuple[FitResult, Problem]] = []
    for problem in problems:
        with progress("fitting the route", steps) as advance:
            if ends and method == "spline":
                found = fit_spline(problem, advance, hopeless=hopeless(ends[0][0]))
            else:
                found = fit(problem, advance)
            ends.append((found, problem))
    (best, problem), ambiguous = best_of(ends, steps)
    return replace(best, ambiguous_side=ambiguous), problem


def fit_straight(
    result: FitResult, problem: Problem, method: str, recorded: tuple[int, int], warnings: list[str]
) -> tuple[FitResult, Problem]:
    """Fit again without the ends at which the fiber turns off the road, until none is left.

    Beyond a coil that the model does not have the route turns too, though the fiber does not.
    """
    if problem.coil is not None:
        return result, problem
    gauge = round(problem.gauge_length / problem.channel_spacing)
    while (keep := bent_ends(result, problem, gauge)) != slice(0, len(problem.channel)):
        whole, problem = problem, shortened(problem, keep, result)
        for end in sorted({int(whole.channel[0]), int(whole.channel[-1])} - set(problem.channel[[0, -1]].tolist())):
            warnings.append(left_out(end, recorded, gauge))
        again, problem = fit_sides([problem], method)
        result = replace(again, ambiguous_side=result.ambiguous_side)
    return result, problem


def left_out(end: int, recorded: tuple[int, int], gauge: int) -> str:
    """What a user should read of an end that is not located; where the record ends there, no bend can be seen.

    >>> left_out(60, (0, 240), 10)
    'the fiber turns off the road near channel 60; it is not located there'
    >>> left_out(60, (58, 108), 10)
    'the model does not explain the end of the record near channel 60; the fiber is not located there'
    """
    if min(end - recorded[0], recorded[1] - end) >= gauge:
        return f"the fiber turns off the road near channel {end}; it is not located there"
    return f"the model does not explain the end of the record near channel {end}; the fiber is not located there"


def fit_bends(result: FitResult, problem: Problem, method: str) -> tuple[FitResult, Problem]:
    """Fit again with knots where the fiber bends more sharply than the usual ones let it, until no more are wanted.

    Kept where the route alone explains most of what is beyond noise nearby, in the record and at anchors: most of what
    other physics leaves is beyond any route, and in a stretch where that shows no more knots are tried.
    """
    if method != "spline":
        return result, problem
    level, scatter = noise_level_of(problem, result.freedom)
    chain = Chain.of(shortened(problem, slice(None), result))
    end, old = chain.state_of(torch.from_numpy(result.vector)), problem.basis.breaks
    begun, noise = chain.visit(end), (level * result.freedom, scatter * result.freedom)
    by_stretch = most_left(*shares(chain, begun, chain.edges), *noise)
    before, share = (with_beside(one) for one in shares(chain, begun, old))
    nearby = most_left(before, share, *noise)
    steps = METHODS[method][1]
    with progress("fitting bends of the route", steps) as advance:
        found = with_bends(chain, end, result.chi2_per_dof, result.freedom, by_stretch, advance)
        if found is None:
            return result, problem
        chain, solution = found
        used = result.iterations + solution.iterations
        wanted = close_around(chain.basis, np.setdiff1d(chain.basis.breaks, old))
        everywhere, end = on_knots(chain.problem, solution.state, wanted)
        chain = Chain.of(everywhere)
        solution = solve(chain, end, iterations=steps, advance=advance)
        used += solution.iterations
        more = np.setdiff1d(chain.problem.knots, old)
        good = (with_beside(shares(chain, solution.at, old)[0]) <= nearby)[np.searchsorted(old[1:-1], more)]
        if result.converged and good.any() and not good.all():
            chain, fewer = without_knots(chain, solution.state, more[~good])
            solution = solve(chain, fewer, iterations=steps, advance=advance)
            used += solution.iterations
    if result.converged and not (good.any() and solution.converged):
        return result, problem
    again = ended(chain, replace(solution, iterations=used), result.seconds)
    return replace(again, ambiguous_side=result.ambiguous_side), chain.problem


def shares(chain: Chain, visit: Visit, edges: Array) -> tuple[Array, Array]:
    """Chi2 [place] between edges [place + 1], m, and the share [place] of the samples' weight that is there."""
    chi2, weight = chain.misfits(visit, edges)
    return chi2, weight / weight.sum()


def with_beside(values: Array) -> Array:
    """Values [place], each with those of the places beside it added.

    >>> with_beside(np.array([1.0, 2.0, 3.0])).tolist()
    [3.0, 6.0, 5.0]
    """
    return np.convolve(values, np.ones(3))[1:-1]


def most_left(chi2: Array, share: Array, noise: float, scatter: float) -> Array:
    """Chi2 [place] that knots must come to, by shares [place] of the samples: most of what is beyond noise is gone.

    Noise alone leaves less in 98 of 100 surveys.

    Parameters
    ----------
    noise, scatter : chi2 that noise leaves of all samples, and its standard deviation

    >>> most_left(np.array([150.0, 101.0]), np.array([0.5, 0.5]), 200.0, 1.0).round(1).tolist()
    [125.0, 101.4]
    """
    return np.maximum(noise * share + 2 * scatter * share**0.5, chi2 - BY_ROUTE * (chi2 - noise * share))


def fit_turns(result: FitResult, problem: Problem, method: str) -> tuple[FitResult, Problem]:
    """Fit again as sharply as the fiber turns: with knots where it bends, and across the road.

    A fit that began on one side does not find its way to the other half way along. So where more than noise is left
    one begins that crosses; the better of both so far gets knots first.
    """
    if method != "spline" or is_long(problem) or is_explained(result, problem):
        return fit_bends(result, problem, method)
    start = with_crossing(problem)
    begun = None if start is None else fit_from(start, result)
    found = plain = result, problem
    if begun is None or result.chi2_per_dof < begun[0].chi2_per_dof:
        found = fit_bends(*plain, method)
    if begun is not None and not is_explained(*found):
        found = better_of(found, fit_bends(*begun, method))
        if found is plain:
            found = fit_bends(*plain, method)
    return found if is_explained(*found) else without_anchor(found, problem, start, method)


def without_anchor(
    found: tuple[FitResult, Problem], begun: Problem, start: Start | None, method: str
) -> tuple[FitResult, Problem]:
    """Fit across the road without the anchor that holds the fit on the wrong side; `fit_agreeing` judges it.

    Parameters
    ----------
    found : fit with all anchors, which leaves more than noise
    begun, start : the problem at its start, and where it begins if the fiber crosses the road
    """
    if len(begun.anchors) < 2:
        return found
    rest = ([one for one in begun.anchors if one is not out] for out in begun.anchors)
    fewer = (with_crossing(replace(begun, anchors=some)) for some in rest)
    best = min((one for one in fewer if one is not None), key=lambda one: one[2], default=None)
    if best is None or (start is not None and start[2] <= best[2]):
        return found
    again, there = fit_bends(*fit_from(best, found[0]), method)
    wrong = is_explained(again, there) and disagree(replace(there, anchors=begun.anchors), again)
    return (again, there) if wrong else found


def better_of(one: tuple[FitResult, Problem], other: tuple[FitResult, Problem]) -> tuple[FitResult, Problem]:
    """The other of two fits, if it came to an end and the first did not, or fits worse."""
    better = other[0].converged and (other[0].chi2_per_dof < one[0].chi2_per_dof or not one[0].converged)
    return other if better else one


def with_crossing(problem: Problem) -> Start | None:
    """A problem on knots that can follow a corner, where it begins if the fiber crosses the road, and its cost."""
    even = SplineBasis.even(*problem.span, CORNER_KNOTS).breaks[1:-1]
    chain = Chain.of(replace(problem, knots=tuple(even.tolist())))
    start = crossing_start(chain)
    return None if start is None else (chain, *start)


def fit_from(start: Start, before: FitResult) -> tuple[FitResult, Problem]:
    """A route that crosses the road, after a few steps; what was known before of the side stays open or not."""
    chain, state, _ = start
    with progress("fitting a crossing of the road", FEW) as advance:
        first = ended(chain, solve(chain, state, iterations=FEW, advance=advance), before.seconds)
    return replace(first, ambiguous_side=before.ambiguous_side), chain.problem


def fit_beyond(result: FitResult, problem: Problem, wider: Problem, method: str) -> tuple[FitResult, Problem]:
    """Fit the channels beyond those that one line along the road explains, too, from where the fit ended straight on.

    Kept if what is left is no more than before.
    """
    at = np.isin(result.channel, problem.channel)
    begun = straight_on(problem.channel, result.route[at], wider.channel)
    chain = Chain.of(replace(wider, start=begun, knots=problem.knots, anchors=problem.anchors))
    with progress("fitting channels beyond", FEW) as advance:
        first = ended(chain, solve(chain, chain.start(), iterations=FEW, advance=advance), result.seconds)
    again, whole = fit_bends(first, chain.problem, method)
    level, scatter = noise_level_of(whole, again.freedom)
    if not again.converged or again.chi2_per_dof > max(level, result.chi2_per_dof) + scatter:
        return result, problem
    return replace(again, ambiguous_side=result.ambiguous_side), whole


def is_explained(result: FitResult, problem: Problem) -> bool:
    """Whether a fit came to an end at which no more is left than noise leaves in 98 of 100 surveys."""
    level, scatter = noise_level_of(problem, result.freedom)
    return result.converged and result.chi2_per_dof <= level + 2 * scatter


def noise_level_of(problem: Problem, freedom: float) -> tuple[float, float]:
    """Chi2 per degree of freedom that noise alone would leave, and its scatter, of so many degrees."""
    floor = noise_floor(problem)
    return (1.0, 0.0) if floor is None else (floor.value, floor.scatter(freedom))


def fit_agreeing(result: FitResult, problem: Problem, method: str, disputed: list[str]) -> tuple[FitResult, Problem]:
    """Fit again without anchors that all others and the tracks contradict; where it is not clear which, say so.

    What is said of them is added to `disputed`. Where the model does not explain the data, it and not an anchor may be
    wrong: all anchors stay, and what they miss widens the sigmas.
    """
    while result.converged and result.chi2_per_dof < EXPLAINED and (found := contradiction(problem, result)):
        disputed.append(found.sentence)
        if len(found.suspects) > 1 or len(problem.anchors) < 2:
            break
        disputed[-1] += "; it is left out"
        rest = [one for one in problem.anchors if one not in found.suspects]
        again, problem = fit_sides([replace(shortened(problem, slice(None), result), anchors=rest)], method)
        result = replace(again, ambiguous_side=reopened(result.ambiguous_side, again, problem))
    return result, problem
