"""Tracks of vehicles that nobody listed, along kilometers: heard section by section, and joined to one track each."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.start.free_tracks import HEARD, SAME_VEHICLE, Unlisted, is_heard, unlisted
from solver.start.sections import SPARE, Found, Section
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]


def unlisted_along(
    record: DASRecord,
    sections: Sequence[Found],
    listed: Sequence[Pass],
    *,
    depth: float,
    poisson_ratio: float,
    tail: float,
    late: float | None = None,
) -> Unlisted:
    """Find vehicles that the trajectories lack along a road of several sections.

    Parameters
    ----------
    sections : with what the matched filter saw there
    record, listed, depth, poisson_ratio, tail, late : as of `solver.start.free_tracks.unlisted`
    """
    tracks, heard = list[list[Pass]](), list[Unlisted]()
    for one in sections:
        near = [part for each in listed if (part := one.section.cut(each)) is not None]
        if near:
            beliefs = {"depth": depth, "poisson_ratio": poisson_ratio}
            heard.append(unlisted(beside(record, one), one.rough, near, **beliefs, tail=tail, late=late))
            tracks.append([outward(one.section, track, record.row_time) for track in heard[-1].beside])
    first = 1 + sum(is_heard(one) for one in listed)
    found = [replace(one, track_id=f"{HEARD}{first + number}") for number, one in enumerate(joined(tracks))]
    # One vehicle may be heard in every section.
    elsewhere, lost = (max((getattr(one, name) for one in heard), default=0) for name in ("elsewhere", "lost"))
    return Unlisted(found, elsewhere, lost, float(np.median([one.late for one in heard])) if heard else 0.0)


def beside(record: DASRecord, one: Found) -> DASRecord:
    """The record on the channels around a section."""
    spare = round(SPARE / record.channel_spacing)
    first, last = np.searchsorted(record.channel, one.rough.channel[[0, -1]])
    part = slice(max(0, int(first) - spare), int(last) + spare + 1)
    rate, place, channel = record.strain_rate[:, part], record.distance[part], record.channel[part]
    return replace(record, strain_rate=rate, distance=place, channel=channel, rounding=None)


def outward(section: Section, track: Pass, time: Array) -> Pass:
    """A track along a section in the survey's frame, at times of the record [sample], s."""
    position = section.outward(track.position)
    return replace(track, position=position, velocity=np.gradient(position, time[track.rows], axis=0))


def joined(tracks: Sequence[Sequence[Pass]]) -> list[Pass]:
    """One track of each vehicle, by what was heard of it in each section, in the order of sections.

    >>> from types import SimpleNamespace
    >>> def part(first, last, speed):
    ...     rows = np.arange(first, last)
    ...     place = np.column_stack([speed * rows, 0.0 * rows])
    ...     own = {"sigma": 0 * place, "in_view": rows > 0}
    ...     return Pass("7", "unknown", rows, place, 0 * place + [speed, 0], **own)
    >>> found = joined([[part(0, 40, 2.0), part(50, 90, -3.0)], [part(30, 80, 2.1)]])
    >>> [(len(one.rows), one.position[[0, -1], 0].tolist()) for one in found]
    [(80, [0.0, 165.9]), (40, [-150.0, -267.0])]
    """
    whole = list[Pass]()
    for section in tracks:
        for one in section:
            number = next((n for n, other in enumerate(whole) if goes_on(other, one)), None)
            if number is None:
                whole.append(one)
            else:
                whole[number] = blended(whole[number], one)
    return whole


def goes_on(one: Pass, other: Pass) -> bool:
    """Whether two tracks of neighboring sections are one vehicle's."""
    _, mine, theirs = np.intersect1d(one.rows, other.rows, return_indices=True)
    if not len(mine) or (one.speed > 0) != (other.speed > 0):
        return False
    return bool(np.median(np.linalg.norm(one.position[mine] - other.position[theirs], axis=1)) < SAME_VEHICLE)


def blended(one: Pass, other: Pass) -> Pass:
    """Two tracks of one vehicle that overlap as one: over the common rows the earlier fades into the later."""
    first, last = (one, other) if one.rows[0] <= other.rows[0] else (other, one)
    rows = np.arange(first.rows[0], max(first.rows[-1], last.rows[-1]) + 1)
    share = np.clip((rows - last.rows[0]) / max(1, first.rows[-1] - last.rows[0]), 0.0, 1.0)[:, None]

    def mixed(name: str) -> Array:
        early, late = (
            np.column_stack([np.interp(rows, each.rows, column) for column in getattr(each, name).T])
            for each in (first, last)
        )
        return np.asarray((1 - share) * early + share * late)

    place, speed, sigma = (mixed(name) for name in ("position", "velocity", "sigma"))
    return replace(first, rows=rows, position=place, velocity=speed, sigma=sigma, in_view=np.ones(len(rows), bool))
