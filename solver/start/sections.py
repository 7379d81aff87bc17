"""Where to begin on a fiber of kilometers: the matched filter section by section along the road, each unrolled.

One line of channel against position holds for some hundred meters only, and on a long road many vehicles are about at
once. Sections are looked at in turn, each with the vehicles while they are in it, on the channels where the one before
ends; the first, and those after a gap, are sought among all channels.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.start.detections import mended
from solver.start.initialization import Initialization, initialize
from solver.start.wavelets import Array, bank
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass
from vision.contract import InputError, progress

#: Traffic in view over more than this is looked at in sections, m.
ONE_SECTION = 400.0
#: Length of a section and distance between their middles, m.
LENGTH, STEP = 300.0, 240.0
#: Passes that are looked at in a section: the fit uses all.
HEARD = 10
#: Channels to either side of where a section is expected, as m of fiber.
SPARE = 60.0
#: Meters of road per meter of fiber that are tried where a section is sought among all channels.
SLOPES = np.arange(0.8, 1.05, 0.04)
#: Scale of the wavelet that is used for it, m.
SCALE = 6.0
#: Rows that a pass must have in a section.
FEWEST_ROWS = 10
#: Meters over which the weaving of the vehicle that shows the road is smoothed, and how far its ends go on straight.
WEAVE, BEYOND = 15.0, 100


@dataclass(frozen=True)
class Section:
    """A stretch of road, unrolled: x' along the road from the middle of the stretch, y' to the right of it.

    Parameters
    ----------
    arc : [point], m along the road from the middle, some way beyond the ends
    points, axes : [point, 2], places on the road, m, and unit vectors along it
    half : half its length, m
    """

    arc: Array
    points: Array
    axes: Array
    half: float

    @property
    def rights(self) -> Array:
        """Unit vectors to the right of the road [point, 2]."""
        return np.stack([-self.axes[:, 1], self.axes[:, 0]], 1)

    def nearest(self, place: Array) -> NDArray[np.int64]:
        """Number of the road's point next to each place [row, 2]."""
        from scipy.spatial import cKDTree

        return np.asarray(cKDTree(self.points).query(place)[1])

    def local(self, place: Array) -> Array:
        """Points [row, 2], m, unrolled."""
        at = self.nearest(place)
        off = place - self.points[at]
        return np.stack([self.arc[at] + (off * self.axes[at]).sum(1), (off * self.rights[at]).sum(1)], 1)

    def outward(self, place: Array) -> Array:
        """Unrolled points [row, 2] in the survey's frame."""
        x, y = np.clip(place[:, 0], self.arc[0], self.arc[-1]), place[:, 1]
        middle, axis, right = (
            np.stack([np.interp(x, self.arc, column) for column in part.T], 1)
            for part in (self.points, self.axes, self.rights)
        )
        return middle + (place[:, 0] - x)[:, None] * axis + y[:, None] * right

    def cut(self, one: Pass, spare: float = 40.0) -> Pass | None:
        """The part of a pass within the section and a little beyond, unrolled; None where there is none."""
        low, high = self.points.min(0) - spare, self.points.max(0) + spare
        rows = np.flatnonzero(((one.position > low) & (one.position < high)).all(1))
        if len(rows) < FEWEST_ROWS:
            return None
        # A vehicle that comes twice counts once.
        rows = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)[0]
        place = self.local(one.position[rows])
        near = (np.abs(place[:, 0]) < self.half + spare) & (np.abs(place[:, 1]) < spare)
        keep, place = rows[near], place[near]
        inside = np.abs(place[:, 0]) < self.half
        if len(keep) < FEWEST_ROWS or not (inside & one.in_view[keep]).any() or (np.diff(keep) > 1).any():
            return None
        at = self.nearest(one.position[keep])
        velocity = np.stack([(one.velocity[keep] * part[at]).sum(1) for part in (self.axes, self.rights)], 1)
        return replace(
            one,
            rows=one.rows[keep],
            position=place,
            velocity=velocity,
            sigma=one.sigma[keep],
            in_view=one.in_view[keep] & inside,
        )


def extent(passes: Sequence[Pass]) -> float:
    """How far vehicles are seen to drive, m: the longest pass in view."""
    ways = [one.position[one.in_view] for one in passes]
    return max((float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()) for way in ways if len(way) > 1), default=0.0)


def sections_of(passes: Sequence[Pass]) -> list[Section]:
    """Sections along the way of the vehicle that drives farthest, along +x."""
    from scipy.ndimage import gaussian_filter1d

    way = max((one.position[one.in_view] for one in passes), key=lambda way: np.ptp(way, 0).max() if len(way) else 0.0)
    way = way if way[-1, 0] >= way[0, 0] else way[::-1]
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    arc = np.arange(0.0, driven[-1])
    # Odd continuation at the ends: the road goes straight on there.
    points = np.stack([gaussian_filter1d(np.interp(arc, driven, c), WEAVE, mode="nearest") for c in way.T], 1)
    points = points[round(2 * WEAVE) : len(points) - round(2 * WEAVE)]
    arc = np.arange(len(points), dtype=float)
    beyond = np.arange(1, BEYOND + 1)[:, None]
    ends = points[1] - points[0], points[-1] - points[-2]
    points = np.concatenate([points[0] - beyond[::-1] * ends[0], points, points[-1] + beyond * ends[1]])
    axes = np.gradient(points, axis=0)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    count = max(1, round((arc[-1] - LENGTH) / STEP)) + 1
    found = []
    for middle in np.linspace(LENGTH / 2, arc[-1] - LENGTH / 2, count).round().astype(int).tolist():
        part = slice(max(0, middle - round(LENGTH / 2)), middle + round(LENGTH / 2) + 2 * BEYOND)
        found.append(
            Section(
                np.arange(part.start, part.stop)[: len(points[part])] - (middle + BEYOND) + 0.0,
                points[part],
                axes[part],
                LENGTH / 2,
            )
        )
    return found


def heard(passes: Sequence[Pass]) -> list[Pass]:
    """A few passes of each direction, of all classes that there are."""
    chosen: list[Pass] = []
    for way in (True, False):
        alike = sorted((one for one in passes if (one.speed > 0) == way), key=lambda one: one.vehicle_class)
        chosen += [alike[i] for i in np.unique(np.linspace(0, len(alike) - 1, HEARD // 2).astype(int)) if alike]
    return sorted(chosen, key=lambda one: int(one.rows[0]))


def sought(record: DASRecord, passes: Sequence[Pass]) -> tuple[float, int]:
    """Channel (column of the record) beside x' = 0 and the direction of the fiber, by a slant stack over all channels.

    Along the track of each pass through a map of channel against time, an upright wavelet must be loud or a reversed
    one, for all passes of one direction alike.
    """
    spacing, best = record.channel_spacing, (-np.inf, 0.0, 1)
    shape = bank(np.array([max(2.0, SCALE / spacing)]))[:, 0]
    maps = []
    for one in passes:
        rows = one.rows[one.in_view][:: max(1, int(one.in_view.sum()) // 40)]
        data = mended(record.strain_rate[rows].astype(np.float64))
        level = 1.4826 * np.median(np.abs(data)) or 1.0
        loud = np.array([np.correlate(row, shape, "same") for row in np.clip(data / level, -20, 20)])
        maps.append((np.sign(one.speed) * loud, one.position[np.isin(one.rows, rows), 0]))
    for way in (1, -1):
        for slope in way * SLOPES:
            total = np.zeros(record.strain_rate.shape[1])
            for loud, x in maps:
                shift = np.rint(x / (slope * spacing)).astype(int)
                total += sum(np.roll(row, -by) for row, by in zip(loud, shift, strict=True)) / len(x)
            for stack in (total, -total):
                at = int(stack.argmax())
                if stack[at] > best[0]:
                    best = (float(stack[at]), float(at), way)
    return best[1], best[2]


@dataclass(frozen=True)
class Found:
    """A section with what the matched filter saw there."""

    section: Section
    rough: Initialization

    def route(self, lateral: Array) -> Array:
        """Rough route [channel, 3] in the survey's frame."""
        place = np.column_stack([self.rough.route[:, 0], lateral])
        return np.column_stack([self.section.outward(place), self.rough.route[:, 2]])


def looked_at(
    record: DASRecord, passes: Sequence[Pass], section: Section, middle: float, depth: float, poisson_ratio: float
) -> Found:
    """One section, on the channels around column `middle` of the record; raises InputError where nothing is seen."""
    spare = round((section.half + SPARE) / record.channel_spacing)
    first, stop = max(0, round(middle) - spare), min(len(record.channel), round(middle) + spare + 1)
    if stop - first < spare:
        raise InputError("DAS record: the fiber ends before this stretch of road")
    part = replace(
        record,
        strain_rate=record.strain_rate[:, first:stop],
        distance=record.distance[first:stop],
        channel=record.channel[first:stop],
    )
    return Found(section, initialize(part, passes, depth=depth, poisson_ratio=poisson_ratio))


def expected(last: Found, section: Section, record: DASRecord) -> float:
    """Column of the record beside the middle of a section, by the line of the one before."""
    x0, slope = last.rough.x_of_channel
    middle = section.outward(np.zeros((1, 2)))
    along = float(last.section.local(middle)[0, 0])
    return (along - x0) / slope - float(record.channel[0])


def initialize_sections(
    record: DASRecord, passes: Sequence[Pass], *, depth: float = 0.9, poisson_ratio: float = 0.25
) -> list[Found]:
    """Look at a long road section by section.

    Parameters
    ----------
    record, passes, depth, poisson_ratio : as of `solver.start.initialization.initialize`

    Raises
    ------
    InputError
        If nothing is seen in any section; the first reason is given.
    """
    found: list[Found] = []
    reasons: list[InputError] = []
    sections = sections_of(passes)
    last: Found | None = None
    with progress("matching sections of the road", len(sections)) as advance:
        for section in sections:
            near = heard([part for one in passes if (part := section.cut(one)) is not None])
            try:
                last = next(attempts(record, near, section, last, depth, poisson_ratio))
                found.append(last)
            except InputError as error:
                reasons.append(error)
                last = None
            advance(1)
    if not found:
        raise reasons[0]
    return found


def attempts(
    record: DASRecord, near: Sequence[Pass], section: Section, last: Found | None, depth: float, poisson_ratio: float
) -> Iterator[Found]:
    """What is found where the section before says, or else where all channels are searched."""
    if not near:
        raise InputError("trajectories: no vehicle in this stretch of road")
    if last is not None:
        try:
            yield looked_at(record, near, section, expected(last, section, record), depth, poisson_ratio)
        except InputError:
            last = None
    if last is None:
        yield looked_at(record, near, section, sought(record, near)[0], depth, poisson_ratio)
