"""The fits that `locate` can take, by name."""

from collections.abc import Callable

from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.spline import fit_spline
from solver.published.network import ITERATIONS, fit_network
from solver.published.whitened_network import ITERATIONS as WHITENED_ITERATIONS
from solver.published.whitened_network import fit_whitened_network
from vision.contract import InputError

#: Method -> (fit, number of steps its progress counts at most).
METHODS: dict[str, tuple[Callable[[Problem, Callable[[int], None]], FitResult], int]] = {
    "spline": (fit_spline, 40),
    "network": (fit_network, ITERATIONS),
    "network-whitened": (fit_whitened_network, WHITENED_ITERATIONS),
}
#: What a user names: methods, and likelihoods of the network.
NAMED, LIKELIHOODS = ("spline", "network"), ("published", "whitened")


def method_of(method: str, likelihood: str | None = None) -> str:
    """The key of `METHODS` for a method and, of the network, a likelihood: the paper's own where None.

    Raises
    ------
    InputError
        If one is not known, or a likelihood is given for the spline, which has one only.

    >>> method_of("network", "whitened"), method_of("network"), method_of("spline")
    ('network-whitened', 'network', 'spline')
    """
    if method not in NAMED:
        raise InputError(f"--method {method}: not known; choose one of {', '.join(NAMED)}")
    if likelihood is not None and likelihood not in LIKELIHOODS:
        raise InputError(f"--likelihood {likelihood}: not known; choose one of {', '.join(LIKELIHOODS)}")
    if likelihood is not None and method != "network":
        raise InputError(f"--likelihood {likelihood}: is for --method network; the spline's is always whitened")
    return "network-whitened" if likelihood == "whitened" else method
