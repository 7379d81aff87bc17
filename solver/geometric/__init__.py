"""The paper's geometric first route: circles of equal width about the lanes, and the smooth curve that touches them."""

from solver.geometric.circles import Circles, circles_of, equal_width_locus
from solver.geometric.route import CircleFit, CircleProblem, fit_circles, geometric_route, polynomial_route

__all__ = [
    "CircleFit",
    "CircleProblem",
    "Circles",
    "circles_of",
    "equal_width_locus",
    "fit_circles",
    "geometric_route",
    "polynomial_route",
]
