"""Smoothed motion of vehicles on the ground: a constant-acceleration Kalman filter and its smoother.

Along x and y each: position, velocity and acceleration, the last driven by white jerk (Bar-Shalom et al. 2001, section
6.2.3); fixes come with their own covariance, which couples the two (Kalman 1960; Rauch, Tung & Striebel 1965). All
tracks are smoothed at once, padded to the longest of a batch.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

JERK = 1.0  # spectral density of the white jerk, m^2/s^5: the acceleration changes by about 1 m/s^2 in 1 s
FIRST_SPEED = 30.0  # sd of the speed at the first fix, m/s, before any is seen
FIRST_ACCELERATION = 1.5  # and of the acceleration, m/s^2
GATE = 16.0  # squared Mahalanobis distance beyond which the influence of a fix is bounded (Huber 1964)
BATCH = 64  # tracks at once
PLACE = np.array([0, 3])  # where x and y are in the state (x, vx, ax, y, vy, ay)


@dataclass(frozen=True)
class Motion:
    """Positions of one vehicle over time.

    Parameters
    ----------
    time : [n], s, increasing
    position : [n, 2], m; NaN where there was no fix
    covariance : [n, 2, 2], m^2; of fixes: their independent errors
    """

    time: Array
    position: Array
    covariance: Array


@dataclass(frozen=True)
class Smoothed:
    """The motion of one vehicle.

    Parameters
    ----------
    time : [n], s, increasing
    position, velocity : [n, 2], m and m/s
    covariance : [n, 2, 2], m^2, of the position
    """

    time: Array
    position: Array
    velocity: Array
    covariance: Array


def smooth(tracks: Sequence[Motion]) -> list[Smoothed]:
    """Smooth tracks; each has its first and last place known.

    >>> time = np.arange(50) / 25
    >>> true = np.stack([10 * time, 0 * time], 1)
    >>> seen = true + np.random.default_rng(0).normal(0, 0.2, (50, 2))
    >>> (found,) = smooth([Motion(time, seen, np.tile(0.04 * np.eye(2), (50, 1, 1)))])
    >>> bool(np.abs(found.position - true).mean() < 0.5 * np.abs(seen - true).mean())
    True
    """
    order = sorted(range(len(tracks)), key=lambda row: len(tracks[row].time))
    result: dict[int, Smoothed] = {}
    for first in range(0, len(order), BATCH):
        rows = order[first : first + BATCH]
        result |= dict(zip(rows, _smooth_batch([tracks[row] for row in rows]), strict=True))
    return [result[row] for row in range(len(tracks))]


def _smooth_batch(tracks: Sequence[Motion]) -> list[Smoothed]:
    longest = max(len(track.time) for track in tracks)
    time = np.array([_padded(track.time, longest) for track in tracks])
    fix = np.array([_padded(track.position, longest) for track in tracks])
    noise = np.array([_padded(track.covariance, longest) for track in tracks])
    lengths = np.array([len(track.time) for track in tracks])
    seen = np.isfinite(fix).all(axis=2) & (np.arange(longest) < lengths[:, None])
    steps = np.diff(time, axis=1)
    mean, covariance = _first(fix[:, 0], noise[:, 0])
    means, covariances, ahead = [mean], [covariance], [(mean, covariance)]
    for k in range(1, longest):
        mean, covariance = predict(mean, covariance, steps[:, k - 1])
        ahead.append((mean, covariance))
        mean, covariance = update(mean, covariance, fix[:, k], noise[:, k], seen[:, k])
        means.append(mean)
        covariances.append(covariance)
    for k in range(longest - 2, -1, -1):
        move = transition(steps[:, k])
        # Steps of the padding are zero: the state after is the state before, and the gain is one.
        gain = np.swapaxes(np.linalg.solve(ahead[k + 1][1], move @ covariances[k]), 1, 2)
        gain = np.where((steps[:, k] > 0)[:, None, None], gain, np.eye(6))
        means[k] = means[k] + np.einsum("tij,tj->ti", gain, means[k + 1] - ahead[k + 1][0])
        covariances[k] = covariances[k] + gain @ (covariances[k + 1] - ahead[k + 1][1]) @ np.swapaxes(gain, 1, 2)
    position, velocity = (np.stack(means, axis=1)[..., PLACE + order] for order in (0, 1))
    spread = np.stack(covariances, axis=1)[..., PLACE[:, None], PLACE]
    return [
        Smoothed(track.time, position[row, :count], velocity[row, :count], spread[row, :count])
        for row, (track, count) in enumerate(zip(tracks, lengths, strict=True))
    ]


def _padded(values: Array, length: int) -> Array:
    return np.concatenate([values, np.repeat(values[-1:], length - len(values), axis=0)])


def _first(fix: Array, noise: Array) -> tuple[Array, Array]:
    """State [track, 6] and covariance [track, 6, 6] after the first fix."""
    mean, covariance = np.zeros((len(fix), 6)), np.zeros((len(fix), 6, 6))
    mean[:, PLACE] = fix
    covariance[:, PLACE[:, None], PLACE] = noise
    covariance[:, PLACE + 1, PLACE + 1] = FIRST_SPEED**2
    covariance[:, PLACE + 2, PLACE + 2] = FIRST_ACCELERATION**2
    return mean, covariance


def transition(step: Array) -> Array:
    """Transition [track, 6, 6] over `step` [track], s."""
    move = np.tile(np.eye(6), (len(step), 1, 1))
    for axis in PLACE:
        move[:, axis, axis + 1] = move[:, axis + 1, axis + 2] = step
        move[:, axis, axis + 2] = step**2 / 2
    return move


def predict(mean: Array, covariance: Array, step: Array) -> tuple[Array, Array]:
    """Move states [track, 6] and covariances [track, 6, 6] on by `step` [track], s."""
    move = transition(step)
    powers = {(0, 0): 20, (0, 1): 8, (0, 2): 6, (1, 1): 3, (1, 2): 2, (2, 2): 1}
    driven = np.zeros_like(move)
    for (row, column), divisor in powers.items():
        entry = JERK * step ** (5 - row - column) / divisor
        for axis in PLACE:
            driven[:, axis + row, axis + column] = driven[:, axis + column, axis + row] = entry
    return np.einsum("tij,tj->ti", move, mean), move @ covariance @ np.swapaxes(move, 1, 2) + driven


def update(mean: Array, covariance: Array, fix: Array, noise: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Correct states by fixes [track, 2] with covariances [track, 2, 2], where they were `seen` [track].

    A fix beyond `GATE` has its covariance inflated until it is at `GATE`, which bounds its influence.
    """
    offset = np.where(seen[:, None], fix - mean[:, PLACE], 0.0)
    spread = covariance[:, PLACE[:, None], PLACE] + noise
    distance = np.einsum("ti,tij,tj->t", offset, np.linalg.inv(spread), offset)
    spread = spread * np.maximum(distance / GATE, 1.0)[:, None, None]
    gain = np.swapaxes(np.linalg.solve(spread, covariance[:, PLACE]), 1, 2)
    gain = np.where(seen[:, None, None], gain, 0.0)
    corrected = covariance - gain @ covariance[:, PLACE]
    return mean + np.einsum("tij,tj->ti", gain, offset), (corrected + np.swapaxes(corrected, 1, 2)) / 2
