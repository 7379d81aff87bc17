"""Where a route needs more knots, by evidence: ducts lie straight and turn at corners, so that few places need many.

A spline on knots 10 m apart cannot follow a bend of one meter's radius. Near a fit, normal equations on finer knots
everywhere tell how much each new knot would explain beside what all others and all vehicles explain. Those are added
whose Bayes factor is strong (Kass and Raftery 1995, J. Am. Stat. Assoc. 90, 773), and the fit goes on from there. Those
of a long fiber are chosen stretch by stretch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from solver.cable.fiber import DEGREE, SplineBasis
from solver.fit.chain import Chain
from solver.fit.least_squares import PATIENCE, Solution, solve
from solver.fit.normal import Banded
from solver.fit.parameter_layout import AXES, of_route
from solver.fit.problem import CLOSEST, KNOT_SPACING, Problem
from solver.fit.state import State

Array = NDArray[np.float64]

#: ln Bayes factor from which a knot is added.
STRONG = 3.0
#: How often knots are added at most, and steps of the fit after each time. After three times a jog is 0.12 m off, after
#: five 0.09 m, and no more knots are wanted. Three steps led six streets as far, but not gauges of 50 m.
ROUNDS, FEW = 5, 6
#: How many parts an interval is cut into at a time.
PARTS = 4
#: Median of chi2 of three degrees of freedom: what a knot that explains nothing brings.
BY_CHANCE = 2.366
#: m: so far from an added knot, to either side, knots lie so close: where exactly the fiber bends is not known. Within
#: 10 m, or 0.6 m apart, three streets came out alike, the latter at two to three times the CPU.
AROUND, CLOSE = 5.0, 1.0
#: Precision that stands for none, 1/m^2.
NONE = 1e-6


def finer(basis: SplineBasis, within: Sequence[tuple[float, float]] = ((-np.inf, np.inf),)) -> SplineBasis:
    """The basis with every interval within some ends, m, cut in parts, none shorter than knots may be."""
    breaks = basis.breaks
    middle = (breaks[1:] + breaks[:-1]) / 2
    wanted = np.any([(a < middle) & (middle < b) for a, b in within], axis=0)
    counts = np.where(wanted, np.clip(np.diff(breaks) // CLOSEST, 1, PARTS), 1).astype(int)
    counts = 2 ** np.log2(counts).astype(int)
    cuts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(breaks, breaks[1:], counts, strict=False)]
    return SplineBasis.of(np.concatenate([*cuts, breaks[-1:]]))


def close_around(basis: SplineBasis, added: Array) -> SplineBasis:
    """The basis with knots close to each other around some [place], m; the prior on curvature chooses among them."""
    cuts = [basis.breaks[:1]]
    for a, b in zip(basis.breaks, basis.breaks[1:], strict=False):
        near = ((added > a - AROUND) & (added < b + AROUND)).any()
        cuts.append(np.linspace(a, b, int(np.ceil((b - a) / CLOSE)) + 1 if near else 2)[1:])
    return SplineBasis.of(np.concatenate(cuts))


def insert_knots(coefficients: Array, coarse: SplineBasis, fine: SplineBasis) -> Array:
    """Coefficients [fine, ...] of the same route on more knots, from those [coarse, ...] on its own.

    Banded least squares at four places for each coefficient, linear in length: at as many places as coefficients
    rounding would grow with every knot.
    """
    from scipy.interpolate import make_lsq_spline

    at = np.interp(np.linspace(0, fine.intervals, 4 * fine.size), np.arange(fine.intervals + 1), fine.breaks)
    return np.asarray(make_lsq_spline(at, coarse.along(coefficients, at), np.array(fine.knots), DEGREE).c)


def on_knots(problem: Problem, state: State, basis: SplineBasis) -> tuple[Problem, State]:
    """A problem, and the same state of it, on a basis whose knots have those of its own among them."""
    coefficients = insert_knots(state.coefficients.numpy(), problem.basis, basis)
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


def without_knots(chain: Chain, state: State, out: ArrayLike) -> tuple[Chain, State]:
    """The fit without some knots, and the state of it nearest to one with them."""
    kept = tuple(np.setdiff1d(chain.problem.knots, out).tolist())
    fewer, at = Chain.of(replace(chain.problem, knots=kept)), np.linspace(*chain.problem.span, 4 * chain.basis.size)
    route = fewer.basis.interpolate(at, chain.basis.along(state.coefficients.numpy(), at))
    return fewer, replace(state, coefficients=torch.from_numpy(route))


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


def add_knots(
    chain: Chain, state: State, chi2_per_dof: float, most: ArrayLike = np.inf
) -> tuple[Problem, State] | None:
    """A problem with the knots that the data ask for near the end of a fit, and the same state of it; None: no more.

    Parameters
    ----------
    chain, state : the fit
    chi2_per_dof : that it leaves
    most : of all stretches or [stretch], chi2; where all knots together would not come near it, none is wanted
    """
    problem, basis, edges = chain.problem, chain.basis, chain.edges
    most = np.broadcast_to(most, len(edges) - 1)
    wanted = np.flatnonzero(most > -np.inf).tolist()
    # A stretch and those beside it: little of the route farther away shows there, so that it counts as known.
    ends = {n: (edges[max(n - 1, 0)], edges[min(n + 2, len(edges) - 1)]) for n in wanted}
    fine = finer(basis, list(ends.values()))
    new = np.flatnonzero(~np.isin(fine.breaks, basis.breaks))
    if not len(new):
        return None
    all_over, begun = on_knots(problem, state, fine)
    finely = Chain.of(all_over)
    there = finely.visit(begun)
    normal, (misfit, _) = there.open, finely.misfits(there, edges)
    matrix, right = normal.without_vehicles()
    prior = Banded.of(normal.known, normal.size, normal.border)
    chosen = list[int]()
    for number in wanted:
        low, high = (basis.interval(ends[number]) + np.array([0, 1])).tolist()
        begin, end = np.searchsorted(fine.breaks, [basis.breaks[low], basis.breaks[high]]).tolist()
        coarse, part = basis.part(low, high), fine.part(begin, end)
        mine = new[(fine.breaks[new] > edges[number]) & (fine.breaks[new] <= edges[number + 1])].tolist()
        if not mine:
            continue
        taken = [one for one in chosen if begin < one < end]
        knots = [*taken, *mine, *sorted(set(new[(new > begin) & (new < end)].tolist()).difference(taken, mine))]
        # Numbers of the old knots, of what is beside the route, and of the new knots.
        old, route = AXES * coarse.size, of_route(begin, part.size)
        count = old + normal.border
        change = np.zeros((AXES * part.size + normal.border, count + AXES * len(knots)))
        change[: AXES * part.size, :old] = np.kron(insert_knots(np.eye(coarse.size), coarse, part), np.eye(AXES))
        change[AXES * part.size :, old:count] = np.eye(normal.border)
        # The functions of a cubic basis are numbered from the one that peaks a knot before the first.
        for at, knot in enumerate(knots):
            for axis in range(AXES):
                change[AXES * (knot + 1 - begin) + axis, count + AXES * at + axis] = 1.0
        known = prior.part(route).dense
        left = Equations(
            change.T @ matrix.part(route).dense @ change,
            change.T @ (known + NONE * np.eye(len(known))) @ change,
            change.T @ np.concatenate([right[route], right[normal.size :]]),
        )
        every, count = np.arange(len(left.right)), count + AXES * len(taken)
        if misfit[number] - PATIENCE * left.gain(every[: count + AXES * len(mine)]) > most[number]:
            continue
        left.eliminate(every[:count])
        groups = dict(zip(knots[len(taken) :], every[count:].reshape(-1, AXES), strict=True))
        chosen += worth_adding(left, groups, mine, chi2_per_dof)
    if not chosen:
        return None
    return on_knots(problem, state, SplineBasis.of(np.sort(np.concatenate([basis.breaks, fine.breaks[chosen]]))))


def worth_adding(
    left: Equations, groups: dict[int, NDArray[np.int64]], wanted: list[int], chi2_per_dof: float
) -> list[int]:
    """Those of the knots `wanted` that the data ask for, the best first and each beside those before.

    Parameters
    ----------
    left : equations
    groups : numbers of each knot that may be added there
    chi2_per_dof : that the fit leaves
    """
    # Where the model lacks something else, every knot explains a part of it: one that is worth having explains more.
    scale = max(1.0, chi2_per_dof, float(np.median([left.gain(one) for one in groups.values()])) / BY_CHANCE)
    chosen, open_to = list[int](), set(wanted)
    while open_to:
        best, knot = max((left.bayes_factor(groups[one], scale), one) for one in open_to)
        if best < STRONG:
            break
        chosen.append(knot)
        open_to.remove(knot)
        left.eliminate(groups[knot])
    return chosen


def with_bends(
    chain: Chain,
    state: State,
    chi2_per_dof: float,
    freedom: float,
    most: Array,
    advance: Callable[[int], None] = lambda n: None,
) -> tuple[Chain, Solution] | None:
    """A fit, on its way, with knots where the fiber bends more sharply than those it has let it; None: none are wanted.

    Parameters
    ----------
    chain, state, chi2_per_dof, freedom : the fit, its misfit and degrees of freedom
    most : [stretch], chi2; where all knots together would not come near it, no more are tried after the first
    advance : called with 1 before each step
    """
    solution, used = None, 0
    # Far from its end a fit tells too little of what knots would explain.
    near = np.full(len(most), np.inf)
    for _ in range(ROUNDS):
        left = chi2_per_dof if solution is None else solution.at.misfit / freedom
        found = add_knots(chain, state, left, near)
        if found is None:
            break
        fresh = chain.stretch_of(np.setdiff1d(found[0].knots, chain.basis.breaks))
        near = np.where(np.isin(np.arange(len(most)), fresh), most, -np.inf)
        chain = Chain.of(found[0])
        solution = solve(chain, found[1], iterations=FEW, advance=advance)
        state, used = solution.state, used + solution.iterations
    return None if solution is None else (chain, replace(solution, iterations=used))
