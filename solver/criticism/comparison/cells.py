"""Every fitted sample as a cell: the nearest vehicle, its distance, the residual, and what could explain that."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from solver.criticism.comparison.changes import Change, linear, shifted, transposed
from solver.noise.sample_runs import blocks_of
from solver.noise.whitening import Whitener
from solver.trajectory.vehicle_pass import Pass

if TYPE_CHECKING:
    from solver.run.run import Run

Array = NDArray[np.float64]

#: Distance within which a vehicle is near, m: beyond it a car bends the ground by less than 1 % of the most.
NEAR = 25.0
#: Distance from all vehicles beyond which only noise is expected, m, and the fewest such cells that tell its level.
FAR, ENOUGH = 35.0, 400
#: Cells whose energies are summed to measure how much the noise's power scatters.
CLUMP = 16
#: Median of chi2 with as many degrees of freedom, the distance of its quartiles, and the variance of a mean beside that
#: of a median of many.
MEDIAN, BETWEEN, EFFICIENCY = 15.338, 19.369 - 11.912, 0.63
#: Samples that the common noise level counts for beside each channel's own.
PRIOR_COUNTS = 100
#: Two lanes are at least so far apart, m.
LANE_WIDTH = 1.5
#: Slowest vehicle whose delay is told in meters, m/s.
SLOWEST = 1.0


@dataclass(frozen=True)
class Approach:
    """Where the nearest known vehicle is.

    Parameters
    ----------
    owner : [sample, channel], index of the nearest vehicle's pass; -1 where none is on the road
    ahead : [sample, channel], m along the fiber, positive where the vehicle is heading; NaN without one
    gap : [sample, channel], horizontal distance from it, m; inf without one
    speed : [sample, channel], its speed, m/s; NaN without one
    lateral : [pass], median offset of the fiber's nearest point from the vehicle, to the right of its travel, m
    forward : [pass] bool, whether it goes toward higher channels
    """

    owner: NDArray[np.int64]
    ahead: Array
    gap: Array
    speed: Array
    lateral: Array
    forward: NDArray[np.bool_]

    @property
    def near(self) -> NDArray[np.bool_]:
        """Cells [sample, channel] that a known vehicle is near."""
        return self.gap <= NEAR


@dataclass(frozen=True)
class OnFiber:
    """One vehicle as the fiber sees it: `along` [row] (m of fiber), `offset` [row, 2] from it to its nearest point."""

    along: Array
    offset: Array


def on_fiber(position: Array, route: Array, distance: Array) -> OnFiber:
    """Place of a vehicle along a fiber, continued straight beyond the fiber's ends.

    Parameters
    ----------
    position : [row, 2], m
    route : [channel, 2], m
    distance : [channel], m along the fiber

    >>> line = np.stack([np.arange(5.0), np.zeros(5)], 1)
    >>> on_fiber(np.array([[2.25, 3.0], [9.0, 0.0]]), line, np.arange(5.0)).along.tolist()
    [2.25, 9.0]
    """
    direction = np.gradient(route, distance, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    nearest = np.linalg.norm(position[:, None] - route, axis=2).argmin(1)
    beyond = position - route[nearest]
    forth = (beyond * direction[nearest]).sum(1)
    return OnFiber(distance[nearest] + forth, forth[:, None] * direction[nearest] - beyond)


def approach_of(run: "Run") -> Approach:
    """Find the nearest known vehicle of every fitted sample and channel."""
    result = run.result
    at = np.searchsorted(result.channel, result.fitted_channel)
    distance, shape = result.distance[at], (len(result.samples), len(at))
    owner, ahead = np.full(shape, -1), np.full(shape, np.nan)
    gap, speed = np.full(shape, np.inf), np.full(shape, np.nan)
    lateral, forward = [], []
    for number, one in enumerate(run.passes):
        rows, inside = rows_between(result.samples, one)
        seen = on_fiber(one.position[inside], result.route[:, :2], result.distance)
        onward = bool(seen.along[-1] >= seen.along[0]) if len(rows) else True
        apart = np.linalg.norm(one.position[inside][:, None] - result.route[at, :2], axis=2)
        closer = apart < gap[rows]
        signed = (distance - seen.along[:, None]) * (1 if onward else -1)
        pace = np.broadcast_to(np.linalg.norm(one.velocity[inside], axis=1)[:, None], apart.shape)
        for whole, part in ((owner, np.full_like(apart, number, int)), (ahead, signed), (gap, apart), (speed, pace)):
            whole[rows] = np.where(closer, part, whole[rows])
        velocity = one.velocity[inside]
        right = (seen.offset * np.stack([-velocity[:, 1], velocity[:, 0]], 1)).sum(1)
        lateral.append(np.median(right / np.maximum(np.linalg.norm(velocity, axis=1), SLOWEST)) if len(rows) else 0.0)
        forward.append(onward)
    return Approach(owner, ahead, gap, speed, np.array(lateral), np.array(forward))


def rows_between(samples: NDArray[np.int64], one: Pass) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the samples that belong to a pass, and which of the pass's rows they are."""
    _, rows, inside = np.intersect1d(samples, one.rows, return_indices=True)
    return rows, inside


def lanes(approach: Approach) -> tuple[NDArray[np.int64], list[str]]:
    """Lane [pass] and names of the lanes: passes of one direction, at about the same distance beside the fiber."""
    number, names = np.zeros(len(approach.forward), int), list[str]()
    for forward in (True, False):
        chosen = np.flatnonzero(approach.forward == forward)
        chosen = chosen[np.argsort(approach.lateral[chosen])]
        cuts = np.flatnonzero(np.diff(approach.lateral[chosen]) > LANE_WIDTH) + 1
        for lane in np.split(chosen, cuts):
            if len(lane):
                offset = float(np.median(approach.lateral[lane]))
                number[lane] = len(names)
                side = "right" if offset > 0 else "left"
                names.append(f"{'up' if forward else 'down'} the channels, fiber {abs(offset):.1f} m {side}")
    return number, names


@dataclass(frozen=True)
class Cells:
    """The residual and the simplest changes that could explain it, whitened and weighted alike, [sample, channel].

    Parameters
    ----------
    approach : the nearest known vehicle
    there : bool, measured and used
    residual : unit variance where only noise is left, 0 where nothing was measured
    gain : change of the data if the response were 100 % larger
    late : change if it came 1 s later
    place : change if it lay 1 m farther along the fiber
    offset : change by a constant of one noise sigma
    changes : the four by name, of any size and not whitened
    whiten : raw [sample, channel], 1/s, and the whole blocks of samples it is of -> whitened and weighted
    level : [channel], mean square of the residual where only noise is
    spread : scatter of sums of its squares relative to that of white noise, as a ratio of variances
    """

    approach: Approach
    there: NDArray[np.bool_]
    residual: Array
    gain: Array
    late: Array
    place: Array
    offset: Array
    changes: dict[str, Change]
    whiten: Callable[[Array, slice], Array]
    level: Array
    spread: float

    @property
    def floor(self) -> float:
        """Mean square of the residual that noise alone leaves."""
        return float(self.level @ self.there.sum(0)) / max(int(self.there.sum()), 1)


def cells_of(run: "Run") -> Cells:
    """Whiten what a run left, and its model's derivatives."""
    result, approach = run.result, approach_of(run)
    there = np.isfinite(result.measured) & (result.weight > 0)
    soft = np.sqrt(np.where(there, result.weight, 0.0))

    def whiten(raw: Array, part: slice = slice(None)) -> Array:
        noise = torch.from_numpy(result.noise)
        whitener = Whitener(noise, result.samples[part], result.fitted_channel, result.law)
        return np.asarray(whitener(torch.from_numpy(np.where(there[part], raw, 0.0))).numpy() * soft[part])

    residual = whiten(np.where(there, result.unexplained(), 0.0))
    distance = result.distance[np.searchsorted(result.channel, result.fitted_channel)]
    changes = {
        "gain": linear(result.model),
        "late": shifted(result.model, run.time, blocks_of(result.samples)),
        "place": transposed(shifted(result.model.T, distance, [slice(0, len(distance))])),
        "offset": linear(np.broadcast_to(result.noise, residual.shape)),
    }
    level, spread = noise_of(residual, there, approach.gap > FAR, run.facts["noise_floor"])
    return Cells(
        approach,
        there,
        residual,
        **{name: whiten(change.slope(0.0)) for name, change in changes.items()},
        changes=changes,
        whiten=whiten,
        level=level,
        spread=spread,
    )


def noise_of(
    residual: Array, there: NDArray[np.bool_], far: NDArray[np.bool_], floor: float | None
) -> tuple[Array, float]:
    """Mean square [channel] of the residual where no vehicle is, and how much sums of squares scatter beyond chi2.

    Medians and quartiles, so that a vehicle that nobody saw does not count as noise. Where too few cells are far from
    all vehicles, the noise floor of the fit serves.

    Parameters
    ----------
    residual : [sample, channel], whitened
    there, far : [sample, channel] bool, measured; with no known vehicle near
    floor : mean square that the fit's own noise audit expects, None where it could not tell
    """
    quiet = there & far
    square = residual[quiet] ** 2
    if len(square) < ENOUGH:
        return np.full(residual.shape[1], max(1.0, floor or 1.0)), 1.0
    energy = square[: len(square) // CLUMP * CLUMP].reshape(-1, CLUMP).sum(1)
    low, high = np.quantile(energy, [0.25, 0.75])
    level = max(middle(square), 0.5)
    spread = max(1.0, float((high - low) / level / BETWEEN) ** 2)
    own = np.array([own_level(column[use], level) for column, use in zip((residual**2).T, quiet.T, strict=True)])
    # The level is estimated too, which adds to the scatter.
    near = max(int((there & ~far).sum()), 1)
    return own, spread * (1 + near / (near + len(square)))


def middle(square: Array) -> float:
    """Mean of squares [cell] by the median of sums over `CLUMP` of them: a vehicle fills few of those.

    >>> white = np.random.default_rng(0).normal(size=4000) ** 2
    >>> white[800:1200] = 50.0  # a tenth of the cells
    >>> 1.0 < middle(white) < 1.1
    True
    """
    energy = square[: len(square) // CLUMP * CLUMP].reshape(-1, CLUMP).sum(1)
    return float(np.median(energy)) / MEDIAN


def own_level(square: Array, level: float) -> float:
    """Noise level of a channel from squares [sample] in time, shrunk toward that of all channels.

    >>> own_level(np.full(100, 3.0), 1.0) < 2.0, own_level(np.full(5, 3.0), 1.0)
    (True, 1.0)
    """
    counts = EFFICIENCY * (len(square) // CLUMP * CLUMP)
    found = middle(square) if counts else level
    return (counts * found + PRIOR_COUNTS * level) / (counts + PRIOR_COUNTS)


def strength(run: "Run", cells: Cells) -> Array:
    """How strongly each cell's vehicle drives it [sample, channel]: RMS of its model per speed, times the speed, 1/s.

    A weight that passes over a fiber at speed v makes strain rates in proportion to v and to its load; 0 without one.
    """
    approach, model = cells.approach, run.result.model
    near = approach.near & cells.there & (approach.speed > 0)
    owner, count = approach.owner[near], len(run.passes)
    square = np.bincount(owner, (model[near] / approach.speed[near]) ** 2, count)
    number = np.bincount(owner, minlength=count)
    load = np.sqrt(np.divide(square, number, out=np.zeros(count), where=number > 0))
    return np.where(approach.owner >= 0, load[approach.owner] * np.nan_to_num(approach.speed), 0.0)
