"""Trajectory tables -> passes: smoothed, and extrapolated beyond the view, at the sample times of the DAS."""

import logging
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.record import DASRecord
from solver.survey.limits import FASTEST, farther
from solver.trajectory.agreement import check_clocks
from solver.trajectory.kalman import Array, Fixes, Smoothed, between, beyond, first_guess, likelihood, smooth
from solver.trajectory.tracks import (
    Track,
    driven,
    during,
    moves,
    named,
    numbered,
    to_and_fro,
    too_fast,
    tracks_of,
    turns,
    why_still,
)
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, progress

if TYPE_CHECKING:
    import pandas as pd

SLOWEST = 1.0  # m/s; one that stops at the edge of the view is followed for reach / SLOWEST seconds
OPENING = 9  # fixes that the filter's first guess is made from
# How tracks go that no vehicle has driven.
FAST, MIXED = f"faster than any vehicle ({FASTEST:g} m/s)", "to and fro as no vehicle does"
BATCH = 64  # tracks smoothed at once

# Candidates of the maximum-likelihood search: standard deviation of the acceleration, m/s^2, and the correlation of
# the errors of neighboring fixes.
ACCELERATIONS = np.geomspace(1e-3, 3.0, 8)
CORRELATIONS = np.array([1e-3, 0.3, 0.5, 0.65, 0.8, 0.9])
# m/s^2; what drivers out of sight may do at least, however steady they were in view.
UNSEEN_ACCELERATION = 0.05

logger = logging.getLogger("roadfiber")


def padded(tracks: list[Track]) -> Fixes:
    """Stack tracks, each repeating its last fix up to the length of the longest."""
    longest = max(len(track.time) for track in tracks)

    def stacked(parts: list[Array]) -> Array:
        return np.array([np.concatenate([part, np.repeat(part[-1:], longest - len(part), axis=0)]) for part in parts])

    opening = slice(0, OPENING)
    guesses = [first_guess(track.time[opening], track.value[opening], track.sigma[opening]) for track in tracks]
    return Fixes(
        time=stacked([track.time for track in tracks]),
        value=stacked([track.value for track in tracks]),
        sigma=stacked([track.sigma for track in tracks]),
        valid=np.array([np.arange(longest) < len(track.time) for track in tracks]),
        prior=np.array([guess for guess, _ in guesses]),
        prior_sigma=np.array([spread for _, spread in guesses]),
    )


def likeliest(fixes: Fixes, interval: Array) -> tuple[Array, Array]:
    """Return acceleration, m/s^2, and the error's memory, s, [track, axis] of the highest likelihood.

    `interval` [track], s: between neighboring fixes, over which `CORRELATIONS` are meant.
    """
    memories = -interval[:, None] / np.log(CORRELATIONS)[:, None, None]
    accelerations = ACCELERATIONS[:, None, None, None] * np.ones(2)
    likely = likelihood(fixes, accelerations, memories)
    best = likely.reshape(-1, *likely.shape[2:]).argmax(axis=0)
    which_acceleration, which_correlation = np.unravel_index(best, likely.shape[:2])
    return ACCELERATIONS[which_acceleration], -interval[:, None] / np.log(CORRELATIONS)[which_correlation]


def within_reach(position: Array, edge: Array, reach: float) -> int:
    """Return how many of `position` [row, 2], going away from `edge` [2], come before the first beyond `reach`."""
    far = np.hypot(*(position - edge).T) > reach
    return int(far.argmax()) if far.any() else len(far)


def states_at(
    track: Track, index: int, smoothed: Smoothed, model: tuple[Array, Array], time: Array, reach: float
) -> tuple[NDArray[np.int64], Array, Array]:
    """Evaluate track number `index` at those of `time` [row] from `reach` before its view to `reach` after it.

    Returns
    -------
    rows [row], states [row, axis, 4] and covariances [row, axis, 4, 4]
    """
    acceleration, memory = model[0][index], model[1][index]
    unseen = np.maximum(acceleration, UNSEEN_ACCELERATION)
    first, last = track.time[0], track.time[-1]
    edges = [(smoothed.mean[at, index], smoothed.covariance[at, index]) for at in (0, len(track.time) - 1)]
    waits = [reach / max(float(np.hypot(*mean[:, 1])), SLOWEST) for mean, _ in edges]
    early = np.flatnonzero((time >= first - waits[0]) & (time < first))
    inside = np.flatnonzero((time >= first) & (time <= last))
    late = np.flatnonzero((time > last) & (time <= last + waits[1]))
    before = beyond(*edges[0], time[early] - first, unseen, memory)
    view = between(smoothed, index, track.time, time[inside], acceleration, memory)
    after = beyond(*edges[1], time[late] - last, unseen, memory)
    count_early = within_reach(before[0][::-1, :, 0], edges[0][0][:, 0], reach)
    count_late = within_reach(after[0][:, :, 0], edges[1][0][:, 0], reach)
    keep = slice(len(early) - count_early, len(early) + len(inside) + count_late)
    rows = np.concatenate([early, inside, late])[keep]
    mean, covariance = (np.concatenate(parts)[keep] for parts in zip(before, view, after, strict=True))
    return rows, mean, covariance


def whole_pass(
    track: Track, index: int, smoothed: Smoothed, model: tuple[Array, Array], time: Array, reach: float
) -> Pass:
    """Evaluate track number `index` at the record's `time` [row], s."""
    rows, mean, covariance = states_at(track, index, smoothed, model, time, reach)
    return Pass(
        track_id=track.track_id,
        vehicle_class=track.vehicle_class,
        rows=rows,
        position=mean[..., 0],
        velocity=mean[..., 1],
        sigma=np.sqrt(covariance[..., 0, 0]),
        in_view=(time[rows] >= track.time[0]) & (time[rows] <= track.time[-1]),
        length=track.length,
        wheelbase=track.wheelbase,
    )


def single_passes(drive: Pass) -> list[Pass]:
    """Split a drive up and down the road where it turns."""
    cuts = [0, *turns(drive.position[:, 0]), len(drive.rows)]
    return [
        replace(
            drive,
            track_id=numbered(drive.track_id, index),
            **{name: getattr(drive, name)[begin:end] for name in ("rows", "position", "velocity", "sigma", "in_view")},
        )
        for index, (begin, end) in enumerate(pairwise(cuts))
    ]


def smoothed_passes(tracks: list[Track], time: Array, reach: float) -> list[Pass]:
    """Smooth a batch of tracks and evaluate them at the record's `time` [row], s."""
    fixes = padded(tracks)
    model = likeliest(fixes, np.array([np.median(np.diff(track.time)) for track in tracks]))
    smoothed = smooth(fixes, *model)
    drives = [whole_pass(track, index, smoothed, model, time, reach) for index, track in enumerate(tracks)]
    return [one for drive in drives for one in single_passes(drive)]


def possible(tracks: list[Track], warnings: list[str]) -> list[Track]:
    """Leave out tracks that no vehicle can have driven, with a warning; InputError where most are so."""
    fault = [FAST if too_fast(track) else MIXED if to_and_fro(track) else "" for track in tracks]
    faults = [
        f"{len(wrong)} of {len(tracks)} tracks ({named([track.track_id for track in wrong])}) go {how}"
        for how in (FAST, MIXED)
        if (wrong := [track for track, one in zip(tracks, fault, strict=True) if one == how])
    ]
    rest = [track for track, one in zip(tracks, fault, strict=True) if not one]
    if 2 * len(rest) < len(tracks):
        raise InputError(
            f"trajectories: {'; '.join(faults)}; check that x and y are in m, the times, and that each vehicle has its "
            "own track_id"
        )
    warnings.extend(f"trajectories: {one}; they are left out" for one in faults)
    return rest


def smooth_passes(
    table: "pd.DataFrame", record: DASRecord, *, reach: float = 40.0, warnings: list[str] | None = None
) -> list[Pass]:
    """Smooth trajectories and evaluate them at the sample times of the DAS.

    Parameters
    ----------
    table : trajectory table, as `read_trajectories` returns it
    record : DAS; only its `time`, `start`, gaps and gauge length are looked at
    reach : how far beyond its first and last fix a vehicle is followed, m: out of view it still bends the ground; long
        gauges sense it farther, and it is followed so much farther
    warnings : lines for the user are added: tracks that one vehicle cannot have driven

    Returns
    -------
    passes sorted by time; rows lie within the record, and a pass in a gap of the record is left out

    Raises
    ------
    InputError
        If tracks and record do not overlap in time, or no vehicle moves during the record.

    Notes
    -----
    Each axis of each track is smoothed on its own with a Singer model of the motion and a first-order autoregressive
    error of the fixes (`solver.trajectory.kalman`). The vehicle's acceleration and the memory of the error are those of
    highest likelihood, so steady drives are smoothed hard; the sigmas of the table are taken as they are. An error that
    lasts through the whole view (a calibration a meter off, a box that is always too long) leaves no trace in one track
    and is not in `sigma`. Tracks of under 3 fixes or 5 m of travel are left out, and counted in the log.
    """
    warnings = [] if warnings is None else warnings
    tracks = list(tracks_of(table, record.start, warnings))
    check_clocks(tracks, record)
    present = [part for track in tracks if (part := during(track, record.time[-1]))]
    present = possible(present, warnings)
    if present and not any(moves(track) for track in present):
        raise InputError(f"trajectories: no moving vehicle during the DAS record; {why_still(present)}")
    moving = sorted((driven(track) for track in present if moves(track)), key=lambda track: len(track.time))
    if len(moving) < len(tracks):
        away, still = len(tracks) - len(present), len(present) - len(moving)
        logger.info("of %d tracks, %d are not during the record and %d do not move", len(tracks), away, still)
    passes = list[Pass]()
    with progress("smoothing tracks", len(moving)) as advance:
        for begin in range(0, len(moving), BATCH):
            batch = moving[begin : begin + BATCH]
            passes += smoothed_passes(batch, record.time, reach + farther(record.gauge_length))
            advance(len(batch))
    seen = [one for one in passes if len(one.rows) and record.measured[one.rows].any()]
    if not seen:
        raise InputError("trajectories: no moving vehicle while the DAS has samples; check both clocks")
    return sorted(seen, key=lambda one: (int(one.rows[0]), one.track_id))
