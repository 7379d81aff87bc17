"""Tracks of vehicles that nobody listed: what the fiber heard of each tells when it was where along the road.

A vehicle's ridge in the matched filter's map of place and time is followed from the middle of the channels outward. Its
lane is that of the listed vehicles that drive the same way. Such a track is rough: the fit may shift all of it, and
counts on no sample that this vehicle rules.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.start.detections import THRESHOLD_DB
from solver.start.heard import Heard, Hearing, middle_times, pair
from solver.start.initialization import Initialization
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]

#: Name of such a vehicle, before its number; and how many are named.
HEARD, NAMED = "heard#", 6
#: Class of a vehicle that no camera saw: its wheels may be any.
NOBODY_KNOWS = "unknown"
#: m; how far beyond the channels such a vehicle is followed; the sd of its place, and of a shift of its whole track.
REACH, GUESSED, OFFSET = 40.0, 0.3, 1.5
#: m; sd of that shift where no listed vehicle drives the same way: the lane is not known.
NO_LANE = 3.0
#: m; what is heard so near to a listed vehicle that goes the same way is that vehicle, if it is over this share of the
#: way: one that only catches up with it is another.
SAME_VEHICLE, TOGETHER = 15.0, 0.5
#: A ridge is followed to so many m from the middle at a time, within so many s of where it is expected; and beyond
#: that by polynomials of these degrees.
STEPS = ((20.0, 1.2, 1), (40.0, 0.8, 1), (np.inf, 0.8, 2), (np.inf, 0.4, 2))
#: Channels that must tell of a ridge, at least.
FEWEST = 10


def ridge(hearing: Hearing, one: Heard) -> Array | None:
    """Coefficients of time, s, as a polynomial of x less the middle, m, the highest first; None where it is too faint.

    >>> x, frames = np.linspace(0, 100, 60), np.arange(400)[:, None]
    >>> passing = 30 - 2 * np.abs(frames / 10 - 20 - (x - 50) / 12.0 - 2e-4 * (x - 50) ** 2)
    >>> hearing = Hearing({1: passing, -1: 0 * passing}, x, 10.0)
    >>> ridge(hearing, Heard(20.1, 10.5, 20.0, 1.0)).round(3).tolist()
    [0.0, 0.083, 20.0]
    """
    way = 1 if one.speed > 0 else -1
    snr, ahead = hearing.snr_db[way], hearing.x - hearing.middle
    line = np.array([1 / one.speed, one.time])
    for far, window, degree in STEPS:
        columns = np.flatnonzero(np.abs(ahead) <= far)
        late, loud = peaks(snr[:, columns], np.polyval(line, ahead[columns]) * hearing.rate, window * hearing.rate)
        if loud.sum() < FEWEST:
            return None
        line = robust_line(ahead[columns][loud], late[loud] / hearing.rate, degree)
    slope = np.polyval(np.polyder(line), ahead) * way
    return line if (slope > 0).all() else None


def peaks(snr_db: Array, expected: Array, window: float) -> tuple[Array, NDArray[np.bool_]]:
    """Frame of the loudest moment of every channel near an expected one, [channel], and whether it is loud enough.

    Parameters
    ----------
    snr_db : [frame, channel]
    expected : [channel], frames
    window : frames before and after
    """
    reach = int(np.ceil(window))
    steps = np.arange(-reach, reach + 1)[:, None]
    at = np.rint(expected).astype(int) + steps
    inside = (at >= 1) & (at < len(snr_db) - 1)
    columns = np.arange(snr_db.shape[1])
    values = np.where(inside, snr_db[np.clip(at, 0, len(snr_db) - 1), columns], -np.inf)
    best = values.argmax(0)
    frame = at[best, columns]
    loud = (values[best, columns] > THRESHOLD_DB) & (best > 0) & (best < 2 * reach)
    frame = np.clip(frame, 1, len(snr_db) - 2)
    before, here, after = (snr_db[frame + step, columns] for step in (-1, 0, 1))
    curve = before - 2 * here + after
    # Of a parabola through three frames.
    shift = np.where(curve < 0, 0.5 * (before - after) / np.where(curve < 0, curve, 1.0), 0.0)
    return frame + np.clip(shift, -0.5, 0.5), loud


def robust_line(x: Array, value: Array, degree: int) -> Array:
    """Polynomial through most of the values, the highest coefficient first."""
    keep = np.ones(len(x), bool)
    for _ in range(4):
        line = np.polyfit(x[keep], value[keep], degree)
        off = np.abs(value - np.polyval(line, x))
        keep = off <= 2.5 * max(1.4826 * float(np.median(off)), 1e-3)
    return line


def free_track(line: Array, hearing: Hearing, number: int, listed: Sequence[Pass], time: Array) -> Pass | None:
    """A vehicle along its ridge at the record's times; None where it is there for less than two samples.

    Parameters
    ----------
    line : as `ridge` returns it
    number : that it is named by
    listed : vehicles of the trajectories
    time : of the record [sample], s
    """
    ahead = hearing.x - hearing.middle
    inner = np.linspace(ahead.min(), ahead.max(), 200)
    when, slope = np.polyval(line, inner), np.polyval(np.polyder(line), inner[[0, -1]])
    # Beyond the channels it goes on as it went.
    place = np.concatenate([[inner[0] - REACH], inner, [inner[-1] + REACH]])
    when = np.concatenate([[when[0] - REACH * slope[0]], when, [when[-1] + REACH * slope[1]]])
    order = np.argsort(when)
    place, when = place[order], when[order]
    rows = np.flatnonzero((time >= when[0]) & (time <= when[-1]))
    if len(rows) < 2:
        return None
    x = np.interp(time[rows], when, place) + hearing.middle
    y, sigma = lane(x, 1 if slope[0] > 0 else -1, float(time[rows].mean()), listed, time)
    position = np.column_stack([x, y])
    return Pass(
        track_id=f"{HEARD}{number}",
        vehicle_class=NOBODY_KNOWS,
        rows=rows,
        position=position,
        velocity=np.gradient(position, time[rows], axis=0),
        sigma=np.full((len(rows), 2), GUESSED),
        in_view=np.ones(len(rows), bool),
        offset=sigma,
    )


def lane(x: Array, way: int, when: float, listed: Sequence[Pass], time: Array) -> tuple[Array, float]:
    """Return y [row] of the lane at x, m, and how far it may be off: as of the nearest listed vehicle that way."""
    alike = [one for one in listed if (one.speed > 0) == (way > 0)]
    nearest = min(alike or listed, key=lambda one: abs(float(time[one.rows].mean()) - when))
    order = np.argsort(nearest.position[:, 0])
    y = np.interp(x, nearest.position[order, 0], nearest.position[order, 1])
    return y, OFFSET if alike else NO_LANE


def is_listed(found: Pass, listed: Sequence[Pass], late: float) -> bool:
    """Whether a vehicle of the trajectories goes along with one that was heard.

    Parameters
    ----------
    late : by how much the record's clock is ahead of the tracks', as a share of a row
    """
    for one in listed:
        if (one.speed > 0) != (found.speed > 0):
            continue
        x = np.interp(found.rows, one.rows + late, one.position[:, 0], left=np.nan, right=np.nan)
        both = np.isfinite(x)
        if both.any() and (np.abs(found.position[both, 0] - x[both]) < SAME_VEHICLE).mean() > TOGETHER:
            return True
    return False


@dataclass(frozen=True)
class Unlisted:
    """Vehicles that the trajectories lack.

    Parameters
    ----------
    beside : those that strain the fiber while a listed one does, with free tracks
    elsewhere : how many were heard at other times
    lost : how many were heard beside listed ones, and could not be followed
    late : by how many rows the record's clock is ahead of the tracks'
    """

    beside: list[Pass]
    elsewhere: int
    lost: int
    late: float = 0.0


def is_heard(one: Pass) -> bool:
    """Whether a pass is of a vehicle that was heard only."""
    return one.track_id.startswith(HEARD)


def unlisted_line(found: Unlisted, time: Array) -> str:
    """Say what was heard of vehicles that the trajectories lack; nothing where that is none.

    Parameters
    ----------
    time : of the record [sample], s

    >>> unlisted_line(Unlisted([], 2, 1), np.arange(9.0))
    'the fiber heard vehicles that the trajectories lack: 1 too faint to be followed, which stays in the residual; \
2 at other times'
    """
    said = []
    if found.beside:
        when = ", ".join(f"{one.track_id} at {time[one.rows].mean():.0f} s" for one in found.beside[:NAMED])
        more = ", ..." if len(found.beside) > NAMED else ""
        said.append(f"{len(found.beside)} fitted beside the others, their tracks free ({when}{more})")
    if found.lost:
        said.append(f"{found.lost} too faint to be followed, which stay{'s' * (found.lost == 1)} in the residual")
    if found.elsewhere:
        said.append(f"{found.elsewhere} at other times")
    return f"the fiber heard vehicles that the trajectories lack: {'; '.join(said)}" if said else ""


def unlisted(
    record: DASRecord,
    rough: Initialization,
    listed: Sequence[Pass],
    *,
    depth: float,
    poisson_ratio: float,
    tail: float,
    late: float | None = None,
) -> Unlisted:
    """Find vehicles that the trajectories lack in the samples that a fit uses.

    Parameters
    ----------
    record : strain rate
    rough : route
    listed : vehicles that are known: of the trajectories, or heard before
    depth, poisson_ratio : prior means, m and 1
    tail : before and after each listed vehicle, s, that the fit looks at
    late : by how many rows the record's clock is ahead of the tracks', where `record` is what the listed vehicles leave
        of one; they are heard in it, and tell the clocks, where None
    """
    hearing, time = Hearing.of(record, rough, depth=depth, poisson_ratio=poisson_ratio), record.row_time
    heard = hearing.vehicles()
    strange = heard
    if late is None:
        middle = middle_times(listed, hearing.middle, time)
        paired = pair(heard, middle, np.array([one.speed for one in listed]))
        late = 0.0 if np.isnan(paired.offset) else paired.offset * record.sampling_rate
        strange = [one for one, seen in zip(heard, paired.seen, strict=True) if seen < 0]
    inside = used(listed, len(time), round(tail * record.sampling_rate))
    beside, elsewhere, lost = list[Pass](), 0, 0
    first = 1 + sum(is_heard(one) for one in listed)
    for one in strange:
        line = ridge(hearing, one)
        found = None if line is None else free_track(line, hearing, first + len(beside), listed, time)
        if found is not None and is_listed(found, listed, late):
            continue
        at = found.rows if found is not None else [min(int(one.time * record.sampling_rate), len(time) - 1)]
        if not inside[at].any():
            elsewhere += 1
        elif found is None:
            lost += 1
        else:
            beside.append(found)
    return Unlisted(beside, elsewhere, lost, late)


def used(passes: Sequence[Pass], rows: int, margin: int) -> NDArray[np.bool_]:
    """Whether a fit of some passes looks at each of so many rows: up to `margin` of them before and after a pass."""
    steps = np.zeros(rows + 1)
    for one in passes:
        steps[max(0, one.rows[0] - margin)] += 1
        steps[min(rows, one.rows[-1] + margin + 1)] -= 1
    return steps.cumsum() > 0
