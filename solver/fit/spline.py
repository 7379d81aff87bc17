"""The spline fit: maximum a posteriori route by Levenberg-Marquardt. The default."""

import time
from collections.abc import Callable

import numpy as np

from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.state import State
from solver.fit.windows import part

#: Passes that a long fiber is fitted to first: they lead near, and all then need few steps.
FIRST = 12


def beginning(problem: Problem, chain: Chain, advance: Callable[[int], None]) -> State:
    """Where to begin: the rough route, or on a long fiber with many passes where a fit of some of them ends."""
    count = len(problem.passes)
    if not chain.long or count < 2 * FIRST:
        return chain.start()
    few = Chain.of(part(problem, np.linspace(0, count - 1, FIRST).astype(int)))
    end = solve(few, few.start(), advance=advance).state
    return chain.start_at(end.coefficients, end.poisson_ratio)


def fit_spline(
    problem: Problem, advance: Callable[[int], None] = lambda n: None, *, hopeless: float = float("inf")
) -> FitResult:
    """Fit a spline route to a survey.

    Parameters
    ----------
    problem : the survey
    advance : called with 1 after each step
    hopeless : chi2 that a fit must be about to reach, or it is given up

    Returns
    -------
    result : with the covariance of the linearized posterior

    See `solver.fit.least_squares` for what is minimized.
    """
    begun = time.perf_counter()
    chain = Chain.of(problem)
    end = solve(chain, beginning(problem, chain, advance), advance=advance, hopeless=hopeless)
    return assemble(
        problem,
        chain,
        end.state,
        method="spline",
        iterations=end.iterations,
        seconds=time.perf_counter() - begun,
        converged=end.converged,
        near=end.at,
    )
