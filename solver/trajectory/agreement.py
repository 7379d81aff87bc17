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
ZONE_MEND = "a clock in local time, a zone that a file does not state, or files of another hour; give UTC"
#: What else may be wrong where no anchor agrees with tracks and record.
WHERE_FROM = "what the record's channels count from, and the frame and clock of the tracks"
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
    'they are 2 h apart: a clock in local time, a zone that a file does not state, or files of another hour; give UTC'
    >>> zone_line(900.0, 1000.0, 193.0) is None
    True
    """
    hours = round((first + last - end) / 2 / 3600)
    begin, stop = first - 3600 * hours, last - 3600 * hours
    common = min(stop, end) - max(begin, 0.0)
    if not 0 < abs(hours) <= ZONES or common < WITHIN * min(last - first, end):
        return None
    return f"they are {abs(hours)} h apart: {ZONE_MEND}"


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
    used = within_reach(anchors, record.recorded.channels, record.channel_spacing)
    warnings += [unrecorded_line(one, record.recorded.channels) for one in anchors if one not in used]
    return used


def unrecorded_line(anchor: Anchor, recorded: tuple[int, int]) -> str:
    """Say that an anchor's channel is not among those `recorded`, the first and the last."""
    return (
        f"anchor {anchor.name} is on channel {anchor.channel:g}, which is not in the record ({recorded[0]} to "
        f"{recorded[1]}), so it is not used; check the number if the record should hold it"
    )


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
fiber; check their channels and places, in m, and channel_spacing
    """
    for one, other in combinations(anchors, 2):
        distance = float(np.hypot(one.x - other.x, one.y - other.y))
        sigma = float(np.hypot(one.sigma_xy, other.sigma_xy))
        fiber = abs(one.channel - other.channel) * spacing
        # A channel is anywhere within its spacing.
        if distance > (1 + SPACING_OFF) * (fiber + spacing) + SURE * sigma:
            raise InputError(
                f"anchors {one.name} and {other.name} are {distance:.1f} m apart, but from channel {one.channel:g} to "
                f"{other.channel:g} it is {fiber:.1f} m of fiber; check their channels and places, "
                "in m, and channel_spacing"
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


def unseen_crossings(
    anchors: Sequence[Anchor], passes: "Sequence[Pass]", channel: NDArray[np.int64], route: Array
) -> list[str]:
    """Say which anchors beyond the located channels [channel] lie across the traffic from the end of the route.

    Parameters
    ----------
    route : of these channels [channel, 3], m
    """
    y = np.concatenate([one.position[one.in_view, 1] for one in passes])

    def side(place: float) -> int:
        return int(place > y.max()) - int(place < y.min())

    said = []
    for one in anchors:
        end = 0 if one.channel < channel[0] else -1
        if not channel[0] <= one.channel <= channel[-1] and side(one.y) * side(route[end, 1]) < 0:
            said.append(
                f"anchor {one.name} lies on the other side of the road than the fiber at channel {channel[end]}: the "
                f"fiber crosses the road between channels {channel[end]} and {one.channel:g}, beyond what was tracked "
                "and recorded, so that nothing tells where; or the road bends, or the anchor is wrong"
            )
    return said


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


def common_mistakes(
    anchors: Sequence[Anchor], channel: NDArray[np.int64], x: Array, recorded: tuple[int, int]
) -> list[tuple[float, float, str]]:
    """Single mistakes that would put all anchors where vehicles are recorded on their channels.

    Parameters
    ----------
    channel, x : [channel], channels that record vehicles and where, m
    recorded : first and last channel of the record

    Returns
    -------
    mistakes : how far the farthest anchor would be off, m; by how much all are off alike, m, inf where the mistake is
        another; and the mistake, as the end of a sentence. Best first, and last one that has a length to
        choose besides; none where anchors are in place, or no single mistake explains them

    >>> line = np.arange(101), np.arange(0.0, 202.0, 2.0)
    >>> west, east = Anchor("west", 20, 80.0, 4, 1, 0.1, 0.1), Anchor("east", 70, 181.0, 4, 1, 0.1, 0.1)
    >>> for off, shift, mistake in common_mistakes([west, east], *line, (0, 240)):
    ...     print(off, shift, mistake)
    0.5 40.5 +20 were added to their channel numbers, or -40.5 m to their x, or +40.5 m to that of the tracks
    """
    number, along, sigma = (np.array([getattr(one, name) for one in anchors]) for name in ("channel", "x", "sigma_xy"))
    if len(anchors) < 2 or np.ptp(along) < 2 * OFF_PLACE:
        return []

    slope = float(x[-1] - x[0]) / float(channel[-1] - channel[0])
    heard = (number >= channel[0]) & (number <= channel[-1])

    def off(number: Array, along: Array) -> Array:
        inside = np.clip(number, channel[0], channel[-1])
        miss = along - np.interp(inside, channel, x) - slope * (number - inside)
        # Where no anchor's own channel records vehicles, the fiber may take any way to it.
        return miss if heard.any() else np.where(inside == number, miss, np.inf)

    if heard.any() and (np.abs(off(number, along)) <= OFF_PLACE + SURE * sigma)[heard].all():
        return []
    order = np.argsort(x)
    inside = np.clip(along, x.min(), x.max())
    step = float((np.interp(inside, x[order], channel[order]) + (along - inside) / slope - number).mean())
    shift = step * slope
    tries: list[tuple[Array, float, str]] = [
        (
            off(number + step, along),
            shift,
            f"{step:+.0f} were added to their channel numbers, or {-shift:+.1f} m to their x, or {shift:+.1f} m to "
            "that of the tracks",
        ),
        (
            off(number, -along),
            np.inf,
            "they, or the tracks, were turned about the origin by half a turn, as x_azimuth in [frame] turns what "
            "comes in latitude and longitude",
        ),
        (off(recorded[0] + recorded[1] - number, along), np.inf, "channels were counted from the record's other end"),
    ]
    for i, j in combinations(range(len(anchors)), 2):
        swapped = number.copy()
        swapped[[i, j]] = number[[j, i]]
        words = f"the channels of {anchors[i].name} and {anchors[j].name} were exchanged"
        tries.append((off(swapped, along), np.inf, words))
    found = sorted((float(np.abs(left).max()), by, words) for left, by, words in tries)
    if heard.all():
        back = along + np.interp(number, channel, x)
        found.append((float(np.abs(back - back.mean()).max()), np.inf, "the tracks ran the other way along x"))
    return [one for one in found if one[0] < ON_PLACE + SURE * sigma.max()]


def check_together(
    anchors: Sequence[Anchor], passes: "Sequence[Pass]", channel: NDArray[np.int64], x: Array, record: DASRecord
) -> str | None:
    """Raise InputError where one mistake would put all anchors where vehicles are recorded; it names the rivals.

    Anchors contradict tracks and record together then, and no anchor the others.

    Returns
    -------
    caution : the same line where all are off alike by so little that the ground's waves, if of another form, may be
        why; None where there is no such mistake
    """
    mistakes = common_mistakes(anchors, channel, x, record.recorded.channels)
    if not mistakes:
        return None
    shift, rivals = min(by for _, by, _ in mistakes), [words for *_, words in mistakes]
    speeds = np.array([one.speed for one in passes])
    if np.isfinite(shift) and np.ptp(np.sign(speeds)) == 0:
        late = abs(shift / float(np.median(speeds)))
        rivals.append(f"the clocks were {late:.1f} s apart, which vehicles that all go one way do not tell")
    names = ", ".join(f"{one.name} (channel {one.channel:g})" for one in anchors)
    which = "" if len(rivals) == 1 else "; nothing else tells which"
    line = (
        f"anchors {names} are not where vehicles are recorded on their channels; all would be if "
        f"{'; or if '.join(rivals)}{which}"
    )
    if abs(shift) > record.gauge_length + 2 * BESIDE:
        raise InputError(line)
    return line


def misplaced(anchors: Sequence[Anchor], channel: NDArray[np.int64], x: Array) -> list[Anchor]:
    """Anchors that are elsewhere along the road than vehicles are recorded on their channels.

    Where all are so by the same length, it is not they that are wrong: the ground's waves may be of another form.

    Parameters
    ----------
    channel, x : [channel], channels that record vehicles and where, m

    >>> line = np.arange(100), np.arange(100.0)
    >>> right, wrong = Anchor("a", 20, 21, 0, 1, 0.1, 0.1), Anchor("b", 60, 80, 0, 1, 0.1, 0.1)
    >>> [one.name for one in misplaced([right, wrong], *line)]
    ['b']
    """
    inside = [one for one in anchors if channel[0] <= one.channel <= channel[-1]]
    miss = np.array([one.x - np.interp(one.channel, channel, x) for one in inside])
    far = [one for one, by in zip(inside, miss, strict=True) if abs(by) > OFF_PLACE + SURE * one.sigma_xy]
    agree = len(miss) > 1 and np.ptp(miss) < ON_PLACE
    return [] if agree else far


def misplaced_line(anchor: Anchor, channel: NDArray[np.int64], x: Array, alone: bool = False) -> str:
    """Say that an anchor is left out because it is not where vehicles are recorded on its channel.

    Parameters
    ----------
    alone : whether no other anchor agrees with tracks and record, which may be wrong as well then
    """
    distance = abs(anchor.x - float(np.interp(anchor.channel, channel, x)))
    others = f", {WHERE_FROM}" if alone else ""
    return (
        f"anchor {anchor.name} is {distance:.0f} m along the road from where vehicles are recorded on its channel "
        f"{anchor.channel:g}; check its channel and place{others}; it is left out"
    )


def suspicions(record: DASRecord, passes: "Sequence[Pass]") -> str:
    """What may be why no vehicle is seen in a record, as the end of a sentence; empty where nothing is suspect."""
    slow = slow_line(record, passes)
    lines = [slow] if slow else []
    samples, channels = record.strain_rate.shape
    last = max(int(one.rows[one.in_view][-1]) for one in passes if one.in_view.any())
    if record.provenance.get("format") == "numpy" and last >= samples - 1 and samples < channels:
        lines.append(f"the array has {samples} samples of {channels} channels: are its axes exchanged?")
    first, last = int(record.channel[0]), int(record.channel[-1])
    if (first, last) != record.recorded.channels:
        lines.append(
            f"only channels {first} to {last} were looked at, by the anchors' channel numbers: are these right?"
        )
    if (speed := float(np.median([abs(one.speed) for one in passes]))) > FAST:
        lines.append(f"vehicles at {speed:.0f} m/s are fast: are x and y in m?")
    return "".join(f"; {line}" for line in lines)
