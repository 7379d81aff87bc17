"""Two-stage tracking of boxes, blind to class, with the real time between frames.

Strong detections are associated first, then weak ones to the tracks left over, and only strong ones start tracks
(Zhang et al. 2022, ByteTrack). A strong one takes no track that a weak one fits far better: a box around two vehicles
often scores above the threshold when their own fall below it. All tracks are filtered at once: nothing here loops
over them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vision.boxes import overlap
from vision.camera import Calibration
from vision.likeness import Likeness
from vision.tracker_filter import (
    FIRST_GROWTH,
    FIRST_SPEED,
    Tracks,
    correct,
    measure,
    noise,
    predict,
    predicted_boxes,
    sizes,
    widened,
)

Array = NDArray[np.float64]

GATE = 16.0  # squared Mahalanobis distance of centers, 2 degrees of freedom: 3 in 10^4 true pairs are lost
AGREEING = 0.3  # overlap that makes a pair admissible whatever the gate says
# By so much a strong detection may cost more than a weak one of the same track before it loses it: half an overlap, as
# fits one labelled clip; eight simulated scenes score the same from 0.35 to 0.7.
WORSE = 0.5
GROWTH = 2.5  # largest ratio of areas in a pair
FORBIDDEN = 1e4
MISSES = (
    2  # frames missed in a row for each seen, beyond which a track is chance: a box around two vehicles, now and then
)

# On the ground, with a calibration:
NEAR = 3.0  # m, distance always allowed between two boxes of one vehicle, and
EDGES = 4.0  # sd of an edge, by the size of a pixel there
BORDER = 2.0  # px; a box that ends so near to the image's lower border may stand below it
HARDEST = 7.0  # m/s^2; full braking
FASTEST = 45.0  # m/s; assumed for a track too young to know its speed
SETTLED = 3  # fixes from which it does

# Appearance, with an embedding:
MEMORY = 3.0  # factor on how long a track is kept for a vehicle of similar appearance
ALIKE = 2.0  # logarithm of the likelihood ratio of two looks from which they may be one vehicle's after such a time
TRUST = 0.2  # of the same in the cost of a pair
MIXED = 0.1  # overlap with another box beyond which a box shows two vehicles and its appearance is not used


class Tracker:
    """Turns detections, frame by frame, into track numbers.

    Parameters
    ----------
    strong : score that starts a track and is associated first
    patience : s a track is kept without a fix; and no longer than two frames for each that it was seen in
    calibration : of the view; with it, pairs must also be within reach of each other on the road

    Notes
    -----
    Each of center x, center y, width and height is a value with a rate driven by white noise (Bar-Shalom et al. 2001,
    section 6.2.2). Pairs are chosen by the assignment of least total cost, 1 - overlap + d^2 / (2 GATE), with d the
    Mahalanobis distance of centers: overlap decides while boxes overlap, motion where a low frame rate leaves none.
    With appearance vectors (`vision.appearance`) their likelihood ratio counts too (`vision.likeness`), and a track is
    kept three times as long for a vehicle of similar appearance.

    >>> tracker = Tracker()
    >>> car = np.array([[10.0, 10, 50, 40]])
    >>> [tracker.update(t / 10, car + 8 * t * np.array([1, 0, 1, 0]), np.array([0.9])).tolist() for t in range(3)]
    [[1], [1], [1]]
    """

    def __init__(self, strong: float = 0.4, patience: float = 1.0, calibration: Calibration | None = None) -> None:
        self.strong = strong
        self.patience = patience
        self.calibration = calibration
        self.tracks = Tracks()
        self.likeness = Likeness()
        self.time = -np.inf
        self.started = 0

    def update(self, time: float, boxes: Array, scores: Array, looks: Array | None = None) -> NDArray[np.int64]:
        """Follow the tracks into one more frame.

        Parameters
        ----------
        time : of the frame, s
        boxes : [n, 4], px
        scores : [n]
        looks : [n, d], appearance vectors of the boxes, length 1 (zero: unknown); in all frames or in none

        Returns
        -------
        track of every box [n], 0 for none

        Raises
        ------
        ValueError
            If time does not increase.
        """
        if time <= self.time:
            raise ValueError(f"time must increase: {time} s after {self.time} s")
        looks = np.zeros((len(boxes), 0)) if looks is None else unmixed(looks, boxes)
        tracks = self._living(time)
        measured = measure(boxes)
        cosines = cosines_of(tracks.look, looks)
        cost, overlaps = self._costs(tracks, measured, boxes, cosines, time)
        strong = scores >= self.strong
        owner = np.full(len(boxes), -1)  # the track row of each detection
        weak = np.where((overlaps >= AGREEING) & ~strong, cost, FORBIDDEN)
        beaten = cost > weak.min(axis=1, keepdims=True, initial=FORBIDDEN) + WORSE
        associate(np.where(beaten, FORBIDDEN, cost), np.arange(len(tracks)), np.flatnonzero(strong), owner)
        free = np.ones(len(tracks), bool)
        free[owner[owner >= 0]] = False
        associate(weak, np.flatnonzero(free), np.flatnonzero(~strong), owner)
        if cosines is not None:
            pairs = np.flatnonzero((owner >= 0) & looks.any(axis=1))
            self.likeness = self.likeness.learned(cosines[np.ix_(owner[pairs], pairs)])
        tracks = correct(tracks, measured, looks, owner, time)
        new = np.flatnonzero(strong & (owner < 0))
        owner[new] = len(tracks) + np.arange(len(new))
        tracks = self._start(tracks, measured[new], looks[new], time) if len(new) else tracks
        identity = np.where(owner >= 0, tracks.identity[owner], 0) if len(tracks) else np.zeros(len(boxes), np.int64)
        self.tracks, self.time = tracks, time
        return identity

    def _limit(self, tracks: Tracks) -> Array:
        """Return how long tracks [track] are kept without a fix, s."""
        return np.where(tracks.missed > MISSES * tracks.fixes, 0.0, self.patience)

    def _living(self, time: float) -> Tracks:
        """Return the tracks that are kept, moved on to `time`."""
        limit = self._limit(self.tracks) * np.where(self.tracks.look.any(axis=1), MEMORY, 1.0)
        tracks = self.tracks.pick(time - self.tracks.seen <= limit)
        return predict(tracks, time - self.time) if len(tracks) else tracks

    def _costs(
        self, tracks: Tracks, measured: Array, boxes: Array, cosines: Array | None, time: float
    ) -> tuple[Array, Array]:
        """Cost of pairs, `FORBIDDEN` for impossible ones, and their overlap, each [track, detection]."""
        overlaps, distance = compare(tracks, measured, boxes)
        cost = 1 - overlaps + distance / (2 * GATE)
        admissible = ((distance <= GATE) | (overlaps >= AGREEING)) & similar(tracks, measured)
        if self.calibration is not None and len(tracks) and len(boxes):
            admissible &= within_reach(self.calibration, tracks, boxes, time)
        if cosines is not None:
            ratio = np.where(cosines == 0, 0.0, self.likeness.ratio(cosines))
            late = time - tracks.seen > self._limit(tracks)
            admissible &= ~late[:, None] | (ratio >= ALIKE)
            cost = cost - TRUST * ratio
        return np.where(admissible, cost, FORBIDDEN), overlaps

    def _start(self, tracks: Tracks, measured: Array, looks: Array, time: float) -> Tracks:
        count = len(measured)
        identity = self.started + 1 + np.arange(count)
        self.started += count
        size = np.sqrt(measured[:, 2] * measured[:, 3])[:, None]
        state = np.zeros((5, count, 4))
        state[0] = measured
        state[2] = noise(size)
        state[4] = (size * [FIRST_SPEED, FIRST_SPEED, FIRST_GROWTH, FIRST_GROWTH]) ** 2
        width = max(tracks.look.shape[1], looks.shape[1])
        return Tracks(
            np.concatenate([tracks.state, state], axis=1),
            np.concatenate([tracks.identity, identity]),
            np.concatenate([tracks.seen, np.full(count, time)]),
            np.concatenate([tracks.fixes, np.ones(count, np.int64)]),
            np.concatenate([tracks.missed, np.zeros(count, np.int64)]),
            np.concatenate([widened(tracks.look, width), widened(looks, width)]),
        )


def unmixed(looks: Array, boxes: Array) -> Array:
    """Appearance vectors [n, d] of boxes [n, 4]; zero (unknown) where a box overlaps another."""
    shared = overlap(boxes, boxes) * ~np.eye(len(boxes), dtype=bool)
    return np.where((shared > MIXED).any(axis=1, keepdims=True), 0.0, looks)


def cosines_of(tracks: Array, looks: Array) -> Array | None:
    """Cosines [track, detection] of appearance vectors [track, d] and [detection, d]; 0: unknown; None without any."""
    return tracks @ looks.T if tracks.shape[1] and looks.shape[1] else None


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


def within_reach(calibration: Calibration, tracks: Tracks, boxes: Array, time: float) -> NDArray[np.bool_]:
    """Whether a vehicle can have traveled that far on the road [track, detection].

    Distances are those of the lower edges' middles from where the tracks are predicted. True where one is above the
    horizon or cut off by the image's lower border.
    """
    here = calibration.to_ground(contact(predicted_boxes(tracks)))
    there = calibration.to_ground(contact(boxes))
    pixel = np.linalg.norm(np.nan_to_num(calibration.jacobian(contact(boxes))), ord=2, axis=(1, 2))
    edge = np.sqrt(noise(np.sqrt(measure(boxes)[:, 2:].prod(axis=1))))
    cut = boxes[:, 3] > calibration.image_size[1] - BORDER
    gap = time - tracks.seen
    slack = NEAR + np.where(tracks.fixes < SETTLED, FASTEST * gap, HARDEST * gap**2 / 2)
    apart = np.linalg.norm(here[:, None] - there[None], axis=2)
    return np.asarray(cut | ~(apart > slack[:, None] + EDGES * edge * pixel))


def contact(boxes: Array) -> Array:
    """Middle of the lower edge of boxes [n, 4] -> [n, 2], px."""
    return np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], axis=1)


def associate(cost: Array, rows: NDArray[np.intp], columns: NDArray[np.intp], owner: NDArray[np.intp]) -> None:
    """Assign detections `columns` to tracks `rows` at least total cost (Kuhn 1955) and enter them in `owner`."""
    part = cost[np.ix_(rows, columns)]
    track, detection = linear_sum_assignment(part)
    good = part[track, detection] < FORBIDDEN
    owner[columns[detection[good]]] = rows[track[good]]
