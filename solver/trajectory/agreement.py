"""Whether the files of a survey can be of one place and one time: anchors, tracks, record, clocks."""

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.survey.anchors import ANCHOR_REACH, Anchor, within_reach
from solver.survey.das.record import DASRecord
from solver.survey.limits import VEHICLE_REACH
from vision.contract import InputError

if TYPE_CHECKING:
    from solver.trajectory.tracks import Track
    from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]

#: Share by which channel spacings may be off, and sigmas by which anchors may be.
SPACING_OFF, SURE = 0.05, 5.0
#: An anchor this far along the road from where vehicles are recorded on its channel, m, is wrong: rough routes are
#: within half of it. One that is nearer than `ON_PLACE` is where it should be.
OFF_PLACE, ON_PLACE = 10.0, 5.0
#: m before and behind a gauge from which a vehicle strains the gauge most.
BESIDE = 5.0
#: m/s; on few roads a vehicle is faster (144 km/h).
FAST = 40.0
#: Clocks are this many hours apart at most where one of them is local, and agree to this share of the shorter span.
ZONES, WITHIN = 14, 0.8


def check_clocks(tracks: "Sequence[Track]", record: DASRecord) -> None:
    """Raise InputError where no track has a fix during the record; it says whether a time zone may be the cause."""
    if not tracks:
        raise InputError("no trajectories; give a table with at least one moving vehicle")
    if any(track.time[0] <= record.time[-1] and track.time[-1] >= 0 for track in tracks):
        return
    first, last = min(track.time[0] for track in tracks), max(track.time[-1] for track in tracks)
    begin, end = ((one - record.start) / np.timedelta64(1, "s") for one in (record.recorded.start, record.recorded.end))
    raise InputError(
        f"trajectories ({span(record, first, last)}) and DAS ({span(record, begin, end)}) do not overlap in time; "
        + (zone_line(first - begin, last - begin, end - begin) or "check both clocks, or give files of one survey")
    )


def span(record: DASRecord, first: float, last: float) -> str:
    """Write times, s since the start of the record."""
    ends = record.start + np.round(np.array([first, last]) * 1e9).astype("timedelta64[ns]")
    return " to ".join(f"{np.datetime_as_string(end, unit='s')}Z" for end in ends)


def zone_line(first: float, last: float, end: float) -> str | None:
    """Say by how many whole hours tracks from `first` to `last`, s, miss a record from 0 to `end`, s; None: by none.

    >>> zone_line(7220.0, 7380.0, 193.0)
    'they are 2 h apart: one of the clocks seems to be local time; write both in UTC'
    >>> zone_line(900.0, 1000.0, 193.0) is None
    True
    """
    hours = round((first + last - end) / 2 / 3600)
    begin, stop = first - 3600 * hours, last - 3600 * hours
    common = min(stop, end) - max(begin, 0.0)
    if not 0 < abs(hours) <= ZONES or common < WITHIN * min(last - first, end):
        return None
    return f"they are {abs(hours)} h apart: one of the clocks seems to be local time; write both in UTC"


def slow_line(record: DASRecord, passes: "Sequence[Pass]") -> str | None:
    """Say that a record has too few samples to see every vehicle pass every channel, and how many it takes."""
    speed = float(np.median([abs(one.speed) for one in passes]))
    reach = record.gauge_length + 2 * BESIDE
    if speed / record.sampling_rate <= reach:
        return None
    return (
        f"{record.sampling_rate:g} samples/s are too few: vehicles go {speed / record.sampling_rate:.0f} m from one to "
        f"the next, and a channel senses them over {reach:.0f} m; record at least {speed / reach:.1f} samples/s"
    )


def in_record(anchors: Sequence[Anchor], record: DASRecord, warnings: list[str]) -> list[Anchor]:
    """Anchors on channels of the record, or so little beyond that they matter; the others are named in `warnings`."""
    first, last = record.recorded.channels
    used = within_reach(anchors, (first, last), record.channel_spacing)
    for one in anchors:
        if one not in used:
            warnings.append(
                f"anchor {one.name} is on channel {one.channel:g}, which is not in the record ({first} to {last}), so "
                "it is not used; check the number if the record should hold it"
            )
    return used


def near(anchors: Sequence[Anchor], active: tuple[int, int], spacing: float, warnings: list[str]) -> list[Anchor]:
    """Anchors within reach of the active channels; the others are named in `warnings`."""
    used = within_reach(anchors, active, spacing)
    far = [f"{a.name} (channel {a.channel:g})" for a in anchors if a not in used]
    if far:
        warnings.append(
            f"more than {ANCHOR_REACH:g} m of fiber from the channels that record vehicles ({active[0]} to "
            f"{active[1]}), so not used: anchors {', '.join(far)}"
        )
    return used


def apart(one: Anchor, other: Anchor) -> tuple[float, float]:
    """Horizontal distance of two anchors, and its sigma, m."""
    return float(np.hypot(one.x - other.x, one.y - other.y)), float(np.hypot(one.sigma_xy, other.sigma_xy))


def check_gauge(record: DASRecord) -> None:
    """Raise InputError where a gauge is longer than all of the fiber that was recorded."""
    count, spacing = len(record.channel), record.channel_spacing
    if record.gauge_length > count * spacing:
        raise InputError(
            f"gauge length {record.gauge_length:g} m, but {count} channels at {spacing:g} m are only "
            f"{count * spacing:.0f} m; check both lengths in [das] of site.toml, or give more channels"
        )


def check_apart(anchors: Sequence[Anchor], spacing: float) -> None:
    """Raise InputError where two anchors are farther apart than the fiber between their channels is long.

    >>> check_apart([Anchor("a", 74, 12600, 0, 1, 0.1, 0.1), Anchor("b", 147, 87, 0, 1, 0.1, 0.1)], 1.0)
    Traceback (most recent call last):
    vision.contract.errors.InputError: anchors a and b are 12513.0 m apart, but from channel 74 to 147 it is 73.0 m of \
fiber; check their channels and places, in m
    """
    for one, other in combinations(anchors, 2):
        distance = float(np.hypot(one.x - other.x, one.y - other.y))
        sigma = float(np.hypot(one.sigma_xy, other.sigma_xy))
        fiber = abs(one.channel - other.channel) * spacing
        # A channel is anywhere within its spacing.
        if distance > (1 + SPACING_OFF) * (fiber + spacing) + SURE * sigma:
            raise InputError(
                f"anchors {one.name} and {other.name} are {distance:.1f} m apart, but from channel {one.channel:g} to "
                f"{other.channel:g} it is {fiber:.1f} m of fiber; check their channels and places, in m"
            )


def from_tracks(anchor: Anchor, passes: "Sequence[Pass]") -> float:
    """Horizontal distance of an anchor from the nearest track, m."""
    place, nearest = np.array([anchor.x, anchor.y]), np.inf
    for one in passes:
        begin, step = one.position[:-1], np.diff(one.position, axis=0)
        along = ((place - begin) * step).sum(1) / np.maximum((step**2).sum(1), 1e-12)
        on_track = begin + np.clip(along, 0.0, 1.0)[:, None] * step
        nearest = min(nearest, float(np.hypot(*(on_track - place).T).min(initial=np.inf)))
    return nearest


def check_reach(anchors: Sequence[Anchor], passes: "Sequence[Pass]", active: tuple[int, int], spacing: float) -> None:
    """Raise InputError where an anchor is too far from all tracks for its channel to sense a vehicle.

    Parameters
    ----------
    active : first and last channel that record vehicles; anchors beyond are allowed the fiber to there
    spacing : of channels, m
    """
    for one in anchors:
        fiber = max(active[0] - one.channel, one.channel - active[1], 0.0) * spacing
        distance = from_tracks(one, passes)
        if distance > VEHICLE_REACH + (1 + SPACING_OFF) * fiber + SURE * one.sigma_xy:
            recorded = f"recorded {fiber:.0f} m of fiber from" if fiber else "recorded on"
            raise InputError(
                f"anchor {one.name} is {distance:.1f} m from every track, but vehicles are {recorded} its channel "
                f"{one.channel:g}; check its channel and place, the tracks, and [frame] in site.toml"
            )


def misplaced(anchors: Sequence[Anchor], channel: NDArray[np.int64], x: Array) -> list[Anchor]:
    """Anchors that are elsewhere along the road than vehicles are recorded on their channels.

    Where all are so by the same length, it is not they that are wrong: the ground's waves may be of another form.

    Parameters
    ----------
    channel, x : [channel], channels that record vehicles and where, m

    Raises
    ------
    InputError
        If two anchors would be in place with their channels exchanged.

    >>> line = np.arange(100), np.arange(100.0)
    >>> right, wrong = Anchor("a", 20, 21, 0, 1, 0.1, 0.1), Anchor("b", 60, 80, 0, 1, 0.1, 0.1)
    >>> [one.name for one in misplaced([right, wrong], *line)]
    ['b']
    """
    inside = [one for one in anchors if channel[0] <= one.channel <= channel[-1]]
    miss = np.array([one.x - np.interp(one.channel, channel, x) for one in inside])
    far = [one for one, by in zip(inside, miss, strict=True) if abs(by) > OFF_PLACE + SURE * one.sigma_xy]
    for one, other in combinations(far, 2):
        exchanged = np.abs(np.interp([one.channel, other.channel], channel, x) - [other.x, one.x])
        if exchanged.max() < ON_PLACE:
            raise InputError(
                f"anchors {one.name} and {other.name} seem to be exchanged: each lies where vehicles are recorded on "
                f"the channel of the other ({one.channel:g}, {other.channel:g}); exchange their channels or places, or "
                "see whether the tracks run backwards"
            )
    agree = len(miss) > 1 and np.ptp(miss) < ON_PLACE
    return [] if agree else far


def misplaced_line(anchor: Anchor, channel: NDArray[np.int64], x: Array) -> str:
    """Say that an anchor is left out because it is not where vehicles are recorded on its channel."""
    distance = abs(anchor.x - float(np.interp(anchor.channel, channel, x)))
    return (
        f"anchor {anchor.name} is {distance:.0f} m along the road from where vehicles are recorded on its channel "
        f"{anchor.channel:g}; check its channel and place; it is left out"
    )


def suspicions(record: DASRecord, passes: "Sequence[Pass]") -> str:
    """What may be why no vehicle is seen in a record, as the end of a sentence; empty where nothing is suspect."""
    slow = slow_line(record, passes)
    lines = [slow] if slow else []
    samples, channels = record.strain_rate.shape
    last = max(int(one.rows[one.in_view][-1]) for one in passes if one.in_view.any())
    if record.provenance.get("format") == "numpy" and last >= samples - 1 and samples < channels:
        lines.append(f"the array has {samples} samples of {channels} channels: are its axes exchanged?")
    if (speed := float(np.median([abs(one.speed) for one in passes]))) > FAST:
        lines.append(f"vehicles at {speed:.0f} m/s are fast: are x and y in m?")
    return "".join(f"; {line}" for line in lines)
