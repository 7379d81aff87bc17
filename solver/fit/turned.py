"""Where the fiber may turn off the road beyond its fitted channels: a gauge of 50 m senses it there all the same."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from solver.fit.chain import Chain
from solver.fit.least_squares import Solution, solve
from solver.fit.state import State

Array = NDArray[np.float64]

#: Radius of a turn at a handhole or a corner, m, and the step between places where one may begin.
RADIUS = 4.0
#: Steps that every turn is fitted, and that the best few are fitted.
FIRST, MORE, FEW = 2, 3, 3
#: Ends, one after the other: where the fiber turns at the first is seen once the second is right, too.
ENDS = (0, 1, 0)
#: Points along a path, m.
STEP = 0.5
#: Channels at an end whose mean direction is that of the road there.
STRAIGHT = 10

#: At what distance beyond the channels the fiber turns, m, and to which side, 1 or -1; and that at both ends, or None.
Turn = tuple[float, int]
Turns = tuple[Turn | None, Turn | None]


def path(end: Array, direction: Array, turn: Turn | None, length: float) -> tuple[Array, Array]:
    """Distances [point], m, beyond the end of a route, and points [point, 3] there, m.

    Parameters
    ----------
    end : [3], m
    direction : [3], in which the route goes on
    turn : by a right angle; None: straight on
    length : of the path, m

    >>> path(np.zeros(3), np.array([1.0, 0.0, 0.0]), (10.0, 1), 30.0)[1][-1].round(1).tolist()
    [13.8, 18.0, 0.0]
    """
    beyond = np.arange(STEP, length + STEP, STEP)
    place, side = (np.inf, 1) if turn is None else turn
    angle = np.arctan2(direction[1], direction[0]) + side * np.clip((beyond - place) / RADIUS, 0, np.pi / 2)
    return beyond, end + np.cumsum(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) * STEP, axis=0)


def laid(chain: Chain, state: State, turns: Turns) -> State:
    """A state whose route goes on straight beyond its channels, or turns off."""
    problem = chain.problem
    distance, route = problem.distance, problem.start
    inner = min(STRAIGHT, len(route) - 1)
    where, points = [distance], [route]
    for last, back, sign, turn in ((0, inner, -1, turns[0]), (-1, -1 - inner, 1, turns[1])):
        beyond, there = path(route[last], route[last] - route[back], turn, problem.gauge_length / 2 + STEP)
        where.append(distance[last] + sign * beyond)
        points.append(there)
    order = np.argsort(np.concatenate(where))
    coefficients = chain.basis.interpolate(np.concatenate(where)[order], np.concatenate(points)[order])
    return replace(state, coefficients=torch.from_numpy(coefficients))


def turned(chain: Chain, state: State, advance: Callable[[int], None]) -> tuple[Solution, bool]:
    """Where to begin if the fiber turns off beyond either end of its channels; and whether it does.

    A fit of a straight start moves its ends by meters instead. Each turn is fitted a few steps, one end after the
    other.

    Parameters
    ----------
    chain : the problem, which begins at a route that fits its channels
    state : everything else where a fit ended
    advance : called with 1 after each turn that is tried, see `tries`
    """

    def tried(turns: Turns) -> tuple[float, Turns, Solution]:
        end = solve(chain, laid(chain, state, turns), iterations=FIRST)
        advance(1)
        return chain.cost(end.at), turns, end

    def onward(turns: Turns, begun: Solution) -> tuple[float, Turns, Solution]:
        end = solve(chain, begun, iterations=MORE)
        return chain.cost(end.at), turns, end

    best = straight = onward(*tried((None, None))[1:])
    every = places(chain.problem.gauge_length)
    for number in ENDS:
        kept = best[1][1 - number]
        begun = [tried((one, kept) if number == 0 else (kept, one)) for one in every]
        few = sorted(begun, key=cost_of)[:FEW]
        best = min([best, *(onward(*one[1:]) for one in few)], key=cost_of)
    return best[2], best is not straight


def places(gauge_length: float) -> list[Turn]:
    """Turns that a gauge may sense beyond the channel at its middle.

    >>> places(16.0)
    [(0.0, -1), (0.0, 1), (4.0, -1), (4.0, 1)]
    """
    return [(float(place), side) for place in np.arange(0.0, gauge_length / 2, RADIUS) for side in (-1, 1)]


def tries(gauge_length: float) -> int:
    """How many turns are tried."""
    return 1 + len(ENDS) * len(places(gauge_length))


def cost_of(tried: tuple[float, Turns, Solution]) -> float:
    """What a fit has cost."""
    return tried[0]
