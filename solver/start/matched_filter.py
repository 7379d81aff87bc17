"""The paper's matched-filter chain for one pass, a function per step.

SNR maps -> channel and scale of every frame -> directional consistency -> first principal component -> RANSAC ->
channel range. `solver.start.initialization.initialize` goes on from the same maps with all passes together.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.start.alignment import FEWEST, FOLLOWING
from solver.start.detections import FRAME_RATE, THRESHOLD_DB, decibel, mended, scale_maps, thinned
from solver.start.fiber_line import FiberLine, ransac_line
from solver.start.wavelets import SCALES, Array
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError

SLACK = 1.0  # channels that a detection may lie behind the one before it
OFF = 4.0  # robust standard deviations off the first principal component
LEAST_OFF = 5.0  # m off it that a detection may always be


@dataclass(frozen=True)
class Loudest:
    """Where each frame is loudest.

    Parameters
    ----------
    channel : column of the record [frame]
    scale : of the wavelet, in channels [frame]
    snr_db : dB [frame]
    """

    channel: NDArray[np.int64]
    scale: Array
    snr_db: Array


def loudest(maps: Iterable[Array], scales: Array, sign: int = 1) -> Loudest:
    """Channel and scale of the largest SNR in every frame: argmax over s, c of sign * SNR_s(t, c).

    Parameters
    ----------
    maps : SNR map [frame, channel] of each scale, see `scale_maps`
    scales : of the maps, in channels
    sign : -1 for wavelets upside down

    >>> maps = [np.array([[1.0, 5.0, 0.0]]), np.array([[0.0, 8.0, -9.0]])]
    >>> found = loudest(maps, np.array([2.0, 3.0]))
    >>> found.channel.tolist(), found.scale.tolist(), loudest(maps, np.array([2.0, 3.0]), -1).channel.tolist()
    ([1], [3.0], [2])
    """
    peaks = [((sign * one).argmax(1), (sign * one).max(1)) for one in maps]
    channel, snr = (np.stack(values) for values in zip(*peaks, strict=True))
    best, frame = snr.argmax(0), np.arange(snr.shape[1])
    return Loudest(channel[best, frame], np.asarray(scales)[best], decibel(snr[best, frame]))


def directionally_consistent(channel: NDArray, slack: float = SLACK) -> NDArray[np.bool_]:
    """Which detections a vehicle that never turns back can leave: the longest steadily moving subsequence.

    The largest set of frames i < j < ... with d (c_j - c_i) >= -slack between neighbors, for d = 1 or -1, whichever is
    larger (longest increasing subsequence, Schensted 1961).

    Parameters
    ----------
    channel : of the detections, in order of time [detection]
    slack : channels that jitter may set a detection back

    Returns
    -------
    [detection]

    >>> directionally_consistent(np.array([3, 5, 90, 8, 8, 2, 11])).tolist()
    [True, True, False, True, True, False, True]
    """
    sets = [longest_rise(direction * channel, slack) for direction in (1, -1)]
    return max(sets, key=lambda chosen: int(chosen.sum()))


def longest_rise(values: NDArray, slack: float) -> NDArray[np.bool_]:
    """Which of `values` [n] are in the longest subsequence that never falls by more than `slack` from one to the next.

    >>> longest_rise(np.array([1.0, 9.0, 2.0, 3.0]), 0.0).tolist()
    [True, False, True, True]
    """
    count = len(values)
    length, before = np.ones(count, int), np.full(count, -1)
    for now in range(1, count):
        reached = np.where(values[:now] <= values[now] + slack, length[:now], 0)
        if reached.max():
            before[now] = reached.argmax()
            length[now] = reached.max() + 1
    chosen = np.zeros(count, bool)
    last = int(length.argmax()) if count else -1
    while last >= 0:
        chosen[last] = True
        last = int(before[last])
    return chosen


@dataclass(frozen=True)
class PrincipalComponent:
    """Direction in which points spread most (Pearson 1901).

    Parameters
    ----------
    center : [axis], m
    direction : unit vector [axis], its first entry positive
    share : of the variance that lies along it
    """

    center: Array
    direction: Array
    share: float

    def off(self, points: Array) -> Array:
        """Distance [point] of points [point, axis] from the line, m."""
        away = points - self.center
        return np.linalg.norm(away - (away @ self.direction)[:, None] * self.direction, axis=1)


def first_principal_component(points: Array) -> PrincipalComponent:
    """First eigenvector of the covariance of points [point, axis]: C = sum (p - mean)(p - mean)^T, C v = lambda v.

    Of places of the vehicle against places along the fiber, both in m, its slope is which way and how fast the fiber
    runs along the road.

    Raises
    ------
    InputError
        If there are fewer than two points.

    >>> x = np.arange(10.0)
    >>> component = first_principal_component(np.column_stack([x, 5 - x]))
    >>> component.direction.round(3).tolist(), round(component.share, 3)
    ([0.707, -0.707], 1.0)
    """
    if len(points) < 2:
        raise InputError("matched filter: fewer than two detections have no direction; give a louder pass")
    center = points.mean(0)
    _, size, axes = np.linalg.svd(points - center, full_matrices=False)
    direction = axes[0] * (1 if axes[0, 0] >= 0 else -1)
    return PrincipalComponent(center, direction, float(size[0] ** 2 / max((size**2).sum(), np.finfo(float).tiny)))


def channel_range(channel: NDArray, inliers: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last channel that saw the vehicle: min and max over the inliers of RANSAC.

    >>> channel_range(np.array([40, 41, 43, 90]), np.array([True, True, True, False]))
    (40, 43)
    """
    seen = channel[inliers]
    return int(np.floor(seen.min())), int(np.ceil(seen.max()))


@dataclass(frozen=True)
class Trace:
    """One pass through the chain; every array is over the frames above 7 dB [detection].

    Parameters
    ----------
    row : of the record
    x : of the vehicle, m
    channel : number
    scale : in channels
    snr_db : dB
    consistent : after directional consistency
    component : first principal component of (x, distance along the fiber) of the consistent ones, m
    inliers : of RANSAC, among what is consistent and near the component
    line : x = x0 + slope channel, by number
    channels : first and last number of the channels that saw the vehicle
    """

    row: NDArray[np.int64]
    x: Array
    channel: NDArray[np.int64]
    scale: Array
    snr_db: Array
    consistent: NDArray[np.bool_]
    component: PrincipalComponent
    inliers: NDArray[np.bool_]
    line: FiberLine
    channels: tuple[int, int]


def trace(record: DASRecord, one: Pass, *, scales: Array = SCALES, threshold_db: float = THRESHOLD_DB) -> Trace:
    """Run the whole chain on one pass, for wavelets of either sign: the one louder along the line (sum of dB) is right.

    Parameters
    ----------
    record : strain rate
    one : the pass, at the record's rows
    scales : of the bank, in channels
    threshold_db : SNR that a detection must have, dB

    Raises
    ------
    InputError
        If too few frames are above the threshold, or no line goes through them.
    """
    stride = max(1, int(record.sampling_rate / FRAME_RATE))
    frames, (thin,) = thinned(record.strain_rate, [one], stride)
    thin = replace(
        thin, **{f: getattr(thin, f)[thin.in_view] for f in ("rows", "position", "velocity", "sigma", "in_view")}
    )
    data = mended(frames[thin.rows])
    found = [loudest(scale_maps(data, scales), scales, sign) for sign in (1, -1)]
    traces = [follow(record, thin, each, threshold_db) for each in found] if len(data) else []
    if not any(traces):
        raise InputError(
            f"pass {one.track_id}: nothing above {threshold_db:g} dB in the DAS moves as it does; leave it out, "
            "or check that the clocks agree"
        )
    best = max((each for each in traces if each), key=lambda each: each.snr_db[each.inliers].sum())
    return replace(best, row=best.row * stride + stride // 2)


def follow(record: DASRecord, one: Pass, found: Loudest, threshold_db: float) -> Trace | None:
    """From the loudest channels of a pass's frames to its line and channel range; None where there is no line."""
    loud = found.snr_db > threshold_db
    if loud.sum() < FEWEST:
        return None
    channel, x, speed = found.channel[loud], one.position[loud, 0], one.velocity[loud, 0]
    points = np.column_stack([x, record.channel_spacing * channel])
    consistent = directionally_consistent(channel)
    component = first_principal_component(points[consistent])
    off = component.off(points)
    keep = consistent & (off <= max(LEAST_OFF, OFF * 1.4826 * float(np.median(off[consistent]))))
    line, kept = ransac_line(x[keep], speed[keep], channel[keep].astype(np.float64), record.channel_spacing)
    if line is None or kept.sum() < FEWEST + FOLLOWING * len(channel):
        return None
    inliers = np.zeros(len(channel), bool)
    inliers[np.flatnonzero(keep)[kept]] = True
    number = record.channel[channel]
    return Trace(
        row=one.rows[loud],
        x=x,
        channel=number,
        scale=found.scale[loud],
        snr_db=found.snr_db[loud],
        consistent=consistent,
        component=component,
        inliers=inliers,
        line=replace(line, x0=line.x0 - line.slope * float(record.channel[0])),
        channels=channel_range(number, inliers),
    )
