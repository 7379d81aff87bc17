"""The clock of a drive from all fixes and picks at once: the fiber is a better odometer than the GPS.

The smoother along the channels takes the car's smoothed track as it is, with errors of a size and a memory. But fixes
and picks of one leg tell of one motion: where the fiber says how the car went from channel to channel, each fix is one
more measurement of the clock. Here the car's motion along the path, the slow error of its fixes, the channels' cells,
their stretch and the clock are solved for together, by sparse least squares. Only the clock is taken from it.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.drive.along import CLOCK, FAST, MEMORY, PULL, SLOW, WANDER, Steps
from solver.drive.path import STEP, Path
from solver.trajectory.kalman import process_noise, transition

if TYPE_CHECKING:
    from solver.drive.car import Car
    from solver.drive.picks import Picks
    from solver.drive.response import Clock, Legs

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Unknowns of the car at each fix and pick of a leg: how far along the path it is beyond the smoothed track, cells, the
#: first two derivatives of that, the slow error of its fixes, and the pull of other vehicles on picks, sigmas.
CAR = 5
#: m/s, of the smoothed track's speed at the first of them.
SPEED = 5.0
#: Times that the equations are made, each with the speeds of the one before.
LINEARIZED = 2
#: Sigmas beyond which a fix weighs less.
ROBUST = 3.5
#: s, cells^2: no step of time and none along the path is shorter or surer.
LEAST = 1e-3


@dataclass
class Equations:
    """Linear equations of weight one, gathered: row, column, coefficient; and right sides."""

    rows: list[Numbers] = field(default_factory=list)
    columns: list[Numbers] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    right: list[Array] = field(default_factory=list)
    count: int = 0

    def add(self, columns: Numbers, values: Array, right: Array | float, sigma: Array) -> None:
        """Add `values` [equation, term] times unknowns `columns` = `right` [equation], give or take `sigma`."""
        number, terms = columns.shape
        self.rows.append(np.repeat(self.count + np.arange(number), terms))
        self.columns.append(columns.ravel())
        self.values.append((np.broadcast_to(values, columns.shape) / np.reshape(sigma, (-1, 1))).ravel())
        self.right.append(np.broadcast_to(right, number) / sigma)
        self.count += number

    def solved(self, size: int, asked: int) -> tuple[Array, float]:
        """All unknowns [`size`], and the standard deviation of that which is `asked`."""
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        where = np.concatenate(self.rows), np.concatenate(self.columns)
        matrix = csc_matrix((np.concatenate(self.values), where), (self.count, size))
        one = np.zeros(size)
        one[asked] = 1.0
        normal = (matrix.T @ matrix).tocsc()
        factors = splu(normal, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        found = factors.solve(np.stack([matrix.T @ np.concatenate(self.right), one], -1))
        return found[:, 0], float(np.sqrt(found[asked, 1]))


@dataclass(frozen=True)
class Drove:
    """What tells how the car went along the channels.

    Parameters
    ----------
    picks, legs : of a clock
    weight : of each pick, 0 to 1 [leg, channel]
    steps, factor_sigma, spacing, drift_sigma : as of `solver.drive.along.smoothed_along`
    car, path, clock : whose fixes, along which path, by which clock of the record
    """

    picks: "Picks"
    legs: "Legs"
    weight: Array
    steps: Steps
    factor_sigma: float
    spacing: float
    drift_sigma: float
    car: "Car"
    path: Path
    clock: "Clock"

    @property
    def half(self) -> float:
        """Of the record, s."""
        return len(self.legs.cell) / self.legs.rate / 2

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which picks count [leg, channel]."""
        return np.asarray(np.isfinite(self.picks.cell) & (self.weight > 0))

    @property
    def tau(self) -> int:
        """The unknown that is the clock's offset; its drift is the next, and cells and stretches are before it."""
        return 2 * len(self.steps.advance)


def clock_of_fixes(drove: Drove) -> tuple[float, float]:
    """By how much the clock is off, and the standard deviation of that, s; of `CLOCK` where nothing is heard.

    Where the smoothed track's speed is off, as the GPS tells it less well than the fiber, a pick moves with the clock
    by other than that: the equations are made anew with the speeds that are found.
    """
    picks, legs, known = drove.picks, drove.legs, drove.known
    if not known[: legs.count].any():
        return 0.0, CLOCK
    speed = picks.speed.copy()
    for _ in range(LINEARIZED):
        found = Equations()
        chain(found, drove)
        size, places = drove.tau + 2, {}
        for leg in range(legs.count):
            if known[leg].any():
                places[leg], size = one_leg(found, drove, leg, speed[leg], size)
        solution, sigma = found.solved(size, drove.tau)
        for leg, at in places.items():
            speed[leg, known[leg]] = picks.speed[leg, known[leg]] + solution[at + 1]
    return float(solution[drove.tau]), sigma


def chain(found: Equations, drove: Drove) -> None:
    """Add how channels lie along the path, what is known of the clock, and anchors."""
    steps, legs, tau = drove.steps, drove.legs, drove.tau
    channels = tau // 2
    here = np.arange(1, channels)
    one = np.ones(channels - 1)
    found.add(
        np.stack([here, here - 1, channels + here], -1),
        np.stack([one, -one, -steps.stretched[1:]], -1),
        steps.advance[1:],
        np.sqrt(np.maximum(steps.variance[1:], LEAST)),
    )
    wander = WANDER * np.sqrt(drove.spacing / 100)
    found.add(channels + np.stack([here, here - 1], -1), np.array([[1.0, -1.0]]), 0.0, wander * one)
    before = np.array([drove.factor_sigma, CLOCK, drove.drift_sigma * drove.half])
    found.add(np.array([[channels], [tau], [tau + 1]]), np.ones((1, 1)), 0.0, before)
    for leg in range(legs.count, len(drove.known)):
        # Anchors have no car, and no clock.
        there = np.flatnonzero(drove.known[leg])
        found.add(there[:, None], np.ones((1, 1)), drove.picks.cell[leg, there], drove.picks.sigma[leg, there])


def one_leg(found: Equations, drove: Drove, leg: int, speed: Array, size: int) -> tuple[Numbers, int]:
    """Add a leg with unknowns from `size` on; where those of its picks begin [pick], and how many there are then.

    `speed` : of the car along the path at each channel, cells per second [channel]
    """
    picks, legs, car, there = drove.picks, drove.legs, drove.car, np.flatnonzero(drove.known[leg])
    passed = picks.row[leg, there] / legs.rate
    fixed = drove.clock.of_record(car.time, 2 * drove.half)
    fixes = np.flatnonzero((fixed >= passed.min()) & (fixed <= passed.max()))
    time = np.concatenate([passed, fixed[fixes]])
    order = np.argsort(time, kind="stable")
    place = np.empty_like(order)
    place[order] = size + CAR * np.arange(len(order))
    motion(found, place[order], time[order], car)
    at, behind = place[: len(there)], place[len(there) :]
    one, pull = np.ones(len(there)), np.hypot(PULL / STEP, drove.steps.askew[there])
    lever = speed[there] * (passed / drove.half - 1)
    found.add(
        np.stack([there, drove.tau * one.astype(np.int64), (drove.tau + 1) * one.astype(np.int64), at, at + 4], -1),
        np.stack([one, speed[there], lever, -one, pull], -1),
        picks.cell[leg, there],
        picks.sigma[leg, there] / np.sqrt(drove.weight[leg, there]),
    )
    smoothed = car.smoothed.mean[fixes, 0, :, 0]
    cell, _ = drove.path.nearest(smoothed)
    off = ((car.fixes[fixes] - smoothed) * drove.path.along[cell]).sum(1) / STEP
    sigma = car.sigma / STEP
    # Fixes whose errors last for longer than the time between them are fewer measurements.
    kept = np.exp(-float(np.median(np.diff(car.time))) / car.memory)
    white = sigma * np.sqrt((1 - SLOW**2) * (1 + kept) / (1 - kept))
    weak = np.maximum(1.0, np.abs(off) / (ROBUST * sigma))
    found.add(np.stack([behind, behind + 3], -1), np.array([[1.0, SLOW * sigma]]), off, white * weak)
    return at, size + CAR * len(order)


def motion(found: Equations, at: Numbers, time: Array, car: "Car") -> None:
    """Add how the car moves on between fixes and picks at times, s, whose unknowns begin at `at` (Singer 1970)."""
    gone = np.maximum(np.diff(time), LEAST)
    memory, swing = max(MEMORY, car.memory), float(np.median(car.model[0]))
    move = transition(gone, np.array(memory))[:, :3, :3]
    spread = process_noise(gone, np.array(swing), np.array(memory))[:, :3, :3] + 1e-8 * np.eye(3)
    root = np.linalg.inv(np.linalg.cholesky(spread))
    three = np.arange(3)
    columns = np.concatenate([at[:-1, None] + three, at[1:, None] + three], 1)
    both = np.concatenate([-root @ move, root], 2)
    found.add(np.repeat(columns, 3, axis=0), both.reshape(-1, 6), 0.0, np.ones(1))
    for number, lasting in ((3, memory), (4, FAST)):
        keeps = np.exp(-gone / lasting)
        found.add(
            np.stack([at[:-1], at[1:]], -1) + number,
            np.stack([-keeps, np.ones(len(keeps))], -1),
            0.0,
            np.sqrt(1 - keeps**2),
        )
    first = at[0] + np.array([[1], [2], [3], [4]])
    found.add(first, np.ones((1, 1)), 0.0, np.array([SPEED, swing, 1.0, 1.0]))
