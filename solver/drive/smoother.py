"""Recursions of the smoother along the channels, in machine code (Rauch, Tung and Striebel 1965, AIAA J. 3, 1445)."""

import numpy as np
from numpy.typing import NDArray

from solver.ground.compiled import compiled

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: First of the errors in a state, behind a cell, the stretch, the clock and its drift.
ERRORS = 4


@compiled
def moved(mean: Array, covariance: Array, advance: float, stretched: float, bent: float, keeps: Array) -> None:
    """A state and its covariance at the next channel, but for what is added on the way, in place."""
    size = len(mean)
    beside = size - 1
    mean[0] += advance + stretched * mean[1] + bent * mean[beside]
    for error in range(size - ERRORS):
        mean[ERRORS + error] *= keeps[error]
    for other in range(size):
        covariance[0, other] += stretched * covariance[1, other] + bent * covariance[beside, other]
    for other in range(size):
        covariance[other, 0] += stretched * covariance[other, 1] + bent * covariance[other, beside]
    for error in range(size - ERRORS):
        for other in range(size):
            covariance[ERRORS + error, other] *= keeps[error]
        for other in range(size):
            covariance[other, ERRORS + error] *= keeps[error]


@compiled
def smooth(
    advance: Array,
    stretched: Array,
    bent: Array,
    variance: Array,
    wander: float,
    keeps: Array,
    scale: Array,
    leg: Numbers,
    picked: Numbers,
    pick_leg: Numbers,
    value: Array,
    noise: Array,
    speed: Array,
    lever: Array,
    mean: Array,
    covariance: Array,
) -> tuple[Array, Array]:
    """Means [channel, state] and covariances [channel, state, state] of all channels.

    The state is a cell, the stretch, the clock, its drift, and the errors of unit variance; the last of those is of the
    map, which no pick has. From channel to channel the cell goes on by `advance`, `stretched` times the stretch and
    `bent` times the error of the map, an error keeps the share `keeps` [error, channel]. A pick [pick] of a channel,
    sorted by channel, is the cell, plus `speed` times the clock and `lever` times its drift, plus `scale` [error,
    channel] times each of the errors that `leg` [error] says are of its leg. `mean` [state] and `covariance` [state,
    state] are those before the first channel, and are overwritten.
    """
    channels, size = len(advance), len(mean)
    ahead, means = np.zeros((channels, size)), np.zeros((channels, size))
    spread, covariances = np.zeros((channels, size, size)), np.zeros((channels, size, size))
    row, gain = np.zeros(size), np.zeros(size)
    pick = 0
    for channel in range(channels):
        if channel:
            moved(mean, covariance, advance[channel], stretched[channel], bent[channel], keeps[:, channel])
            covariance[0, 0] += variance[channel]
            covariance[1, 1] += wander
            for error in range(size - ERRORS):
                covariance[ERRORS + error, ERRORS + error] += 1 - keeps[error, channel] ** 2
        ahead[channel], spread[channel] = mean, covariance
        while pick < len(picked) and picked[pick] == channel:
            row[0], row[2], row[3] = 1.0, speed[pick], lever[pick]
            for error in range(size - ERRORS):
                row[ERRORS + error] = scale[error, channel] if leg[error] == pick_leg[pick] else 0.0
            gain[:] = covariance @ row
            total = row @ gain + noise[pick]
            mean += gain * ((value[pick] - row @ mean) / total)
            for one in range(size):
                for other in range(size):
                    covariance[one, other] -= gain[one] * gain[other] / total
            pick += 1
        means[channel], covariances[channel] = mean, covariance
    for channel in range(channels - 2, -1, -1):
        after = channel + 1
        move = np.eye(size)
        move[0, 1], move[0, size - 1] = stretched[after], bent[after]
        for error in range(size - ERRORS):
            move[ERRORS + error, ERRORS + error] = keeps[error, after]
        back = np.linalg.solve(spread[after], move @ covariances[channel])
        means[channel] += back.T @ (means[after] - ahead[after])
        covariances[channel] += back.T @ (covariances[after] - spread[after]) @ back
    return means, covariances
