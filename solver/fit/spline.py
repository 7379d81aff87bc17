"""The spline fit: maximum a posteriori route by Levenberg-Marquardt. The default."""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from solver.fit.carried import carried
from solver.fit.chain import Chain
from solver.fit.least_squares import Solution, solve
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.state import State
from solver.fit.stretches import FIRST, parts, some

#: Shifts of the tracks along their way, m rms, that no camera makes; and times, s, by which clocks may be apart.
MISLED, DELAYS = 1.0, np.arange(-10, 11) / 10
#: Distances from the traffic, m, at which a route may be laid instead.
BESIDE = np.arange(0.0, 12.5, 1.0)
#: Distance along the fiber, m, between places at which it may cross the road: a right angle fits there or not at all.
CROSS_EVERY = 1.0
#: Shares of the way across by which a route may be farther along than the best of those.
NEARBY = (-0.2, -0.1, 0.0, 0.1, 0.2)
#: Way to the side, m, that no camera is off by; and Poisson's ratios to begin at where a fit ends in what cannot be.
ASIDE, RATIOS = 3.0, (0.05, 0.15, 0.25, 0.35, 0.4, 0.45)


def initial_state(problem: Problem, chain: Chain, advance: Callable[[int], None]) -> State:
    """Where to begin: the rough route, or on a long fiber with many passes where a fit of some of them ends."""
    if not chain.long or len(problem.passes) < 2 * FIRST:
        return chain.start()
    few = Chain.of(problem, groups=[some(group, FIRST) for group in parts(problem)])
    end = solve(few, few.start(), advance=advance).state
    return carried((few, end), chain)


def shifted_in_time(chain: Chain, state: State) -> State | None:
    """Where to begin again if all tracks were shifted far: every vehicle early or late by the one time that fits best.

    Where clocks differ by so much that vehicles are a wavelength of the signal off, each track ends in another wrong
    place. None where tracks were not shifted far, or no time fits better than zero.
    """
    if chain.long or state.vehicles.along.square().mean().sqrt() < MISLED:
        return None
    begun, speed = chain.start(), torch.tensor([abs(one.speed) for one in chain.passes], dtype=torch.float64)
    late = (replace(begun, vehicles=replace(begun.vehicles, along=speed * float(delay))) for delay in DELAYS)
    return better_start(chain, begun, late)


def of_other_ratio(chain: Chain, state: State) -> State | None:
    """Where to begin again if vehicles pull on the road, or drive beside it: at the Poisson's ratio that fits best.

    The ratio changes the very form of the signal near the fiber (from .4 on waves have four crests), and a fit that
    begins at another ends in a wrong place. None where all vehicles are as they may be, or no other ratio fits better.
    """
    vehicles = state.vehicles
    if chain.long or not bool((vehicles.amplitude < 0).any() or (vehicles.across.abs() > ASIDE).any()):
        return None
    begun = chain.start()
    others = (replace(begun, poisson_ratio=torch.full_like(begun.poisson_ratio, nu)) for nu in RATIOS)
    return better_start(chain, begun, others)


def laid_elsewhere(chain: Chain, state: State) -> State | None:
    """Where to begin again if vehicles drive beside the road: on the straight route beside the traffic that fits best.

    A fit that began too far off moves the tracks to where it puts the fiber. None where all are on the road, anchors
    hold the route, or no other place fits better.
    """
    problem = chain.problem
    if chain.long or problem.anchors or not bool((state.vehicles.across.abs() > ASIDE).any()):
        return None
    begun, y = chain.start(), torch.cat([torch.from_numpy(one.position[one.in_view, 1]) for one in chain.passes])
    places = [*(float(y.max()) + BESIDE).tolist(), *(float(y.min()) - BESIDE).tolist()]
    routes = (
        np.column_stack([problem.start[:, 0], np.full(len(problem.start), y), problem.start[:, 2]]) for y in places
    )
    laid = (chain.basis.interpolate(problem.distance, route) for route in routes)
    return better_start(chain, begun, (replace(begun, coefficients=torch.from_numpy(one)) for one in laid))


def crossing(problem: Problem, place: float, side: float, ahead: float) -> NDArray[np.float64] | None:
    """A route [channel, 3], m, that crosses the road at a right angle; None where it would lie on one side.

    Where anchors tell on which side the fiber lies before or after, that holds.

    Parameters
    ----------
    place : distance along the fiber of the middle of the road, m
    side : y before it where no anchor tells, m
    ahead : share of the way across by which the route is farther along than rough route or anchors say
    """
    rough, distance = problem.start, problem.distance
    traffic = float(np.median(np.concatenate([one.position[one.in_view, 1] for one in problem.passes])))
    known = sorted(zip(problem.anchor_distance.tolist(), [one.y for one in problem.anchors], strict=True))
    first = next((y for at, y in reversed(known) if at < place), side)
    last = next((y for at, y in known if at >= place), 2 * traffic - first)
    across = abs(last - first)
    if across < ASIDE:
        return None
    ends = [place - across / 2, place + across / 2]

    def along(at: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sign(rough[-1, 0] - rough[0, 0]) * (at - np.interp(at, ends, [0.0, across]))

    apart = np.array([one.x for one in problem.anchors]) - along(problem.anchor_distance)
    begin = float(np.median(apart if len(apart) else rough[:, 0] - along(distance)))
    x = begin + along(distance) + ahead * across
    return np.column_stack([x, np.interp(distance, ends, [first, last]), rough[:, 2]])


def crossing_start(chain: Chain) -> tuple[State, float] | None:
    """Where to begin if the fiber crosses the road, and the cost there; None where no crossing beats the rough route.

    Parameters
    ----------
    chain : on knots that can follow a corner
    """
    problem, begun = chain.problem, chain.start()
    distance, here = problem.distance, float(np.median(problem.start[:, 1]))
    traffic = float(np.median(np.concatenate([one.position[one.in_view, 1] for one in problem.passes])))

    def best(tried: Iterable[tuple[float, float, float]]) -> tuple[float, tuple[float, float, float], State] | None:
        ends, known = [], set[bytes]()
        for one in tried:
            # Where anchors tell the side, the other is the same.
            if (route := crossing(problem, *one)) is not None and route.tobytes() not in known:
                known.add(route.tobytes())
                laid = torch.from_numpy(chain.basis.interpolate(distance, route))
                state, cost = chain.settled(replace(begun, coefficients=laid))
                ends.append((cost, one, state))
        return min(ends, key=lambda end: end[0], default=None)

    shifts = (0.0,) if problem.anchors else (-0.5, 0.0, 0.5)
    step = len(shifts) * CROSS_EVERY
    every = np.arange(distance[0] + step, distance[-1], step)
    found = best((float(at), side, shift) for at in every for side in (here, 2 * traffic - here) for shift in shifts)
    if found is None or found[0] > chain.settled(begun)[1]:
        return None
    place, side, shift = found[1]
    near = place + np.arange(-step, step + CROSS_EVERY, CROSS_EVERY)
    again = best((float(at), side, shift + more) for at in near for more in NEARBY)
    cost, _, state = min(found, again or found, key=lambda end: end[0])
    return state, cost


def better_start(chain: Chain, begun: State, others: Iterable[State]) -> State | None:
    """Whichever of other states fits best with its best amplitudes; None where none beats the first start."""
    best, cost = min((chain.settled(one) for one in others), key=lambda end: end[1])
    return best if cost < chain.settled(begun)[1] else None


def fit_spline(
    problem: Problem, advance: Callable[[int], None] = lambda n: None, *, hopeless: float = float("inf")
) -> FitResult:
    """Fit a spline route to a survey.

    Parameters
    ----------
    problem : the survey
    advance : called with 1 after each step
    hopeless : chi2; a fit that does not approach it is given up

    Returns
    -------
    result : with the covariance of the linearized posterior

    See `solver.fit.least_squares` for what is minimized.
    """
    begun = time.perf_counter()
    chain = Chain.of(problem)
    end = solve(chain, initial_state(problem, chain, advance), advance=advance, hopeless=hopeless)
    for elsewhere in (shifted_in_time, of_other_ratio, laid_elsewhere):
        if (again := elsewhere(chain, end.state)) is not None:
            other = solve(chain, again, advance=advance, hopeless=hopeless)
            end = min(end, other, key=lambda one: chain.cost(one.at))
    return ended(chain, end, time.perf_counter() - begun)


def ended(chain: Chain, end: Solution, seconds: float) -> FitResult:
    """What a fit that took so many seconds comes to."""
    return assemble(
        chain.problem,
        chain,
        end.state,
        method="spline",
        iterations=end.iterations,
        seconds=seconds,
        converged=end.converged,
        near=end.at,
    )
