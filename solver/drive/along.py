"""Positions along the path, with the clock and the errors of the GPS: a Kalman smoother over the channels.

State at a channel: its cell, the relative stretch of the cable there, the clock offset that is left, and on each leg
the error of the car's position along the path (Rauch, Tung and Striebel 1965). A pick on a leg is the channel's cell,
plus speed times the clock, plus the car's error, plus its own.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.drive.path import STEP, Path

if TYPE_CHECKING:
    from solver.drive.picks import Picks
    from solver.drive.response import Legs

Array = NDArray[np.float64]

#: How much the stretch wanders over 100 m of cable, and each step besides, as shares.
WANDER, JITTER = 0.004, 0.01
#: m, about the length of a bend, all through which the map is off by the same.
BEND = 30.0
#: s, correlation time of the errors of a smoothed GPS track at least; share of a fix's sigma that is so slow that no
#: smoothing takes it out, as receivers' errors from the ionosphere and from walls are.
MEMORY, SLOW = 30.0, 0.7
#: s, of the clock offset that is left after the first look.
CLOCK = 2.0
#: Sigmas beyond which a pick weighs less, and rounds of weighing.
ROBUST, ROUNDS = 2.5, 4
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
    weight : of each pick, 0 to 1 [leg, channel]
    residual : of each pick, cells, after clock and errors of the car [leg, channel]
    error : of the car along the path as it passes, cells [leg, channel]
    """

    cell: Array
    sigma: Array
    stretch: Array
    clock: float
    clock_sigma: float
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
    variance : of the advance, cells^2 [channel]
    """

    advance: Array
    stretched: Array
    variance: Array


def bends_of(path: Path, cell: Array, spacing: float, sigma: float) -> Array:
    """Standard deviation of each channel's advance, cells [channel], from bends that a map of `sigma`, m, cuts."""
    number = np.clip(np.round(cell).astype(np.int64), 0, len(path.points) - 1)
    return np.asarray(sigma * path.turn[number] * np.sqrt(spacing * max(spacing, BEND)) / STEP)


def steps_of(path: Path, cell: Array, loop: NDArray[np.bool_], spacing: float, factor: float, sigma: float) -> Steps:
    """How far channels are apart along the path.

    Parameters
    ----------
    cell : about where each channel lies [channel]
    loop : whether it lies in a loop [channel]
    sigma : of the map, m: in bends a cable beside the path is longer or shorter than the path
    """
    step = spacing / factor / STEP
    bend = bends_of(path, cell, spacing, sigma)
    advance = np.full(len(cell), step)
    stretched = np.full(len(cell), step)
    variance = (JITTER * step) ** 2 + bend**2
    before = np.concatenate([[False], loop[:-1]])
    # Into a loop and out of it the path goes on by any part of a step; within it, not at all.
    edge, inside = loop ^ before, loop & before
    advance[edge], stretched[edge] = step / 2, 0.0
    variance[edge] = step**2 / 12
    advance[inside], stretched[inside], variance[inside] = 0.0, 0.0, 1e-6
    return Steps(advance, stretched, variance)


def smoothed_along(
    picks: "Picks", legs: "Legs", steps: Steps, factor_sigma: float, gps: tuple[float, float], spacing: float
) -> Along:
    """Smooth the picks along the channels.

    Parameters
    ----------
    factor_sigma : standard deviation of the length factor
    gps : time over which errors of the fixes are correlated, s, and their sigma, m
    spacing : of the channels, m
    """
    weight = np.where(picks.audible, 1.0, 0.0)
    model = Model.of(picks, legs, steps, factor_sigma, gps, spacing)
    for _ in range(ROUNDS):
        mean, covariance = model.smooth(weight)
        fitted = mean[:, 0] + picks.speed * mean[:, 2] + model.scale * mean[:, 3:].T
        off = np.abs(picks.cell - fitted) / picks.sigma
        # Student's t with 4 degrees of freedom, but for what lies within `ROBUST` sigmas.
        weight = np.where(picks.audible, np.where(off < ROBUST, 1.0, (ROBUST / np.maximum(off, ROBUST)) ** 2), 0.0)
    mean, covariance = model.smooth(weight)
    fitted = mean[:, 0] + picks.speed * mean[:, 2] + model.scale * mean[:, 3:].T
    return Along(
        cell=mean[:, 0],
        sigma=np.sqrt(np.maximum(covariance[:, 0, 0], 0)),
        stretch=mean[:, 1],
        clock=float(mean[0, 2]),
        clock_sigma=float(np.sqrt(covariance[0, 2, 2])),
        weight=weight,
        residual=picks.cell - fitted,
        error=model.scale * mean[:, 3:].T,
    )


@dataclass(frozen=True)
class Model:
    """The state space model; `scale` [leg, channel] is the sigma of the car's error, cells."""

    picks: "Picks"
    steps: Steps
    scale: Array
    keeps: Array
    factor_sigma: float
    wander: float

    @classmethod
    def of(
        cls, picks: "Picks", legs: "Legs", steps: Steps, factor_sigma: float, gps: tuple[float, float], spacing: float
    ) -> "Model":
        """The model of some picks."""
        memory, fix = max(MEMORY, gps[0]), gps[1]
        sigma = np.hypot(np.hypot(*legs.driven.sigma.T) / np.sqrt(2), SLOW * fix) / STEP
        scale = np.where(picks.row >= 0, sigma[picks.row], 0.0)  # anchors have no car
        gone = np.abs(np.diff(picks.row, axis=1, prepend=picks.row[:, :1])) / legs.rate
        return cls(picks, steps, scale, np.exp(-gone / memory), factor_sigma, WANDER * np.sqrt(spacing / 100))

    def smooth(self, weight: Array) -> tuple[Array, Array]:
        """Mean [channel, state] and covariance [channel, state, state]."""
        legs, channels = self.picks.cell.shape
        size = 3 + legs
        first = next((int(one) for one in np.flatnonzero((weight > 0).any(0))), 0)
        begun = np.nanmin(np.where(weight[:, first] > 0, self.picks.cell[:, first], np.nan)) if weight.any() else 0.0
        mean, covariance = np.zeros(size), np.zeros((size, size))
        mean[0] = begun - self.steps.advance[1 : first + 1].sum()
        covariance[np.arange(size), np.arange(size)] = [WIDE**2, self.factor_sigma**2, CLOCK**2, *np.ones(legs)]
        ahead, spread, means, covariances, moves = [], [], [], [], []
        for channel in range(channels):
            move = np.eye(size)
            if channel:
                move[0, 1] = self.steps.stretched[channel]
                move[range(3, size), range(3, size)] = self.keeps[:, channel]
                mean = move @ mean
                mean[0] += self.steps.advance[channel]
                covariance = move @ covariance @ move.T
                covariance[0, 0] += self.steps.variance[channel]
                covariance[1, 1] += self.wander**2
                covariance[range(3, size), range(3, size)] += 1 - self.keeps[:, channel] ** 2
            moves.append(move)
            ahead.append(mean)
            spread.append(covariance)
            for leg in np.flatnonzero(weight[:, channel] > 0):
                mean, covariance = self.taken(mean, covariance, int(leg), channel, float(weight[leg, channel]))
            means.append(mean)
            covariances.append(covariance)
        for channel in range(channels - 2, -1, -1):
            gain = np.linalg.solve(spread[channel + 1], moves[channel + 1] @ covariances[channel]).T
            means[channel] = means[channel] + gain @ (means[channel + 1] - ahead[channel + 1])
            covariances[channel] = (
                covariances[channel] + gain @ (covariances[channel + 1] - spread[channel + 1]) @ gain.T
            )
        return np.stack(means), np.stack(covariances)

    def taken(self, mean: Array, covariance: Array, leg: int, channel: int, weight: float) -> tuple[Array, Array]:
        """The state after a pick."""
        row = np.zeros(len(mean))
        row[0], row[2], row[3 + leg] = 1.0, self.picks.speed[leg, channel], self.scale[leg, channel]
        gain = covariance @ row
        variance = float(row @ gain + self.picks.sigma[leg, channel] ** 2 / weight)
        gain /= variance
        mean = mean + gain * (self.picks.cell[leg, channel] - row @ mean)
        covariance = covariance - np.outer(gain, gain) * variance
        return mean, (covariance + covariance.T) / 2
