"""Fits of a fiber route: the problem, its priors, the spline fit, and the result that every fit returns."""

from solver.fit.prior import Prior
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.fit.spline import fit_spline

__all__ = ["FitResult", "Parameter", "Prior", "Problem", "fit_spline"]
