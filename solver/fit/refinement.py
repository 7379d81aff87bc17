"""Where a route needs more knots, by evidence: ducts lie straight and turn at corners, so that few places need many.

A spline on knots 10 m apart cannot follow a bend of one meter's radius. Near a fit, normal equations on finer knots
everywhere tell how much each new knot would explain beside what all others and all vehicles explain. Those are added
whose Bayes factor is strong (Kass and Raftery 1995, J. Am. Stat. Assoc. 90, 773), and the fit goes on from there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from solver.cable.fiber import SplineBasis
from solver.fit.chain import Chain
from solver.fit.least_squares import PATIENCE
from solver.fit.normal import Banded
from solver.fit.parameter_layout import AXES
from solver.fit.problem import CLOSEST, KNOT_SPACING, Problem
from solver.fit.state import State

Array = NDArray[np.float64]

#: ln Bayes factor from which a knot is added.
STRONG = 3.0
#: How many parts an interval is cut into at a time.
PARTS = 4
#: Median of chi2 of three degrees of freedom: what a knot that explains nothing brings.
BY_CHANCE = 2.366
#: Precision that stands for none, 1/m^2.
NONE = 1e-6


def finer(basis: SplineBasis) -> SplineBasis:
    """The basis with every interval cut in parts, none shorter than knots may be."""
    counts = np.clip(np.diff(basis.breaks) // CLOSEST, 1, PARTS).astype(int)
    counts = 2 ** np.log2(counts).astype(int)
    cuts = [
        np.linspace(a, b, n, endpoint=False) for a, b, n in zip(basis.breaks, basis.breaks[1:], counts, strict=False)
    ]
    return SplineBasis.of(np.concatenate([*cuts, basis.breaks[-1:]]))


def knot_insertion(coarse: SplineBasis, fine: SplineBasis) -> Array:
    """Matrix [fine, coarse] from a route's coefficients to those of the same route on more knots (Boehm 1980)."""
    at = np.interp(np.linspace(0, fine.intervals, 4 * fine.size), np.arange(fine.intervals + 1), fine.breaks)
    return np.asarray(np.linalg.lstsq(fine.at(at), coarse.at(at), rcond=None)[0])


def on_knots(problem: Problem, state: State, basis: SplineBasis) -> tuple[Problem, State]:
    """A problem, and the same state of it, on a basis whose knots have those of its own among them."""
    coefficients = knot_insertion(problem.basis, basis) @ state.coefficients.numpy()
    return replace(problem, knots=tuple(basis.breaks[1:-1].tolist())), replace(
        state, coefficients=torch.from_numpy(coefficients)
    )


def knots_around(problem: Problem, state: State, places: Sequence[float]) -> tuple[Problem, State]:
    """A problem whose route may turn at some places as sharply as ducts do, and the same state of it.

    Knots lie twice as far apart with each step away, up to those that are there.

    Parameters
    ----------
    places : distances along the fiber, m
    """
    breaks = problem.basis.breaks
    steps = CLOSEST * 2.0 ** np.arange(int(np.log2(KNOT_SPACING / CLOSEST)))
    for one in np.add.outer(places, np.concatenate([[0.0], steps, -steps])).ravel():
        if breaks[0] + CLOSEST < one < breaks[-1] - CLOSEST and np.abs(breaks - one).min() >= CLOSEST / 2:
            breaks = np.sort(np.append(breaks, one))
    return on_knots(problem, state, SplineBasis.of(breaks))


@dataclass
class Equations:
    """Normal equations of what is fitted, and the prior's part of them, as more of it is let free.

    Parameters
    ----------
    matrix, known : [number, number], all, and of the priors alone
    right : [number]
    """

    matrix: Array
    known: Array
    right: Array

    def eliminate(self, some: NDArray[np.int64]) -> None:
        """Let some numbers take up what they can: all others count beside them."""
        across = np.linalg.solve(
            self.matrix[np.ix_(some, some)], np.column_stack([self.matrix[some], self.right[some]])
        )
        self.right = self.right - self.matrix[:, some] @ across[:, -1]
        self.matrix = self.matrix - self.matrix[:, some] @ across[:, :-1]
        self.known = self.known - self.known[:, some] @ np.linalg.solve(
            self.known[np.ix_(some, some)], self.known[some]
        )

    def gain(self, some: NDArray[np.int64]) -> float:
        """Fall of chi2 that some more numbers bring."""
        return float(self.right[some] @ np.linalg.solve(self.matrix[np.ix_(some, some)], self.right[some]))

    def bayes_factor(self, some: NDArray[np.int64], scale: float) -> float:
        """Ln Bayes factor of some more numbers, where chi2 counts one `scale`-th."""
        here = np.ix_(some, some)
        wider = np.linalg.slogdet(self.matrix[here])[1] - np.linalg.slogdet(self.known[here])[1]
        return 0.5 * (self.gain(some) / scale - wider)


def add_knots(chain: Chain, state: State, chi2_per_dof: float, most: float = np.inf) -> tuple[Problem, State] | None:
    """A problem with the knots that the data ask for near the end of a fit, and the same state of it; None: no more.

    Parameters
    ----------
    chain, state : the fit
    chi2_per_dof : that it leaves
    most : chi2; where all knots together would not come near it, none is wanted
    """
    problem, basis = chain.problem, chain.basis
    fine = finer(basis)
    new = np.flatnonzero(~np.isin(fine.breaks, basis.breaks))
    if not len(new):
        return None
    all_over, begun = on_knots(problem, state, fine)
    there = Chain.of(all_over).visit(begun)
    normal = there.open
    if there.misfit - PATIENCE * normal.decrement**2 > most:
        return None
    matrix, right = normal.without_vehicles()
    prior = Banded.of(normal.known, normal.size, normal.border).dense
    # Numbers of the old knots, of what is beside the route, and of the new knots.
    into, old = knot_insertion(basis, fine), AXES * basis.size
    change = np.zeros((len(right), old + normal.border + AXES * len(new)))
    change[: normal.size, :old] = np.kron(into, np.eye(AXES))
    change[normal.size :, old : old + normal.border] = np.eye(normal.border)
    # The functions of a cubic basis are numbered from the one that peaks a knot before the first.
    for number, function in enumerate(new + 1):
        for axis in range(AXES):
            change[AXES * function + axis, old + normal.border + AXES * number + axis] = 1.0
    left = Equations(
        change.T @ matrix.dense @ change, change.T @ (prior + NONE * np.eye(len(prior))) @ change, change.T @ right
    )
    left.eliminate(np.arange(old + normal.border))
    groups = {knot: old + normal.border + AXES * n + np.arange(AXES) for n, knot in enumerate(new.tolist())}
    # Where the model lacks something else, every knot explains a part of it: one that is worth having explains more.
    scale = max(1.0, chi2_per_dof, float(np.median([left.gain(one) for one in groups.values()])) / BY_CHANCE)
    chosen = list[int]()
    while groups:
        best, knot = max((left.bayes_factor(one, scale), knot) for knot, one in groups.items())
        if best < STRONG:
            break
        chosen.append(knot)
        left.eliminate(groups.pop(knot))
    if not chosen:
        return None
    return on_knots(problem, state, SplineBasis.of(np.sort(np.concatenate([basis.breaks, fine.breaks[chosen]]))))
