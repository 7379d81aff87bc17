"""Boxes of tracks to positions on the road, each with its sigma."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.body_fit import fit_body
from vision.camera import Calibration
from vision.interpolate import BOX
from vision.vehicles import SHAPES, VehicleShape

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

EDGE_BIAS = 1.0  # px, and
SHAPE_BIAS = 0.02  # sizes of the box (about 5 cm): sd of an edge that no repetition shows
USUAL_JITTER = 0.03  # sd of an edge, sizes of the box, of tracks too short to show theirs
MARGIN = 2.0  # px; a box nearer to the image's border than this may be cut by it
WINDOW = 1.5  # lengths of the vehicle, of travel over which its heading is taken
LONGEST_WINDOW = 2.0  # s
MOVED = 1.0  # m in that time, below which a vehicle stands
ACCELERATION = 1.5  # m/s^2; what a vehicle may have done between two fixes
WORST_SIGMA = 1.5  # m; a fix less certain than this says nothing about a fiber
WORST_MISFIT = 4.0  # sd; boxes that no vehicle of the class fills
FEWEST_FIXES = 5
TURNS = 6  # rounds, at most, of heading from positions and positions from headings
STEADY = 0.01  # rad; change of heading that ends them


def ground_tracks(tracks: "pd.DataFrame", calibration: Calibration) -> "pd.DataFrame":
    """Place tracks of boxes on the road.

    The position is the ground under the middle of the wheelbase: where a vehicle of the track's class, headed the way
    it moves, must stand for its silhouette to fill the box (`vision.body_fit`). Where the homography does not
    determine the camera, it is the ground under the middle of the box's lower edge, moved along the line of sight by
    half the vehicle's footprint.

    Parameters
    ----------
    tracks : [fix] with track_id, class, confidence, frame, time (s), interpolated, and the box (px), sorted by track
        and time
    calibration : of the view

    Returns
    -------
    table [fix] of the same columns and x, y, sigma_x, sigma_y, length, width (m). Interpolated fixes lie on the
    ground between their neighbors, with a sigma that grows with the gap. Fixes above the horizon, cut by too many
    borders or less certain than 1.5 m are left out, and so are tracks with fewer than five of the rest.
    """
    import pandas as pd

    parts = [_place(track, calibration) for _, track in tracks.groupby("track_id", sort=True)]
    kept = [part for part in parts if len(part)]
    return pd.concat(kept, ignore_index=True) if kept else _place(tracks.iloc[:0], calibration)


def placeable(boxes: Array, calibration: Calibration) -> NDArray[np.bool_]:
    """Whether boxes [n, 4], px, stand on the road near enough for one pixel to be less than `WORST_SIGMA`, [n]."""
    jacobian = calibration.jacobian(_contact(boxes))
    on_road: NDArray[np.bool_] = np.asarray(np.isfinite(jacobian).all(axis=(1, 2)))
    coarsest = np.linalg.norm(np.where(on_road[:, None, None], jacobian, 0.0), ord=2, axis=(1, 2))
    return np.asarray(on_road & (coarsest * EDGE_BIAS < WORST_SIGMA))


def _place(track: "pd.DataFrame", calibration: Calibration) -> "pd.DataFrame":
    columns = ["x", "y", "sigma_x", "sigma_y", "length", "width"]
    measured = track[~track["interpolated"].astype(bool)]
    boxes, time = measured[BOX].to_numpy(float), measured["time"].to_numpy(float)
    on_road = np.isfinite(calibration.to_ground(_contact(boxes))).all(axis=1)
    boxes, time = boxes[on_road], time[on_road]
    if len(time) < FEWEST_FIXES:
        return track.iloc[:0].assign(**dict.fromkeys(columns, np.zeros(0)))
    shape = SHAPES.get(track["class"].iloc[0], SHAPES["vehicle"])
    sigma = edge_sigma(time, boxes, calibration.image_size)
    position, deviation, size = _positions(calibration, shape, time, boxes, sigma)
    good = np.isfinite(position).all(axis=1) & (deviation.max(axis=1) < WORST_SIGMA)
    if good.sum() < FEWEST_FIXES:
        return track.iloc[:0].assign(**dict.fromkeys(columns, np.zeros(0)))
    time, position, deviation = time[good], position[good], deviation[good]
    inside = track[(track["time"] >= time[0]) & (track["time"] <= time[-1])]
    at = inside["time"].to_numpy(float)
    x, y = (np.interp(at, time, position[:, axis]) for axis in (0, 1))
    between = gap_sigma(at, time)
    sigma_x, sigma_y = (np.hypot(np.interp(at, time, deviation[:, axis]), between) for axis in (0, 1))
    placed = dict(zip(columns, [x, y, sigma_x, sigma_y, size[0], size[1]], strict=True))
    return inside.assign(**placed, interpolated=~np.isin(at, time))


def _positions(
    calibration: Calibration, shape: VehicleShape, time: Array, boxes: Array, sigma: Array
) -> tuple[Array, Array, Array]:
    """Positions [n, 2] and their sd [n, 2], m (NaN where there is no answer), and the size (3,) of the vehicle."""
    camera = calibration.pinhole()
    position, covariance = contact_positions(calibration, shape, boxes, sigma, np.zeros(len(time)))
    size, heading = np.array(shape.size), np.full(len(time), np.inf)
    whole: NDArray[np.bool_] = np.asarray(np.isfinite(sigma).all(axis=1))
    for _ in range(TURNS):
        before, heading = heading, headings(time, position, whole, WINDOW * shape.size[0])
        if np.abs(heading - before).max() < STEADY:
            break
        if camera is None:
            position, covariance = contact_positions(calibration, shape, boxes, sigma, heading)
            continue
        fit = fit_body(camera, calibration.image_size, shape, boxes, sigma, position, heading)
        position, covariance, size = fit.position, fit.covariance, fit.size
        covariance = covariance * np.maximum(fit.misfit, 1.0)[:, None, None] ** 2
        covariance[fit.misfit > WORST_MISFIT] = np.nan
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return np.where(np.isfinite(deviation), position, np.nan), deviation, size


def edge_sigma(time: Array, boxes: Array, image_size: tuple[int, int]) -> Array:
    """Sd of every edge of a track's boxes [n, 4], px; infinite for edges at the image's border.

    Detector jitter goes with the size of the box. Its share is measured on the track: the median distance of every
    edge from the straight line, in time, between its neighbors (three fixes, so variances add to about 1.5).
    """
    size = np.sqrt(np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 1.0))
    share = USUAL_JITTER
    if len(time) >= FEWEST_FIXES:
        part = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
        bend = np.abs(boxes[1:-1] - (1 - part) * boxes[:-2] - part * boxes[2:]) / size[1:-1, None]
        share = 1.4826 * float(np.median(bend)) / np.sqrt(1.5)
    edge = np.sqrt((share**2 + SHAPE_BIAS**2) * size**2 + EDGE_BIAS**2)
    sigma = np.repeat(edge[:, None], 4, axis=1)
    low, high = boxes[:, :2] < MARGIN, boxes[:, 2:] > np.array(image_size) - MARGIN
    sigma[np.concatenate([low, high], axis=1)] = np.inf
    return sigma


def contact_positions(
    calibration: Calibration, shape: VehicleShape, boxes: Array, sigma: Array, heading: Array
) -> tuple[Array, Array]:
    """Positions [n, 2], m, and covariances [n, 2, 2] from the lower edges of boxes alone.

    The line of sight on the road is where the contact point would go if it moved up in the image.
    """
    contact = _contact(boxes)
    jacobian = calibration.jacobian(contact)
    sight = np.arctan2(-jacobian[:, 1, 1], -jacobian[:, 0, 1])
    along = np.stack([np.cos(sight), np.sin(sight)], axis=1)
    position = calibration.to_ground(contact) + shape.half_extent(heading, sight)[:, None] * along
    # The middle of the edge is half as uncertain, squared, as its two ends.
    pixel = np.stack([np.hypot(sigma[:, 0], sigma[:, 2]) / 2, sigma[:, 3]], axis=1)
    spread = jacobian * np.where(np.isfinite(pixel), pixel, np.nan)[:, None]
    reach = shape.deviation[0] / 2 * np.abs(np.cos(heading - sight)) + shape.deviation[1] / 2
    covariance = spread @ spread.transpose(0, 2, 1) + (reach**2)[:, None, None] * along[:, :, None] * along[:, None]
    return position, covariance


def headings(time: Array, position: Array, whole: NDArray[np.bool_], window: float) -> Array:
    """Heading [n], rad from +x toward +y, of a track with positions [n, 2], m, those of `whole` boxes to be believed.

    The slope of a straight line through the fixes within about `window` m of travel. Where a vehicle stands, it is
    headed as it was or will be when it moves; one that never moves is taken to stand along the road (0).
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


def gap_sigma(at: Array, time: Array) -> Array:
    """Sd [n], m, of a straight line between fixes at times `time` against what a vehicle may have done, at `at`.

    With a constant acceleration a over the gap it would be off by a (t - t0)(t1 - t) / 2.
    """
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    return np.asarray(ACCELERATION * np.abs((at - time[after - 1]) * (time[after] - at)) / 2)


def _contact(boxes: Array) -> Array:
    return np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], axis=1)
