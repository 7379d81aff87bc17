"""Fits of a fiber route: the problem, what was known before, the spline fit, and what every fit gives back."""

from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.fit.spline import fit_spline

__all__ = ["FitResult", "Parameter", "Prior", "Problem", "fit_spline"]
