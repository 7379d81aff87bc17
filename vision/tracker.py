"""Two-stage tracking of boxes, blind to class, with the real time between frames.

Strong detections are associated first, then weak ones to the tracks left over, and only strong ones start tracks
(Zhang et al. 2022, ByteTrack). All tracks are filtered at once: nothing here loops over them.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vision.boxes import overlap

Array = NDArray[np.float64]

# Lengths are in sizes of the box (square root of its area), which holds at every distance from the camera; a car's
# box is about 2.5 m.
ACCELERATION = 1.0  # spectral density of the white acceleration of position, sizes^2/s^3: about 2.5 m/s^2 over 1 s
SIZE_ACCELERATION = 0.1  # the same of width and height
FIRST_SPEED = 4.0  # sd of a new track's speed, sizes/s: about 10 m/s
FIRST_GROWTH = 1.0  # sd of a new track's change of width and height, sizes/s
JITTER = 0.05  # sd of a box edge, sizes
PIXEL = 1.0  # and px, added in quadrature
GATE = 16.0  # squared Mahalanobis distance of centers, 2 degrees of freedom: 3 in 10^4 true pairs are lost
AGREEING = 0.3  # overlap that makes a pair admissible whatever the gate says
GROWTH = 3.0  # largest ratio of areas in a pair
FORBIDDEN = 1e4


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
    """

    state: Array = field(default_factory=lambda: np.zeros((5, 0, 4)))
    identity: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    seen: Array = field(default_factory=lambda: np.zeros(0))
    fixes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.identity)

    def pick(self, rows: NDArray[np.bool_]) -> "Tracks":
        """Return the tracks of some rows."""
        return Tracks(self.state[:, rows], self.identity[rows], self.seen[rows], self.fixes[rows])


class Tracker:
    """Turns detections, frame by frame, into track numbers.

    Parameters
    ----------
    strong : score that starts a track and is associated first
    patience : s a track is kept without a fix; a third of it until it has three fixes

    Notes
    -----
    Each of center x, center y, width and height is a value with a rate driven by white noise (Bar-Shalom et al. 2001,
    section 6.2.2). Pairs are chosen by the assignment of least total cost, 1 - overlap + d^2 / (2 GATE), with d the
    Mahalanobis distance of centers: overlap decides while boxes overlap, motion where a low frame rate leaves none.

    >>> tracker = Tracker()
    >>> car = np.array([[10.0, 10, 50, 40]])
    >>> [tracker.update(t / 10, car + 8 * t * np.array([1, 0, 1, 0]), np.array([0.9])).tolist() for t in range(3)]
    [[1], [1], [1]]
    """

    def __init__(self, strong: float = 0.4, patience: float = 1.0) -> None:
        self.strong = strong
        self.patience = patience
        self.tracks = Tracks()
        self.time = -np.inf
        self.started = 0

    def update(self, time: float, boxes: Array, scores: Array) -> NDArray[np.int64]:
        """Take the boxes [n, 4] and scores [n] of the frame at `time`, s; return their tracks [n], 0 for none.

        Raises ValueError where time does not increase.
        """
        if time <= self.time:
            raise ValueError(f"time must increase: {time} s after {self.time} s")
        limit = np.where(self.tracks.fixes < 3, self.patience / 3, self.patience)
        tracks = self.tracks.pick(time - self.tracks.seen <= limit)
        if len(tracks):
            tracks = predict(tracks, time - self.time)
        measured = measure(boxes)
        strong = scores >= self.strong
        owner = np.full(len(boxes), -1)  # the track row of each detection
        overlaps, distance = compare(tracks, measured, boxes)
        cost = 1 - overlaps + distance / (2 * GATE)
        admissible = ((distance <= GATE) | (overlaps >= AGREEING)) & similar(tracks, measured)
        associate(np.where(admissible, cost, FORBIDDEN), np.arange(len(tracks)), np.flatnonzero(strong), owner)
        left = np.flatnonzero(~np.isin(np.arange(len(tracks)), owner))
        associate(np.where(overlaps >= AGREEING, cost, FORBIDDEN), left, np.flatnonzero(~strong), owner)
        tracks = correct(tracks, measured, owner, time)
        new = np.flatnonzero(strong & (owner < 0))
        owner[new] = len(tracks) + np.arange(len(new))
        tracks = self._start(tracks, measured[new], time)
        identity = np.where(owner >= 0, tracks.identity[owner], 0) if len(tracks) else np.zeros(len(boxes), np.int64)
        self.tracks, self.time = tracks, time
        return identity

    def _start(self, tracks: Tracks, measured: Array, time: float) -> Tracks:
        count = len(measured)
        identity = self.started + 1 + np.arange(count)
        self.started += count
        size = np.sqrt(measured[:, 2] * measured[:, 3])[:, None]
        state = np.zeros((5, count, 4))
        state[0] = measured
        state[2] = noise(size)
        state[4] = (size * [FIRST_SPEED, FIRST_SPEED, FIRST_GROWTH, FIRST_GROWTH]) ** 2
        return Tracks(
            np.concatenate([tracks.state, state], axis=1),
            np.concatenate([tracks.identity, identity]),
            np.concatenate([tracks.seen, np.full(count, time)]),
            np.concatenate([tracks.fixes, np.ones(count, np.int64)]),
        )


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
    return Tracks(state, tracks.identity, tracks.seen, tracks.fixes)


def compare(tracks: Tracks, measured: Array, boxes: Array) -> tuple[Array, Array]:
    """Overlap and squared Mahalanobis distance of centers, each [track, detection]."""
    variance = tracks.state[2, :, :2] + noise(sizes(tracks))
    offset = tracks.state[0, :, None, :2] - measured[None, :, :2]
    distance = (offset**2 / variance[:, None]).sum(axis=2)
    return overlap(predicted_boxes(tracks), boxes), distance


def similar(tracks: Tracks, measured: Array) -> NDArray[np.bool_]:
    """Whether areas are near enough for one vehicle [track, detection]."""
    ratio = (measured[:, 2] * measured[:, 3]) / sizes(tracks) ** 2
    return np.asarray((ratio < GROWTH) & (ratio > 1 / GROWTH))


def associate(cost: Array, rows: NDArray[np.intp], columns: NDArray[np.intp], owner: NDArray[np.intp]) -> None:
    """Assign detections `columns` to tracks `rows` at least total cost (Kuhn 1955) and enter them in `owner`."""
    part = cost[np.ix_(rows, columns)]
    track, detection = linear_sum_assignment(part)
    good = part[track, detection] < FORBIDDEN
    owner[columns[detection[good]]] = rows[track[good]]


def correct(tracks: Tracks, measured: Array, owner: NDArray[np.intp], time: float) -> Tracks:
    """Give every track its detection (Kalman 1960, on each coordinate by itself)."""
    detection = np.flatnonzero(owner >= 0)
    row = owner[detection]
    value, rate, vv, vr, rr = tracks.state[:, row]
    total = vv + noise(sizes(tracks)[row])
    gain, rate_gain = vv / total, vr / total
    innovation = measured[detection] - value
    state, seen, fixes = tracks.state.copy(), tracks.seen.copy(), tracks.fixes.copy()
    state[:, row] = [
        value + gain * innovation,
        rate + rate_gain * innovation,
        vv - gain * vv,
        vr - gain * vr,
        rr - rate_gain * vr,
    ]
    seen[row] = time
    fixes[row] += 1
    return Tracks(state, tracks.identity, seen, fixes)
