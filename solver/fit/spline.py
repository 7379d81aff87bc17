"""The spline fit: maximum a posteriori route by Levenberg-Marquardt. The default."""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import torch

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
