"""Monotone paths through a comparison of what pieces of cable hear with when the car was where."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.drive.car import Car
from solver.drive.path import BESIDE, STEP, Path
from solver.ground.compiled import compiled

Array = NDArray[np.float64]

#: Score of a loop's begin, of each piece in it, as of one that does not hear the car, and of a piece left out.
LOOP, INSIDE, SKIP = -12.0, -1.0, -10.0
#: m/s; slower, the car strains nothing.
SLOW = 1.0
#: Score below all others.
NEVER = -1e9


@dataclass(frozen=True)
class Passages:
    """When the car was in each piece of the path: `bins` of time and their `share` of a visit, CSR by piece."""

    begin: NDArray[np.int64]
    bins: NDArray[np.int64]
    share: Array


def passages(path: Path, car: Car, first: float, last: float, width: float, step: float) -> Passages:
    """When the car, by the GPS, was in each piece of the path of `width` m, in bins of `step` s since `first`."""
    time = np.arange(first, last, step)
    driven = car.at(time)
    cell, far = path.nearest(driven.position)
    there = driven.known & (far < BESIDE) & (driven.speed > SLOW)
    piece = np.floor(cell * STEP / width).astype(np.int64)
    rows, count = np.flatnonzero(there), int(len(path.points) * STEP / width) + 1
    if not len(rows):
        return Passages(np.zeros(count + 1, np.int64), np.zeros(0, np.int64), np.zeros(0))
    # A visit is a run of bins in one piece; each counts once, however long it lasts.
    fresh = np.concatenate([[True], (np.diff(rows) > 20) | (np.diff(piece[rows]) != 0)])
    visit = np.cumsum(fresh) - 1
    share = 1.0 / np.bincount(visit)[visit]
    order = np.argsort(piece[rows], kind="stable")
    begin = np.searchsorted(piece[rows][order], np.arange(count + 1))
    return Passages(begin, rows[order], share[order])


@cache
def dynamic_program() -> Any:
    """`best(scores, begin, bins, share, shift, fresh, trace)`: score of the best monotone path, and where it ends.

    With `fresh` of `NEVER` a path runs from the first piece to the last. Otherwise it may begin at any piece with that
    score and end at any (Smith and Waterman 1981).
    """

    def best(
        scores: Any, begin: Any, bins: Any, share: Any, shift: int, fresh: float, trace: Any
    ) -> tuple[float, int, int]:
        pieces, length = scores.shape
        places = len(begin) - 1
        straight = np.zeros(places)
        loop = np.full(places, NEVER)
        following, looping = np.empty(places), np.empty(places)
        keep, highest = trace.shape[0] > 0, NEVER
        for piece in range(pieces):
            for place in range(places):
                heard = 0.0
                for index in range(begin[place], begin[place + 1]):
                    at = bins[index] + shift
                    if 0 <= at < length:
                        heard += share[index] * scores[piece, at]
                if piece == 0:
                    following[place], looping[place] = heard, LOOP
                    continue
                if place >= 1:
                    value, how = straight[place - 1], 0
                    if loop[place - 1] > value:
                        value, how = loop[place - 1], 1
                    if place >= 2 and straight[place - 2] + SKIP > value:
                        value, how = straight[place - 2] + SKIP, 2
                else:
                    value, how = NEVER, 0
                following[place] = max(value, fresh) + heard
                highest = max(highest, following[place])
                stay, begun = loop[place] + INSIDE, straight[place] + LOOP
                looping[place] = max(stay, begun)
                if keep:
                    trace[piece, place, 0] = how
                    trace[piece, place, 1] = 1 if stay >= begun else 0
            straight, following = following, straight
            loop, looping = looping, loop
        if fresh > NEVER:
            return highest, 0, 0
        end, last = 0, 0
        for place in range(places):
            if straight[place] > straight[end]:
                end = place
            if loop[place] > loop[last]:
                last = place
        if loop[last] > straight[end]:
            return loop[last], last, 1
        return straight[end], end, 0

    return compiled(best)


def traced(trace: NDArray[np.int8], end: int, mode: int) -> NDArray[np.int64]:
    """Place of each piece [piece] along the best path."""
    found = np.zeros(len(trace), np.int64)
    place = end
    for piece in range(len(trace) - 1, -1, -1):
        found[piece] = place
        if mode == 1:
            mode = int(trace[piece, place, 1])
            continue
        how = int(trace[piece, place, 0])
        place = max(0, place - (2 if how == 2 else 1))
        mode = 1 if how == 1 else 0
    return found
