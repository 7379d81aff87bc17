"""The fits that lead to a run's route.

From every start, without bent ends, with turns that long gauges sense, on finer knots, without wrong anchors.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch

from solver.fit.anchor_check import contradiction
from solver.fit.carried import carried_with_vehicles
from solver.fit.chain import Chain
from solver.fit.least_squares import PATIENCE, solve
from solver.fit.pose import bent_ends, shortened
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.sides import DECISIVE, best_of, hopeless, reopened
from solver.fit.spline import ended, fit_spline
from solver.fit.state import State
from solver.fit.stretches import is_long
from solver.fit.turned import tries, turned
from solver.run.methods import METHODS
from solver.start.regauge import LONG
from solver.survey.das.record import DASRecord
from vision.contract import progress

#: Chi2 per degree of freedom up to which a model explains the data well enough to judge anchors by it, and not to look
#: for turns.
EXPLAINED = 1.03
#: Chi2 per degree of freedom from which a route is tried on more knots, and the share of what is beyond 1 that they
#: must explain: a fiber that dips under a culvert is beyond the usual knots, while most of what other physics leaves is
#: beyond any route.
LEFT_OVER, BY_ROUTE = 1.01, 0.6
#: Times closer that the knots of a route are which can turn off the road within a few meters.
FINER = 4


def fit_route(
    problems: Sequence[Problem], method: str, record: DASRecord, warnings: list[str], disputed: list[str]
) -> tuple[FitResult, Problem]:
    """Fit a survey from all its starts; the best fit, and the problem that it solves.

    Parameters
    ----------
    problems : one for each start
    method : a key of `solver.run.methods.METHODS`
    record : that the problems are of
    warnings : lines for the user are added
    disputed : sentences on anchors that contradict the others are added
    """
    recorded = int(record.channel[0]), int(record.channel[-1])
    result, problem = fit_straight(*fit_sides(problems, method), method, recorded, warnings)
    result, problem = fit_turns(result, problem, method) or fit_finely(result, problem, method)
    return fit_agreeing(result, problem, method, disputed)


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


def fit_turns(result: FitResult, problem: Problem, method: str) -> tuple[FitResult, Problem] | None:
    """Fit a record of long gauges again with knots as close as the turns off the road that they sense need them.

    Such turns are looked for beyond the fitted channels where these do not explain the data. None where gauges are
    not long.
    """
    if method != "spline" or is_long(problem) or problem.gauge_length <= LONG:
        return None
    fine = replace(shortened(problem, slice(None), result), knot_spacing=problem.knot_spacing / FINER)
    chain, steps = Chain.of(fine), METHODS[method][1]
    with progress("fitting the route on finer knots", steps) as advance:
        end = solve(chain, laid_again(chain, result, problem), advance=advance)
    again = ended(chain, end, result.seconds)
    if again.chi2_per_dof > EXPLAINED:
        with progress("looking for turns off the road", tries(problem.gauge_length) + steps) as advance:
            begun, off = turned(chain, chain.start(), advance)
            other = solve(chain, begun, advance=advance) if off else end
        if chain.cost(other.at) < chain.cost(end.at) - DECISIVE * max(1.0, again.chi2_per_dof):
            again = ended(chain, other, result.seconds)
    return replace(again, ambiguous_side=result.ambiguous_side), fine


def laid_again(chain: Chain, result: FitResult, problem: Problem) -> State:
    """The end of a fit of a problem as a start on the other knots of a chain."""
    before = Chain.of(problem)
    begun = carried_with_vehicles((before, before.state_of(torch.from_numpy(result.vector))), chain)
    route = chain.basis.interpolate(problem.distance_of(result.channel), result.route)
    return replace(begun, coefficients=torch.from_numpy(route))


def fit_finely(result: FitResult, problem: Problem, method: str) -> tuple[FitResult, Problem]:
    """Fit again on twice as many knots where much is left over; kept if the route alone explains most of that.

    Where the fit ended these knots say themselves how much they can explain, and mostly that is too little to try.
    """
    if method != "spline" or is_long(problem) or not (result.converged and result.chi2_per_dof > LEFT_OVER):
        return result, problem
    fine = replace(shortened(problem, slice(None), result), knot_spacing=problem.knot_spacing / 2)
    most = result.chi2 * (1 / result.chi2_per_dof + (1 - BY_ROUTE) * (1 - 1 / result.chi2_per_dof))
    chain = Chain.of(fine)
    begun = laid_again(chain, result, problem)
    there = chain.visit(begun)
    if there.misfit - PATIENCE * there.open.decrement**2 > most:
        return result, problem
    with progress("fitting the route on finer knots", METHODS[method][1]) as advance:
        end = solve(chain, begun, advance=advance, hopeless=most)
    again = ended(chain, end, result.seconds)
    if not again.converged or again.chi2 > most:
        return result, problem
    return replace(again, ambiguous_side=result.ambiguous_side), fine


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
