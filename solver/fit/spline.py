"""The spline fit: maximum a posteriori route by Levenberg-Marquardt. The default."""

import time
from collections.abc import Callable

from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.posterior import assemble
from solver.fit.problem import Problem
from solver.fit.result import FitResult


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
    end = solve(chain, chain.start(), advance=advance, hopeless=hopeless)
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
