"""Headings of vehicles, from positions that scatter."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGEST_WINDOW = 2.0  # s
MOVED = 1.0  # m in that time, below which a vehicle stands


def turned(change: Array) -> float:
    """Root mean square of changes of heading [n], rad, full turns aside.

    >>> round(turned(np.array([0.02, 2 * np.pi - 0.02])), 3)
    0.02
    """
    return float(np.sqrt(np.mean((np.mod(change + np.pi, 2 * np.pi) - np.pi) ** 2)))


def headings(time: Array, position: Array, whole: NDArray[np.bool_], window: float) -> Array:
    """Heading [n], rad from +x toward +y, of a track with positions [n, 2], m, those of `whole` boxes to be believed.

    The slope of a straight line through the fixes within about `window` m of travel. A standing vehicle keeps its
    heading from before or after; one that never moves is assumed to stand along the road (0).
    """
    every, (time, position) = time, (time[whole], position[whole]) if whole.sum() > 1 else (time, position)
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    speed = np.median(steps / np.diff(time)) if len(time) > 1 else 0.0
    half = np.clip(window / 2 / max(float(speed), 1e-3), 0.2, LONGEST_WINDOW / 2)
    velocity = _slopes(time, position, half)
    moving = np.linalg.norm(velocity, axis=1) * 2 * half > MOVED
    if not moving.any():
        return np.zeros(len(every))
    angle = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
    return np.interp(every, time[moving], angle)


def _slopes(time: Array, position: Array, half: float) -> Array:
    """Least-squares slope [n, 2], m/s, over the fixes within `half` s of each."""
    time = time - time.mean()
    position = position - np.nanmean(position, axis=0)
    first, last = np.searchsorted(time, time - half), np.searchsorted(time, time + half, side="right")

    def window_sum(values: Array) -> Array:
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        return np.asarray(total[last] - total[first])

    t = time[:, None]
    count = (last - first)[:, None]
    spread = window_sum(t * t) - window_sum(t) ** 2 / count
    covariance = window_sum(t * position) - window_sum(t) * window_sum(position) / count
    return np.where(spread > 1e-9, covariance / np.maximum(spread, 1e-9), 0.0)
