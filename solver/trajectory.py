"""Trajectory tables -> passes: smoothed, and extrapolated beyond the view, at the sample times of the DAS."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.das import DASRecord
from solver.kalman import Array, Fixes, Smoothed, between, beyond, run_filter, smooth
from vision.contract import InputError

if TYPE_CHECKING:
    import pandas as pd

MINIMUM_FIXES = 3
MINIMUM_TRAVEL = 5.0  # m; less is a parked vehicle
SLOWEST = 1.0  # m/s; one that stops at the edge of the view is followed for reach / SLOWEST seconds
BATCH = 64  # tracks smoothed at once

# Candidates of the maximum-likelihood search: standard deviation of the acceleration, m/s^2, and the correlation of
# the errors of neighboring fixes.
ACCELERATIONS = np.geomspace(1e-3, 3.0, 8)
CORRELATIONS = np.array([1e-3, 0.3, 0.5, 0.65, 0.8, 0.9])

logger = logging.getLogger("roadfiber")


@dataclass(frozen=True)
class Pass:
    """One vehicle going by once.

    Parameters
    ----------
    track_id, vehicle_class : as in the trajectory table
    rows : indices into the record's `time`, consecutive [row]
    position : x, y of the point under the middle of the wheelbase, m [row, 2]
    velocity : m/s [row, 2]
    sigma : standard deviation of `position`, m [row, 2]
    in_view : between the first and the last fix, not extrapolated [row]
    length : of the vehicle, m, where the table says it
    """

    track_id: str
    vehicle_class: str
    rows: NDArray[np.int64]
    position: Array
    velocity: Array
    sigma: Array
    in_view: NDArray[np.bool_]
    length: float | None = None

    @property
    def speed(self) -> float:
        """Median speed in view, m/s; negative for a vehicle going against +x."""
        within = self.velocity[self.in_view] if self.in_view.any() else self.velocity
        return float(np.median(np.hypot(*within.T)) * np.sign(np.median(within[:, 0])))


@dataclass(frozen=True)
class Track:
    """The fixes of one vehicle: time, s since the record's start [fix]; value and sigma, m [fix, axis]."""

    track_id: str
    vehicle_class: str
    time: Array
    value: Array
    sigma: Array
    length: float | None


def tracks_of(table: "pd.DataFrame", start: np.datetime64) -> Iterator[Track]:
    """Yield the tracks of a table."""
    import pandas as pd

    for track_id, fixes in table.sort_values("time").groupby("track_id", sort=False):
        elapsed = fixes["time"] - pd.Timestamp(start, tz="UTC")
        lengths = fixes["length"].dropna() if "length" in fixes else fixes["x"].iloc[:0]
        yield Track(
            str(track_id),
            str(fixes["class"].mode().iloc[0]),
            elapsed.to_numpy().astype("timedelta64[ns]").astype(np.int64) * 1e-9,
            fixes[["x", "y"]].to_numpy(float),
            fixes[["sigma_x", "sigma_y"]].to_numpy(float),
            float(lengths.median()) if len(lengths) else None,
        )


def moves(track: Track) -> bool:
    """Tell whether a track has enough fixes and travel to be a pass."""
    if len(track.time) < MINIMUM_FIXES:
        return False
    return bool(np.hypot(*np.ptp(track.value, axis=0)) >= MINIMUM_TRAVEL)


def padded(tracks: list[Track]) -> Fixes:
    """Stack tracks of different lengths."""
    longest = max(len(track.time) for track in tracks)
    valid = np.array([np.arange(longest) < len(track.time) for track in tracks])

    def stacked(parts: list[Array]) -> Array:
        return np.array([np.concatenate([part, np.repeat(part[-1:], longest - len(part), axis=0)]) for part in parts])

    return Fixes(
        stacked([track.time for track in tracks]),
        stacked([track.value for track in tracks]),
        stacked([track.sigma for track in tracks]),
        valid,
    )


def likeliest(fixes: Fixes, interval: Array) -> tuple[Array, Array]:
    """Return the acceleration and the error's memory [track, axis] of the highest likelihood among the candidates."""
    memories = -interval[:, None] / np.log(CORRELATIONS)[:, None, None]
    accelerations = ACCELERATIONS[:, None, None, None] * np.ones(2)
    likelihood, _ = run_filter(fixes, accelerations, memories)
    flat = likelihood.reshape(-1, *likelihood.shape[2:]).argmax(axis=0)
    which_acceleration, which_correlation = np.unravel_index(flat, likelihood.shape[:2])
    return ACCELERATIONS[which_acceleration], -interval[:, None] / np.log(CORRELATIONS)[which_correlation]


def within_reach(position: Array, edge: Array, reach: float) -> int:
    """Return how many of `position` [row, 2], going away from `edge` [2], come before the first beyond `reach`."""
    far = np.hypot(*(position - edge).T) > reach
    return int(far.argmax()) if far.any() else len(far)


def states_at(
    track: Track, index: int, smoothed: Smoothed, model: tuple[Array, Array], record: DASRecord, reach: float
) -> tuple[NDArray[np.int64], Array, Array]:
    """Return rows [row], states [row, axis, 4] and covariances [row, axis, 4, 4] from view to `reach` beyond it."""
    acceleration, memory = model[0][index], model[1][index]
    first, last = track.time[0], track.time[-1]
    edges = [(smoothed.mean[at, index], smoothed.covariance[at, index]) for at in (0, len(track.time) - 1)]
    waits = [reach / max(float(np.hypot(*mean[:, 1])), SLOWEST) for mean, _ in edges]
    time = record.time
    early = np.flatnonzero((time >= first - waits[0]) & (time < first))
    inside = np.flatnonzero((time >= first) & (time <= last))
    late = np.flatnonzero((time > last) & (time <= last + waits[1]))
    before = beyond(*edges[0], time[early] - first, acceleration, memory)
    view = between(smoothed, index, track.time, time[inside], acceleration, memory)
    after = beyond(*edges[1], time[late] - last, acceleration, memory)
    count_early = within_reach(before[0][::-1, :, 0], edges[0][0][:, 0], reach)
    count_late = within_reach(after[0][:, :, 0], edges[1][0][:, 0], reach)
    keep = slice(len(early) - count_early, len(early) + len(inside) + count_late)
    rows = np.concatenate([early, inside, late])[keep]
    mean, covariance = (np.concatenate(parts)[keep] for parts in zip(before, view, after, strict=True))
    return rows, mean, covariance


def pass_of(
    track: Track, index: int, smoothed: Smoothed, model: tuple[Array, Array], record: DASRecord, reach: float
) -> Pass | None:
    """Evaluate one smoothed track at the record's times; None where the record measured nothing of it."""
    rows, mean, covariance = states_at(track, index, smoothed, model, record, reach)
    if not record.measured[rows].any():
        return None
    time = record.time[rows]
    return Pass(
        track_id=track.track_id,
        vehicle_class=track.vehicle_class,
        rows=rows,
        position=mean[..., 0],
        velocity=mean[..., 1],
        sigma=np.sqrt(covariance[..., 0, 0]),
        in_view=(time >= track.time[0]) & (time <= track.time[-1]),
        length=track.length,
    )


def check_overlap(tracks: list[Track], record: DASRecord) -> None:
    """Raise InputError where no track has a fix during the record."""
    if any(track.time[0] <= record.time[-1] and track.time[-1] >= 0 for track in tracks):
        return

    def span(first: float, last: float) -> str:
        ends = record.start + np.round(np.array([first, last]) * 1e9).astype("timedelta64[ns]")
        return " to ".join(f"{np.datetime_as_string(end, unit='s')}Z" for end in ends)

    first, last = min(track.time[0] for track in tracks), max(track.time[-1] for track in tracks)
    raise InputError(
        f"trajectories ({span(first, last)}) and DAS ({span(0.0, record.time[-1])}) do not overlap in time; "
        "check the clocks, or give files of one survey"
    )


def smooth_passes(table: "pd.DataFrame", record: DASRecord, *, reach: float = 40.0) -> list[Pass]:
    """Smooth trajectories and evaluate them at the record's sample times."""
    tracks = list(tracks_of(table, record.start))
    check_overlap(tracks, record)
    moving = sorted(filter(moves, tracks), key=lambda track: len(track.time))
    if len(moving) < len(tracks):
        logger.info(
            "%d of %d tracks left out: under %d fixes or %g m of travel",
            len(tracks) - len(moving),
            len(tracks),
            MINIMUM_FIXES,
            MINIMUM_TRAVEL,
        )
    passes = []
    for begin in range(0, len(moving), BATCH):
        batch = moving[begin : begin + BATCH]
        fixes = padded(batch)
        model = likeliest(fixes, np.array([np.median(np.diff(track.time)) for track in batch]))
        smoothed = smooth(fixes, *model)
        found = [pass_of(track, index, smoothed, model, record, reach) for index, track in enumerate(batch)]
        passes += [one for one in found if one is not None]
    if not passes:
        raise InputError("no moving vehicle during the DAS record; check the trajectories and the clocks")
    return sorted(passes, key=lambda one: int(one.rows[0]))
