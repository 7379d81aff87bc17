"""The fits that `locate` can take, by name."""

from collections.abc import Callable

from solver.fit import FitResult, Problem, fit_spline
from solver.published.network import ITERATIONS, fit_network

#: Method -> (fit, number of steps its progress counts at most).
METHODS: dict[str, tuple[Callable[[Problem, Callable[[int], None]], FitResult], int]] = {
    "spline": (fit_spline, 40),
    "network": (fit_network, ITERATIONS),
}
