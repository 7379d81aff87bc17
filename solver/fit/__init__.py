"""Fits of a fiber route: one interface, `fit(problem, method)`; the methods can be compared on the same survey."""

from collections.abc import Callable

from solver.fit.network import ITERATIONS, fit_network
from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.fit.spline import fit_spline

#: Method -> (fit, number of steps its progress counts at most).
METHODS: dict[str, tuple[Callable[[Problem, Callable[[int], None]], FitResult], int]] = {
    "spline": (fit_spline, 40),
    "network": (fit_network, ITERATIONS),
}

__all__ = ["METHODS", "FitResult", "Parameter", "Prior", "Problem", "fit_network", "fit_spline"]
