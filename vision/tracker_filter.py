"""The Kalman filter of the tracker: boxes' centers and sizes with constant speed and growth."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Lengths are in sizes of the box (square root of its area), which holds at every distance from the camera; a car's
# box is about 2.5 m.
ACCELERATION = 0.3  # spectral density of the white acceleration of position, sizes^2/s^3: about 1.4 m/s^2 over 1 s
SIZE_ACCELERATION = 0.1  # the same of width and height
FIRST_SPEED = 4.0  # sd of a new track's speed, sizes/s: about 10 m/s
FIRST_GROWTH = 1.0  # sd of a new track's change of width and height, sizes/s
JITTER = 0.05  # sd of a box edge, sizes
PIXEL = 1.0  # and px, added in quadrature
FRESH = 0.2  # weight of the newest appearance vector in a track's


@dataclass(frozen=True)
class Tracks:
    """Living tracks.

    Parameters
    ----------
    state : [5, track, 4]; value, rate, and the covariance (value-value, value-rate, rate-rate) of each of center x,
        center y, width and height, which are independent of each other; px and s
    identity : [track], never used twice
    seen : [track], s, time of the last fix
    fixes : [track], how many there were
    missed : [track], frames since the last one
    look : [track, d], appearance vector, length 1; d = 0 without an embedding
    """

    state: Array = field(default_factory=lambda: np.zeros((5, 0, 4)))
    identity: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    seen: Array = field(default_factory=lambda: np.zeros(0))
    fixes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    missed: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    look: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.identity)

    def pick(self, rows: NDArray[np.bool_]) -> "Tracks":
        """Return the tracks of some rows."""
        counts = (self.fixes[rows], self.missed[rows])
        return Tracks(self.state[:, rows], self.identity[rows], self.seen[rows], *counts, self.look[rows])


def widened(looks: Array, width: int) -> Array:
    """Looks [n, d], or zeros [n, width] where there are none."""
    return looks if looks.shape[1] == width else np.zeros((len(looks), width))


def measure(boxes: Array) -> Array:
    """Boxes [n, 4] -> center x, center y, width, height [n, 4], px."""
    low, high = boxes[:, :2], boxes[:, 2:]
    return np.concatenate([(low + high) / 2, np.maximum(high - low, 1.0)], axis=1)


def noise(size: Array) -> Array:
    """Variance of a box's center or side for boxes of some size, px^2."""
    return np.asarray((JITTER * size) ** 2 + PIXEL**2)


def predicted_boxes(tracks: Tracks) -> Array:
    """Boxes [track, 4] where the tracks are now."""
    center, side = tracks.state[0, :, :2], np.maximum(tracks.state[0, :, 2:], 1.0)
    return np.concatenate([center - side / 2, center + side / 2], axis=1)


def sizes(tracks: Tracks) -> Array:
    """Square root of the area of every track's box [track, 1], px."""
    return np.sqrt(np.maximum(tracks.state[0, :, 2:], 1.0).prod(axis=1, keepdims=True))


def predict(tracks: Tracks, dt: float) -> Tracks:
    """Move all tracks on by dt, s."""
    value, rate, vv, vr, rr = tracks.state
    q = sizes(tracks) ** 2 * [ACCELERATION, ACCELERATION, SIZE_ACCELERATION, SIZE_ACCELERATION]
    state = np.stack(
        [
            value + dt * rate,
            rate,
            vv + dt * (2 * vr + dt * rr) + q * dt**3 / 3,
            vr + dt * rr + q * dt**2 / 2,
            rr + q * dt,
        ]
    )
    return replace(tracks, state=state)


def correct(tracks: Tracks, measured: Array, looks: Array, owner: NDArray[np.intp], time: float) -> Tracks:
    """Update every track with its detection (Kalman 1960, on each coordinate) and its appearance vector."""
    detection = np.flatnonzero(owner >= 0)
    row = owner[detection]
    value, rate, vv, vr, rr = tracks.state[:, row]
    total = vv + noise(sizes(tracks)[row])
    gain, rate_gain = vv / total, vr / total
    innovation = measured[detection] - value
    state, seen, fixes, missed = tracks.state.copy(), tracks.seen.copy(), tracks.fixes.copy(), tracks.missed + 1
    state[:, row] = [
        value + gain * innovation,
        rate + rate_gain * innovation,
        vv - gain * vv,
        vr - gain * vr,
        rr - rate_gain * vr,
    ]
    seen[row] = time
    fixes[row] += 1
    missed[row] = 0
    look = blended(tracks.look, looks[detection], row) if looks.shape[1] else tracks.look
    return replace(tracks, state=state, seen=seen, fixes=fixes, missed=missed, look=look)


def blended(look: Array, newest: Array, row: NDArray[np.intp]) -> Array:
    """Appearance vectors of tracks [track, d], those of `row` [n] blended with the newest [n, d]; zero is unknown."""
    look = widened(look, newest.shape[1]).copy()
    share = np.where(look[row].any(axis=1), FRESH, 1.0)[:, None] * newest.any(axis=1, keepdims=True)
    mixed = (1 - share) * look[row] + share * newest
    look[row] = mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12)
    return look
