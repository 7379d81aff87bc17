"""Boxes of tracks to positions on the road, each with its sigma."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.body_fit import BodyFit, fit_body
from vision.camera import Calibration
from vision.dropped import BORDER, FAR, GHOST, HIDDEN, HORIZON, SHAPE, SHORT, SIGMA
from vision.edges import EDGE_BIAS, edge_sigma, hidden_edges, sizes
from vision.footprints import ghosts
from vision.headings import headings, turned
from vision.interpolate import BOX
from vision.smoother import Motion, Smoothed, smooth
from vision.vehicles import VehicleShape, shapes_of

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

HIDDEN_BIAS = 0.15  # sizes of the box: sd of an edge that a nearer vehicle hides, which a detector must guess
MOST_HIDDEN = 2  # fewest usable edges of a box that locate a vehicle
WINDOW = 1.5  # travel, in lengths of the vehicle, over which its heading is estimated
LEAST_NOISE = 0.01  # m; no fix is better
MEDIAN = 1.386  # of a chi-square with two degrees of freedom
WORST_SIGMA = 1.5  # m; a fix less certain than this is useless to locate a fiber
WORST_MISFIT = 4.0  # sd; a box that no vehicle of the class fills, and all boxes of a track of which most are so
FEWEST_FIXES = 5  # of a track
MOST = 0.5  # chance of the shapes that a fix must have an answer for
TURNS = 6  # rounds, at most, of heading from positions and positions from headings
STEADY = 0.01  # rad; root mean square change of heading that ends them
SIZE = ("length", "sigma_length", "width", "wheelbase", "sigma_wheelbase")
COLUMNS = ("x", "y", "sigma_x", "sigma_y", "speed", *SIZE, "x_measured", "y_measured")


def ground_tracks(tracks: "pd.DataFrame", calibration: Calibration) -> tuple["pd.DataFrame", "pd.DataFrame"]:
    """Place tracks of boxes on the road.

    The position is the ground under the middle of the wheelbase: where a vehicle of the track's class, headed the way
    it moves, must stand for its silhouette to fill the box (`vision.body_fit`). Where the detector wavers between
    classes, each counts by its share of the fixes and by how well its vehicles fill the boxes. Where the homography
    does not determine the camera, it is the ground under the middle of the box's lower edge, moved along the line of
    sight by half the vehicle's footprint.

    Parameters
    ----------
    tracks : [fix] with track_id, class, confidence, frame, time (s), interpolated, and the box (px), sorted by track
        and time
    calibration : of the view

    Returns
    -------
    table [fix] of the same columns, speed (m/s, of the smoothed motion) and, in m, x, y, sigma_x, sigma_y, length,
    sigma_length, width, wheelbase, sigma_wheelbase (both NaN where the vehicle's length was not seen well enough to say
    more than its class), x_measured, y_measured: x, y are smoothed (`vision.smoother`), also across missed frames; the
    measured ones are what each box alone says, on a straight line where there is none.

    And a table [fix] of the detected fixes that are not placed, with the columns of `tracks` and `cause`
    (`vision.dropped`): above the horizon, hidden, cut by the border, of no vehicle's shape or less certain than 1.5 m,
    in tracks with fewer than five of the rest, and in tracks inside another vehicle (`vision.footprints`). Those
    between two placed ones are in the first table, too, as interpolated ones.

    Notes
    -----
    The sigma has three parts. Scatter, by which a track's fixes leave a straight line between their neighbors, is
    smoothed. What every fix of a track shares (the size of the vehicle, edges that are always drawn alike; what the
    body fit states beyond the scatter) is not, and nor is the error of the calibration
    (`Calibration.position_covariance`). An edge at the image's border does not count, and one behind a nearer vehicle
    counts little; a box with three such edges says nothing.

    Measured on rendered vehicles of other outlines and sizes than those assumed, with edges that err by 1.5 % of the
    box from frame to frame, by 4 % for all of a vehicle and by 4 % all edges together, as detectors' do
    (`benchmarks/ground.py`, 24 vehicles of each class and view): the bias is below 0.33 m, the standard deviation 0.2
    to 1.3 m along and 0.06 to 0.53 m across the road, and errors are 0.8 to 1.5 stated sigmas. The middle of the box's
    lower edge is off by 0.7 to 4.4 m along the road. Edges of real detectors err less alike in all boxes of a vehicle:
    with three on six rendered views (721 tracks, the same vehicles seen from the front and from behind; `--model` does
    the like), errors are 0.9 stated sigmas. Buses lie 0.4 m ahead seen from the front and 0.15 m behind seen from
    behind, at a sigma of 1.0 m.
    """
    boxes, time = tracks[BOX].to_numpy(float), tracks["time"].to_numpy(float)
    hidden = hidden_edges(tracks["frame"].to_numpy(), boxes)
    seen = ~tracks["interpolated"].to_numpy(bool)
    cause = np.full(len(tracks), "", object)
    # A box inside a nearer one is usually a second box of that vehicle, not a vehicle behind it.
    cause[seen & (hidden.sum(axis=1) > MOST_HIDDEN)] = HIDDEN
    cause[seen & ~np.isfinite(calibration.to_ground(_contact(boxes))).all(axis=1)] = HORIZON
    names = tracks["class"].to_numpy()
    detected = tracks["detected_class"].to_numpy() if "detected_class" in tracks else names
    placed = list[Placed]()
    for indices in tracks.groupby("track_id", sort=True).indices.values():
        rows = np.asarray(indices)
        shapes, good = shapes_of(names[rows[0]], detected[rows]), rows[seen[rows] & (cause[rows] == "")]
        part, cause[good] = _place(shapes, rows, time[rows], good, time[good], boxes[good], hidden[good], calibration)
        placed += [part] if part else []
    if not placed:
        return tracks.iloc[:0].assign(**dict.fromkeys(COLUMNS, np.zeros(0))), with_causes(tracks, cause)
    table = _tabulate(tracks, placed, smooth([part.motion for part in placed]), calibration)
    ghost = set(ghosts(table))
    cause[seen & (cause == "") & tracks["track_id"].astype(str).isin(ghost).to_numpy()] = GHOST
    return table[~table["track_id"].astype(str).isin(ghost)].reset_index(drop=True), with_causes(tracks, cause)


def with_causes(tracks: "pd.DataFrame", cause: NDArray[np.object_]) -> "pd.DataFrame":
    """Rows of `tracks` that have a cause [row], with it."""
    return tracks.assign(cause=cause)[cause != ""].reset_index(drop=True)


@dataclass(frozen=True)
class Placed:
    """A track on the road, before it is smoothed.

    Parameters
    ----------
    rows : [row], places in the table, from the first to the last fix that could be placed
    motion : what the fixes say, with their independent errors
    shared : [row, 2, 2], covariance of what all fixes have in common, m^2
    size : what `SIZE` names, of the vehicle, m
    """

    rows: NDArray[np.intp]
    motion: Motion
    shared: Array
    size: tuple[float, ...]


def unplaceable(boxes: Array, calibration: Calibration) -> NDArray[np.object_]:
    """Why boxes [n, 4], px, cannot be placed on the road, [n]; "" where they can.

    They are above the horizon, or so far off that one pixel is more than `WORST_SIGMA`.
    """
    jacobian = calibration.jacobian(_contact(boxes))
    on_road: NDArray[np.bool_] = np.asarray(np.isfinite(jacobian).all(axis=(1, 2)))
    coarsest = np.linalg.norm(np.where(on_road[:, None, None], jacobian, 0.0), ord=2, axis=(1, 2))
    cause = np.where(coarsest * EDGE_BIAS < WORST_SIGMA, "", FAR).astype(object)
    cause[~on_road] = HORIZON
    return cause


def _place(
    shapes: list[tuple[VehicleShape, float]],
    rows: NDArray[np.intp],
    every: Array,
    good: NDArray[np.intp],
    time: Array,
    boxes: Array,
    hidden: NDArray[np.bool_],
    calibration: Calibration,
) -> tuple[Placed | None, NDArray[np.object_]]:
    """Place a track of `rows` at times `every`; its usable rows `good` are at `time`, with boxes and hidden edges.

    And say of every usable row why it is not placed; "" where it is.
    """
    cause = np.full(len(good), SHORT, object)
    if len(time) < FEWEST_FIXES:
        return None, cause
    sigma = edge_sigma(time, boxes, calibration.image_size)
    sigma = np.where(hidden, np.hypot(sigma, HIDDEN_BIAS * sizes(boxes)[:, None]), sigma)
    position, covariance, size = _weighed(calibration, shapes, time, boxes, sigma)
    with np.errstate(invalid="ignore"):
        deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    sure = np.isfinite(position).all(axis=1) & (deviation.max(axis=1) < WORST_SIGMA)
    cut = np.isinf(sigma).any(axis=1)
    misfit = ~np.isfinite(position).all(axis=1) & (calibration.pinhole() is not None)
    cause[~sure] = np.where(misfit, SHAPE, np.where(cut, BORDER, SIGMA))[~sure]
    if sure.sum() < FEWEST_FIXES:
        return None, cause
    cause[sure] = ""
    good, time, position, covariance = good[sure], time[sure], position[sure], covariance[sure]
    within = slice(int(np.searchsorted(rows, good[0])), int(np.searchsorted(rows, good[-1])) + 1)
    rows, at = rows[within], every[within]
    share = scatter_share(time, position, covariance)
    motion = Motion(at, np.full((len(at), 2), np.nan), np.tile(np.eye(2), (len(at), 1, 1)))
    fixes = np.searchsorted(rows, good)
    motion.position[fixes] = position
    motion.covariance[fixes] = share * covariance + LEAST_NOISE**2 * np.eye(2)
    shared = max(1 - share, 0.0) * np.stack(
        [[np.interp(at, time, covariance[:, a, b]) for b in (0, 1)] for a in (0, 1)]
    ).transpose(2, 0, 1)
    return Placed(rows, motion, shared, size), cause


def _tabulate(
    tracks: "pd.DataFrame", placed: list[Placed], smoothed: list[Smoothed], calibration: Calibration
) -> "pd.DataFrame":
    """The rows of the tracks that could be placed, with `COLUMNS`."""
    position = np.concatenate([motion.position for motion in smoothed])
    covariance = np.concatenate([motion.covariance for motion in smoothed])
    covariance += np.concatenate([part.shared for part in placed])
    covariance += np.nan_to_num(calibration.position_covariance(calibration.to_image(position)))
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    size = np.repeat([part.size for part in placed], [len(part.rows) for part in placed], axis=0)
    fixes = [np.asarray(np.isfinite(part.motion.position).all(axis=1)) for part in placed]
    measured = [
        [np.interp(part.motion.time, part.motion.time[seen], part.motion.position[seen, axis]) for axis in (0, 1)]
        for part, seen in zip(placed, fixes, strict=True)
    ]
    speed = np.linalg.norm(np.concatenate([motion.velocity for motion in smoothed]), axis=1)
    values = [*position.T, *sigma.T, speed, *size.T, *np.concatenate(measured, axis=1)]
    table = tracks.iloc[np.concatenate([part.rows for part in placed])].reset_index(drop=True)
    columns = dict(zip(COLUMNS, values, strict=True))
    return table.assign(**columns, interpolated=~np.concatenate(fixes))


def scatter_share(time: Array, position: Array, covariance: Array) -> float:
    """Share of the covariances [n, 2, 2] that the scatter of positions [n, 2] shows to be independent from fix to fix.

    Of the distance of every fix from the straight line, in time, between its neighbors: three fixes, so covariances add
    to about 1.5. The median, against that of a chi-square, so that a wrong fix does not count.
    """
    if len(time) < FEWEST_FIXES:
        return 1.0
    part = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    bend = position[1:-1] - (1 - part) * position[:-2] - part * position[2:]
    distance = np.einsum("ni,nij,nj->n", bend, np.linalg.inv(1.5 * covariance[1:-1]), bend)
    return float(np.median(distance) / MEDIAN)


def _weighed(
    calibration: Calibration, shapes: list[tuple[VehicleShape, float]], time: Array, boxes: Array, sigma: Array
) -> tuple[Array, Array, tuple[float, ...]]:
    """Positions [n, 2], m, covariances [n, 2, 2] (NaN: no answer) and what `SIZE` names, over all `shapes`.

    A shape counts by its share of what was seen and by how probable it makes the boxes.
    """
    fits = [_fit(calibration, shape, time, boxes, sigma) for shape, _ in shapes]
    chance = np.array([fit.evidence for fit in fits]) + np.log([share for _, share in shapes])
    chance = np.exp(chance - chance.max())
    chance /= chance.sum()
    positions = np.array([fit.position for fit in fits])
    counts = chance[:, None] * np.isfinite(positions).all(axis=2)
    counts /= np.where(counts.sum(axis=0) > MOST, counts.sum(axis=0), np.nan)
    position = (counts[..., None] * np.nan_to_num(positions)).sum(axis=0)
    apart = np.nan_to_num(positions - position)
    spread = np.nan_to_num([fit.covariance for fit in fits]) + apart[..., None] * apart[..., None, :]
    length, width = (chance @ [fit.size for fit in fits])[:2].tolist()
    variance = chance @ [fit.size_covariance[0, 0] + (fit.size[0] - length) ** 2 for fit in fits]
    likeliest, sigma_length = shapes[int(chance.argmax())][0], float(np.sqrt(variance))
    size = (length, sigma_length, width, *likeliest.wheelbase_of(length, sigma_length))
    return position, (counts[..., None, None] * spread).sum(axis=0), size


def _fit(calibration: Calibration, shape: VehicleShape, time: Array, boxes: Array, sigma: Array) -> BodyFit:
    """Fit a vehicle of one shape, headed the way it moves; positions are NaN where there is no answer."""
    camera = calibration.pinhole()
    position, covariance = contact_positions(calibration, shape, boxes, sigma, np.zeros(len(time)))
    fit = BodyFit(position, covariance, np.array(shape.size), np.diag(shape.deviation) ** 2, np.zeros(len(time)), 0.0)
    heading = np.full(len(time), np.inf)
    whole: NDArray[np.bool_] = np.asarray(np.isfinite(sigma).all(axis=1))
    for _ in range(TURNS):
        before, heading = heading, headings(time, fit.position, whole, WINDOW * shape.size[0])
        if not np.isinf(before).any() and turned(heading - before) < STEADY:
            break
        if camera is None:
            position, covariance = contact_positions(calibration, shape, boxes, sigma, heading)
            fit = replace(fit, position=position, covariance=covariance)
            continue
        fit = fit_body(camera, calibration.image_size, shape, boxes, sigma, fit.position, heading, fit.size)
    misfit = np.maximum(fit.misfit, np.median(fit.misfit))
    covariance = fit.covariance * np.maximum(fit.misfit, 1.0)[:, None, None] ** 2
    known = (misfit <= WORST_MISFIT) & np.isfinite(covariance).all(axis=(1, 2))
    return replace(fit, position=np.where(known[:, None], fit.position, np.nan), covariance=covariance)


def contact_positions(
    calibration: Calibration, shape: VehicleShape, boxes: Array, sigma: Array, heading: Array
) -> tuple[Array, Array]:
    """Positions [n, 2], m, and covariances [n, 2, 2] from the lower edges of boxes alone.

    The line of sight on the road is the direction in which the contact point would go if it moved up in the image.
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


def _contact(boxes: Array) -> Array:
    return np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], axis=1)
