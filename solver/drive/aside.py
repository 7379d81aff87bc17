"""How far beside the path the fiber lies, and how deep: from the shape of what channels record as the car goes by.

Every pass tells the distance of the car from the fiber, not the side; the car's lanes and the map decide that. Depth
shows where the car passes within some 4 m of the fiber: farther off, more depth looks as more distance does.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

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
#: m, that a fiber wanders sideways within a stretch; and by how much its depth is off, as it wanders, too, and as
#: Poisson's ratio is known to 0.05.
WANDER, ROUGH = 1.0, 0.14
#: Depths that are weighed: standard deviations of the prior below its mean and above it, how many, and m at least.
BELOW, ABOVE, DEPTHS, SHALLOW = 2.0, 2.5, 7, 0.2


@dataclass(frozen=True)
class Aside:
    """Lateral place of each channel, m to the right of the path [channel], its sigma, and the data's share in that.

    `depth` and `depth_sigma`, m [channel]. `far` is how far the car that it heard passed beside it, m [channel]; 0
    where it heard none.
    """

    lateral: Array
    sigma: Array
    share: Array
    depth: Array
    depth_sigma: Array
    far: Array


def beside(
    quiet: Quiet,
    path: Path,
    car: Car,
    legs: Legs,
    cell: Array,
    audible: NDArray[np.bool_],
    polarity: int,
    sigma: float,
    depth: tuple[float, float],
) -> Aside:
    """Where beside the path each channel lies, and how deep.

    Parameters
    ----------
    cell : of each channel [channel]
    audible : whether it is heard on a leg [leg, channel]
    polarity : of the record
    sigma : of the map, m
    depth : before the data are asked, and its standard deviation, m
    """
    low = np.round(cell).astype(np.int64)
    depths = np.linspace(max(SHALLOW, depth[0] - BELOW * depth[1]), depth[0] + ABOVE * depth[1], DEPTHS)
    asked = np.where(audible.any(0), cell, np.nan)
    ratio = np.stack([ratios_of(quiet, path, car, legs, asked, polarity, depth=one) for one in depths], 1)
    piece = np.floor(cell * STEP / STRETCH).astype(np.int64)
    piece -= piece.min()
    sums, right = np.zeros((piece.max() + 1, DEPTHS, len(PLACES))), np.zeros(audible.shape)
    for leg in range(legs.count):
        row, _ = passing(legs, leg, cell)
        off = legs.driven.position[row] - path.at(cell)
        right[leg] = (off * path.across[np.clip(low, 0, len(path.points) - 1)]).sum(1)
        away = np.clip(np.abs(PLACES - right[leg][:, None]), DISTANCES[0], DISTANCES[-1])
        after = np.clip(np.searchsorted(DISTANCES, away), 1, len(DISTANCES) - 1)
        share = (away - np.take(DISTANCES, after - 1)) / np.take(np.diff(DISTANCES), after - 1)
        for one in np.flatnonzero(audible[leg]):
            there = ratio[:, :, leg, one]
            sums[piece[one]] += (
                (1 - share[one])[:, None] * there[after[one] - 1] + share[one][:, None] * there[after[one]]
            ).T
    lateral, spread, deep, deep_sigma = weighed(sums, cell, sigma, depths, depth)
    far = (np.abs(lateral - right) * audible).sum(0) / np.maximum(audible.sum(0), 1)
    return Aside(lateral, spread, np.clip(1 - spread**2 / sigma**2, 0, 1), deep, deep_sigma, far)


def ratios_of(
    quiet: Quiet,
    path: Path,
    car: Car,
    legs: Legs,
    cell: Array,
    polarity: int,
    side: int = 0,
    depth: float = DEPTH,
    reach: float | None = None,
) -> Array:
    """Log likelihood ratios [distance, leg, channel] of the car at `DISTANCES`, at the best of `side` cells around.

    `cell`, of each channel [channel] or on each leg [leg, channel], may be NaN: nothing is asked of it. `reach` is as
    of `solver.drive.response.responses`.
    """
    cell = np.broadcast_to(cell, (legs.count, np.shape(cell)[-1]))
    asked, count = np.isfinite(cell), len(path.points)
    low = np.where(asked, np.round(np.nan_to_num(cell)), -2 * side - 2).astype(np.int64) - side
    cells = (low[asked][:, None] + np.arange(2 * side + 1)).ravel()
    wanted = np.zeros(count, bool)
    wanted[cells[(cells >= 0) & (cells < count)]] = True
    whole = responses(quiet, path, car, legs, DISTANCES, wanted, depth, reach)
    nothing = np.zeros((cell.shape[1], legs.count))
    found = np.zeros((len(DISTANCES), *cell.shape))
    for number in range(len(DISTANCES)):
        one = replace(whole, values=whole.values[number : number + 1], norm=whole.norm[number : number + 1])
        for leg in range(legs.count):
            found[number, leg] = heard(quiet, one, low[leg], 2 * side + 1, polarity, nothing, leg).ratio.max(1)
    return found


def weighed(
    sums: Array, cell: Array, sigma: float, depths: Array, depth: tuple[float, float]
) -> tuple[Array, Array, Array, Array]:
    """Posteriors of lateral place and depth: mean and standard deviation of either [channel].

    Parameters
    ----------
    sums : of the log likelihood ratios of each stretch's channels [stretch, depth, place]
    cell : of each channel [channel]
    sigma : of the map, m
    depths : m [depth]
    depth : before the data are asked, and its standard deviation, m
    """
    told = COUNTED * sums
    # Neighboring stretches tell of this one too.
    told[1:-1] = 0.6 * told[1:-1] + 0.2 * (told[:-2] + told[2:]) if len(told) > 2 else told[1:-1]
    log = told - 0.5 * (PLACES / sigma) ** 2 - 0.5 * ((depths[:, None] - depth[0]) / depth[1]) ** 2
    mean, variance = moments(np.logaddexp.reduce(log, axis=1), PLACES)
    fine = np.linspace(depths[0], depths[-1], 20 * len(depths))
    deep, deep_variance = moments(CubicSpline(depths, np.logaddexp.reduce(log, axis=2), axis=1)(fine), fine)
    heard = sums.any((1, 2))
    deep = np.where(heard, deep, depth[0])
    deep_variance = np.where(heard, np.minimum(deep_variance + ROUGH**2, depth[1] ** 2), depth[1] ** 2)
    first = np.floor(cell.min() * STEP / STRETCH)
    center = (np.arange(len(mean)) + 0.5 + first) * STRETCH / STEP
    lateral, width, down, thick = (
        np.interp(cell, center, one) for one in (mean, variance + WANDER**2, deep, deep_variance)
    )
    return lateral, np.sqrt(width), down, np.sqrt(thick)


def moments(log: Array, values: Array) -> tuple[Array, Array]:
    """Mean and variance [row] of values whose log probabilities [row, value] are given but for a constant."""
    weight = np.exp(log - log.max(1, keepdims=True))
    weight /= weight.sum(1, keepdims=True)
    mean = weight @ values
    return mean, weight @ values**2 - mean**2
