"""How far beside the path the fiber lies: from the shape of what channels record as the car goes by.

Every pass tells the distance of the car from the fiber, not the side; the car's lanes and the map decide that.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.drive.car import Car
from solver.drive.likelihood import heard
from solver.drive.path import STEP, Path
from solver.drive.picks import passing
from solver.drive.quiet import Quiet
from solver.drive.response import DEPTH, Legs, responses

Array = NDArray[np.float64]

#: m between car and fiber that are compared.
DISTANCES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0, 13.0, 17.0, 22.0)
#: m of path whose channels decide together.
STRETCH = 100.0
#: Share that a channel's likelihood counts: errors of depth and ground are common to neighbors.
COUNTED = 0.15
#: m, places beside the path that are weighed.
PLACES = np.arange(-45.0, 45.1, 0.5)
#: m, that a fiber wanders sideways within a stretch.
WANDER = 1.0


@dataclass(frozen=True)
class Aside:
    """Lateral place of each channel, m to the right of the path [channel], its sigma, and the data's share in that.

    `far` is how far the car that it heard passed beside it, m [channel]; 0 where it heard none.
    """

    lateral: Array
    sigma: Array
    share: Array
    far: Array


def beside(
    quiet: Quiet, path: Path, car: Car, legs: Legs, cell: Array, audible: NDArray[np.bool_], polarity: int, sigma: float
) -> Aside:
    """Where beside the path each channel lies.

    Parameters
    ----------
    cell : of each channel [channel]
    audible : whether it is heard on a leg [leg, channel]
    polarity : of the record
    sigma : of the map, m
    """
    channels, low = len(cell), np.round(cell).astype(np.int64)
    ratio = ratios_of(quiet, path, car, legs, cell, polarity)
    ratio *= audible
    score, right = np.zeros((channels, len(PLACES))), np.zeros((legs.count, channels))
    for leg in range(legs.count):
        row, _ = passing(legs, leg, cell)
        off = legs.driven.position[row] - path.at(cell)
        right[leg] = (off * path.across[np.clip(low, 0, len(path.points) - 1)]).sum(1)
        away = np.abs(PLACES - right[leg][:, None])
        for channel in np.flatnonzero(audible[leg]):
            score[channel] += np.interp(away[channel], DISTANCES, ratio[:, leg, channel])
    lateral, spread = weighed(score, cell, sigma)
    far = (np.abs(lateral - right) * audible).sum(0) / np.maximum(audible.sum(0), 1)
    return Aside(lateral, spread, np.clip(1 - spread**2 / sigma**2, 0, 1), far)


def ratios_of(
    quiet: Quiet, path: Path, car: Car, legs: Legs, cell: Array, polarity: int, side: int = 0, depth: float = DEPTH
) -> Array:
    """Log likelihood ratios [distance, leg, channel] of the car at `DISTANCES`, at the best of `side` cells around.

    `cell` [channel] may be NaN: nothing is asked of that channel.
    """
    asked, count = np.isfinite(cell), len(path.points)
    low = np.where(asked, np.round(np.nan_to_num(cell)), -2 * side - 2).astype(np.int64) - side
    cells = (low[asked, None] + np.arange(2 * side + 1)).ravel()
    wanted = np.zeros(count, bool)
    wanted[cells[(cells >= 0) & (cells < count)]] = True
    whole = responses(quiet, path, car, legs, DISTANCES, wanted, depth)
    nothing = np.zeros((len(cell), legs.count))
    found = np.zeros((len(DISTANCES), legs.count, len(cell)))
    for number in range(len(DISTANCES)):
        one = replace(whole, values=whole.values[number : number + 1], norm=whole.norm[number : number + 1])
        for leg in range(legs.count):
            found[number, leg] = heard(quiet, one, low, 2 * side + 1, polarity, nothing, leg).ratio.max(1)
    return found


def weighed(score: Array, cell: Array, sigma: float) -> tuple[Array, Array]:
    """Posterior of the lateral place and its sigma [channel], of scores [channel, place] and the map's sigma."""
    piece = np.floor(cell * STEP / STRETCH).astype(np.int64)
    piece -= piece.min()
    sums = np.zeros((piece.max() + 1, len(PLACES)))
    np.add.at(sums, piece, COUNTED * score)
    # Neighboring stretches tell of this one too.
    sums[1:-1] = 0.6 * sums[1:-1] + 0.2 * (sums[:-2] + sums[2:]) if len(sums) > 2 else sums[1:-1]
    log = sums - 0.5 * (PLACES / sigma) ** 2
    weight = np.exp(log - log.max(1, keepdims=True))
    weight /= weight.sum(1, keepdims=True)
    mean = weight @ PLACES
    variance = weight @ PLACES**2 - mean**2 + WANDER**2
    center = (np.arange(len(mean)) + 0.5) * STRETCH / STEP + np.floor(cell.min() * STEP / STRETCH) * STRETCH / STEP
    lateral = np.interp(cell, center, mean)
    return lateral, np.sqrt(np.interp(cell, center, variance))
