"""Positions along the path, with the clock and the errors of the GPS: a Kalman smoother over the channels.

State at a channel: its cell, the relative stretch of the cable there, the clock offset that is left, how far the clock
has drifted by the end of the record, and on each leg two errors of the car's position along the path: a slow one of the
GPS, and a fast one, of what smoothing leaves of the GPS's noise and of other vehicles near the car, that pull the peaks
of all channels that they pass. A pick on a leg is the channel's cell, plus speed times the clock, plus both, plus its
own.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.drive.path import STEP, Path
from solver.drive.smoother import ERRORS, smooth

if TYPE_CHECKING:
    from solver.drive.picks import Picks
    from solver.drive.response import Legs

Array = NDArray[np.float64]

#: How much the stretch wanders over 100 m of cable, and each step besides, as shares.
WANDER, JITTER = 0.003, 0.01
#: m of path over which it changes how far the map lies beside the cable: beside a bend it is longer or shorter by that.
OFFSET = 300.0
#: m, about the length of a bend, all through which the map is off by the same.
BEND = 30.0
#: s, correlation time of the slow errors of a GPS track at least; share of a fix's sigma that is so slow that no
#: smoothing takes it out, as receivers' errors from the ionosphere and from walls are.
MEMORY, SLOW = 30.0, 0.55
#: s, correlation time of the fast errors, and their standard deviation, m, beside what smoothing leaves of a fix's.
FAST, PULL = 3.0, 0.25
#: Degrees of freedom of the fast errors: a vehicle close to the car may pull by meters.
FREEDOM = 3.0
#: s, of the clock offset that is left after the first look.
CLOCK = 2.0
#: By how much one clock runs faster than another at most, as quartz does.
QUARTZ = 2e-5
#: Sigmas beyond which a pick weighs less, and rounds of weighing.
ROBUST, ROUNDS = 2.5, 4
#: Probability of slack below which a step is as long as any.
RARE = 0.02
#: m, standard deviation of the first cell.
WIDE = 1e4


@dataclass(frozen=True)
class Along:
    """The smoothed positions.

    Parameters
    ----------
    cell, sigma : of each channel, cells [channel]
    stretch : meters of cable per meter of path less the factor, relative [channel]
    clock, clock_sigma : s to add to the clock offset, and its standard deviation
    drift, drift_sigma : share of the time that the record's clock gains on the GPS's, and its standard deviation
    weight : of each pick, 0 to 1 [leg, channel]
    residual : of each pick, cells, after clock and errors of the car [leg, channel]
    error : of the car along the path as it passes, cells [leg, channel]
    """

    cell: Array
    sigma: Array
    stretch: Array
    clock: float
    clock_sigma: float
    drift: float
    drift_sigma: float
    weight: Array
    residual: Array
    error: Array


@dataclass(frozen=True)
class Steps:
    """From each channel to the next.

    Parameters
    ----------
    advance : cells, without stretch [channel]; that of the first is not used
    stretched : cells per unit of stretch [channel]
    bent : cells for each standard deviation of how far the map lies beside the cable [channel]
    variance : of the advance, cells^2 [channel]
    askew : standard deviation of where the car seems to pass, cells [channel]: what lies square to a map that turns is
        not sure
    """

    advance: Array
    stretched: Array
    bent: Array
    variance: Array
    askew: Array


def bends_of(path: Path, cell: Array, spacing: float, sigma: float) -> Array:
    """Standard deviation of each channel's advance, cells [channel], from bends that a map of `sigma`, m, cuts."""
    number = np.clip(np.round(cell).astype(np.int64), 0, len(path.points) - 1)
    return np.asarray(sigma * path.turn[number] * np.sqrt(spacing * max(spacing, BEND)) / STEP)


def steps_of(
    path: Path, cell: Array, loop: NDArray[np.bool_], slack: Array, spacing: float, factor: float, sigma: float
) -> Steps:
    """How far channels are apart along the path.

    Parameters
    ----------
    cell : about where each channel lies [channel]
    loop : whether it lies in a loop [channel]
    slack : probability that it lies in one that cannot be placed, such as where the car was not beside [channel]
    sigma : of the map, m: in bends a cable beside the path is longer or shorter than the path
    """
    step = spacing / factor / STEP
    variance = np.full(len(cell), (JITTER * step) ** 2)
    # Each step is no step at all with that probability: mean and variance.
    share = np.where(loop, 0.0, slack)
    share = np.where(share > RARE, share, 0.0)
    advance, stretched, variance = (1 - share) * step, (1 - share) * step, variance + share * (1 - share) * step**2
    before = np.concatenate([[False], loop[:-1]])
    # Into a loop and out of it the path goes on by any part of a step; within it, not at all.
    edge, inside = loop ^ before, loop & before
    bent = path.heading_at(cell, step) * sigma / np.sqrt(2) / STEP * (1 - share)
    bent[edge], bent[inside] = bent[edge] / 2, 0.0
    advance[edge], stretched[edge] = step / 2, 0.0
    variance[edge] = step**2 / 12
    advance[inside], stretched[inside], variance[inside] = 0.0, 0.0, 1e-6
    number = np.clip(np.round(cell).astype(np.int64), 0, len(path.points) - 1)
    return Steps(advance, stretched, bent, variance, path.spread_of_heading(sigma)[number] * sigma / STEP)


def smoothed_along(
    picks: "Picks",
    legs: "Legs",
    steps: Steps,
    factor_sigma: float,
    gps: tuple[float, float],
    spacing: float,
    drift_sigma: float = QUARTZ,
    clock: tuple[float, float] = (0.0, np.inf),
) -> Along:
    """Smooth the picks along the channels.

    Parameters
    ----------
    factor_sigma : standard deviation of the length factor
    gps : time over which errors of the fixes are correlated, s, and their sigma, m
    spacing : of the channels, m
    drift_sigma : standard deviation of the clock's drift, a share of the time
    clock : what else tells of the clock offset that is left, and the standard deviation of that, s
    """
    weight = np.where(picks.audible, 1.0, 0.0)
    model = Model.of(picks, legs, steps, factor_sigma, gps, spacing, drift_sigma, clock)
    for number in range(ROUNDS + 1):
        mean, covariance = model.smooth(weight)
        error, fitted = model.fitted(mean)
        if number == ROUNDS:
            break
        off = np.abs(picks.cell - fitted) / picks.sigma
        # Student's t with 4 degrees of freedom, but for what lies within `ROBUST` sigmas.
        weight = np.where(picks.audible, np.where(off < ROBUST, 1.0, (ROBUST / np.maximum(off, ROBUST)) ** 2), 0.0)
        model = model.loosened(mean)
    return Along(
        cell=mean[:, 0],
        sigma=np.sqrt(np.maximum(covariance[:, 0, 0], 0)),
        stretch=mean[:, 1],
        clock=float(mean[0, 2]),
        clock_sigma=float(np.sqrt(covariance[0, 2, 2])),
        drift=float(mean[0, 3]) / model.half,
        drift_sigma=float(np.sqrt(covariance[0, 3, 3])) / model.half,
        weight=weight,
        residual=picks.cell - fitted,
        error=error,
    )


@dataclass(frozen=True)
class Model:
    """The state space model.

    Parameters
    ----------
    slow, fast : standard deviations of the car's errors, cells [leg, channel]
    keeps : share that each error keeps from the channel before [slow and fast legs and the map, channel]
    loose : how much wider the fast errors are than `fast` [leg, channel]
    wander : variance of the stretch from channel to channel
    half : of the record, s: the clock's drift counts from its middle
    drift_sigma : standard deviation of the clock's drift, a share of the time
    clock : what else tells of the clock offset that is left, and the standard deviation of that, s
    rate : samples per second
    """

    picks: "Picks"
    steps: Steps
    slow: Array
    fast: Array
    keeps: Array
    loose: Array
    factor_sigma: float
    wander: float
    half: float
    drift_sigma: float
    clock: tuple[float, float]
    rate: float

    @classmethod
    def of(
        cls,
        picks: "Picks",
        legs: "Legs",
        steps: Steps,
        factor_sigma: float,
        gps: tuple[float, float],
        spacing: float,
        drift_sigma: float,
        clock: tuple[float, float] = (0.0, np.inf),
    ) -> "Model":
        """The model of some picks."""
        there = picks.row >= 0  # anchors have no car
        sigma = np.hypot(np.hypot(*legs.driven.sigma.T) / np.sqrt(2), PULL) / STEP
        gone = np.abs(np.diff(picks.row, axis=1, prepend=picks.row[:, :1])) / legs.rate
        return cls(
            picks,
            steps,
            slow=np.where(there, SLOW * gps[1] / STEP, 0.0),
            fast=np.where(there, np.hypot(sigma[picks.row], steps.askew), 0.0),
            keeps=np.concatenate(
                [
                    np.exp(-gone / max(MEMORY, gps[0])),
                    np.exp(-gone / FAST),
                    np.exp(-steps.advance * STEP / OFFSET)[None],
                ]
            ),
            loose=np.ones(picks.row.shape),
            factor_sigma=factor_sigma,
            wander=WANDER**2 * spacing / 100,
            half=len(legs.cell) / legs.rate / 2,
            drift_sigma=drift_sigma,
            clock=clock,
            rate=legs.rate,
        )

    @property
    def scale(self) -> Array:
        """Standard deviations of all errors, cells [slow and fast legs, channel]."""
        return np.concatenate([self.slow, self.loose * self.fast])

    @property
    def lever(self) -> Array:
        """Cells that a pick goes on for a second that the clock has gained by the end of the record [leg, channel]."""
        return np.asarray(self.picks.speed * (self.picks.row / self.rate / self.half - 1))

    def fitted(self, mean: Array) -> tuple[Array, Array]:
        """Error of the car along the path, and the picks as fitted, cells [leg, channel], of means [channel, state]."""
        error = np.asarray((self.scale * mean[:, ERRORS:-1].T).reshape(2, *self.slow.shape).sum(0))
        return error, mean[:, 0] + self.picks.speed * mean[:, 2] + self.lever * mean[:, 3] + error

    def loosened(self, mean: Array) -> "Model":
        """The same with fast errors as wide as Student's t has them, given means [channel, state]."""
        off = self.loose * mean[:, ERRORS + len(self.slow) : -1].T
        return replace(self, loose=np.sqrt(np.maximum(1.0, (FREEDOM + off**2) / (FREEDOM + 1))))

    def smooth(self, weight: Array) -> tuple[Array, Array]:
        """Mean [channel, state] and covariance [channel, state, state]."""
        legs = len(weight)
        size = ERRORS + 2 * legs + 1
        first = next((int(one) for one in np.flatnonzero((weight > 0).any(0))), 0)
        begun = np.nanmin(np.where(weight[:, first] > 0, self.picks.cell[:, first], np.nan)) if weight.any() else 0.0
        mean, covariance = np.zeros(size), np.eye(size)
        mean[0] = begun - self.steps.advance[1 : first + 1].sum()
        drift = (self.drift_sigma * self.half) ** 2
        told = 1 / (1 / CLOCK**2 + 1 / self.clock[1] ** 2)
        mean[2] = told * self.clock[0] / self.clock[1] ** 2
        covariance[range(ERRORS), range(ERRORS)] = [WIDE**2, self.factor_sigma**2, told, drift]
        channel, leg = np.nonzero(weight.T > 0)
        taken = [np.ascontiguousarray(one[leg, channel]) for one in (self.picks.cell, self.picks.sigma, weight)]
        speed, lever = self.picks.speed[leg, channel], self.lever[leg, channel]
        return smooth(
            self.steps.advance,
            self.steps.stretched,
            self.steps.bent,
            self.steps.variance,
            self.wander,
            self.keeps,
            np.concatenate([self.scale, np.zeros((1, len(self.steps.advance)))]),
            np.append(np.tile(np.arange(legs), 2), -1),
            channel,
            leg,
            taken[0],
            taken[1] ** 2 / taken[2],
            speed,
            lever,
            mean,
            covariance,
        )
