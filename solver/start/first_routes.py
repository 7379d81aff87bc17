"""Where a fit begins: channels and rough routes, on a street or along kilometers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solver.cable.fiber import Coil
from solver.start.initialization import Initialization, initialize
from solver.start.joined_sections import joined, sides_of
from solver.start.rough_route import OFF_LINE, beyond_words, felt_beyond, silent, start_route, straight_part, view_of
from solver.start.sections import ONE_SECTION, Found, extent, initialize_sections
from solver.survey.anchors import Anchor
from solver.survey.das.record import DASRecord
from solver.trajectory.agreement import check_reach, check_together, in_record, misplaced, misplaced_line, near
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]
#: Share of the channels beyond the line that record vehicles, where the fiber goes on there.
MOST = 0.5
#: Channels at the end of a route whose mean direction is that in which it goes on.
STRAIGHT = 10
#: Evidence, in standard deviations per section, from which a side that the widths tell is not doubted.
TOLD = 3.0


@dataclass(frozen=True)
class FirstRoutes:
    """Rough routes that a fit may start from.

    Parameters
    ----------
    channel : [channel], numbers of the channels to fit
    routes : rough routes [channel, 3], m, of which any may lead to the fiber
    anchors : within reach of the channels
    disputed : sentences on anchors that are left out because vehicles are recorded elsewhere
    coil : fiber that seems to lie coiled; None where none does
    rough : what the matched filter made of the passes; None along kilometers
    sections : what it made of them there, section by section
    felt : first and last channel that record vehicles in view, though perhaps not where one line along the road expects
        them; None: no others
    unfitted : why those beyond `channel` are not fitted, by side: 0 before the first, -1 behind the last
    """

    channel: NDArray[np.int64]
    routes: list[Array]
    anchors: list[Anchor]
    disputed: list[str]
    coil: Coil | None = None
    rough: Initialization | None = None
    sections: Sequence[Found] = ()
    felt: NDArray[np.int64] | None = None
    unfitted: Mapping[int, str] = field(default_factory=dict)

    @property
    def coil_line(self) -> str:
        """What a user should read of a coil that no corner of the route explains; empty where none is seen."""
        if self.rough is None or self.rough.coil is None:
            return ""
        channel, length = self.rough.coil
        return (
            f"about {length:.0f} m of fiber seem to lie coiled near channel {channel}: beyond it vehicles appear that "
            "much later. The base model has no coil, so do not rely on this route: roadfiber add RUN slack_spool"
        )

    @property
    def whole(self) -> "FirstRoutes | None":
        """The same over all channels that are felt, straight on from both ends; None where these are no more."""
        if self.felt is None or np.array_equal(self.felt, self.channel[[0, -1]]):
            return None
        channel = np.arange(self.felt[0], self.felt[1] + 1)
        return replace(self, channel=channel, routes=[straight_on(self.channel, self.routes[0], channel)], unfitted={})

    def beyond(self, located: NDArray[np.int64]) -> list[str]:
        """Lines for the user on channels that are not fitted, given the numbers of those `located` [channel].

        >>> FirstRoutes(np.arange(9), [], [], [], unfitted={-1: "it is not located"}).beyond(np.arange(2, 7))
        ['it is not located beyond channel 6']
        """
        return [f"{why} beyond channel {located[side]}" if len(located) else why for side, why in self.unfitted.items()]


def farthest_felt(end: int, loud: NDArray[np.int64]) -> int:
    """The channel farthest beyond `end` up to which most record vehicles, of those `loud` that do.

    >>> farthest_felt(10, np.array([11, 12, 14, 30])), farthest_felt(10, np.array([3, 8, 9]))
    (14, 8)
    """
    away = np.sort(np.abs(loud - end))
    most = away[np.arange(1, len(away) + 1) > MOST * away]
    return end + int(most[-1] * np.sign(loud[0] - end)) if len(most) else end


def straight_on(channel: NDArray[np.int64], route: Array, wanted: NDArray[np.int64]) -> Array:
    """A route [channel, 3], m, over more channels [wanted]: beyond its ends straight on at the depth there.

    >>> straight_on(np.arange(3), np.array([[0.0, 4.0, 1.0], [1.0, 4.0, 1.1], [2.0, 4.0, 1.2]]), np.array([2, 4]))
    array([[2. , 4. , 1.2],
           [4. , 4. , 1.2]])
    """
    out = np.column_stack([np.interp(wanted, channel, axis) for axis in route.T])
    inner = min(STRAIGHT, len(channel) - 1)
    for end, back in ((0, inner), (-1, -1 - inner)):
        way = (route[end] - route[back]) * [1.0, 1.0, 0.0] / (channel[end] - channel[back])
        beyond = wanted - channel[end] if end else channel[0] - wanted
        out += np.clip(beyond if end else -beyond, *((0, None) if end else (None, 0)))[:, None] * way
    return out


def find_first_routes(
    record: DASRecord,
    passes: Sequence[Pass],
    anchors: Sequence[Anchor],
    *,
    depth: float,
    poisson_ratio: float,
    warnings: list[str],
) -> FirstRoutes:
    """Find channels and rough routes by the matched filter; a long road is looked at in sections.

    Parameters
    ----------
    depth, poisson_ratio : prior means, m and 1
    warnings : lines for the user are added: anchors out of reach, channels that record nothing

    Raises
    ------
    InputError
        If no vehicle is seen in the DAS where the trajectories say, or anchors cannot be where they are said to be.
    """
    if extent(passes) > ONE_SECTION:
        found = initialize_sections(record, passes, depth=depth, poisson_ratio=poisson_ratio)
        return along_road(record, passes, found, anchors, warnings)
    rough = initialize(record, passes, depth=depth, poisson_ratio=poisson_ratio)
    # Beyond a coil the line is off, and not the anchors.
    line = (rough.channel, rough.route[:, 0]) if rough.coil is None else None
    used, disputed = agreeing(anchors, record, passes, rough.active, line, warnings)
    if nothing := silent(record, view_of(rough, passes)):
        warnings.append(nothing)
    recorded = int(record.channel[0]), int(record.channel[-1])
    gauge = round(record.gauge_length / record.channel_spacing)
    keep = straight_part(rough, passes, gauge, recorded)
    seen = np.clip(view_of(rough, passes), *recorded)
    felt, unfitted = rough.channel[keep][[0, -1]], dict[int, str]()
    for side in (0, -1):
        if (end := int(rough.channel[side])) != rough.channel[keep][side]:
            loud = felt_beyond(record, passes, end, int(seen[side]))
            unfitted[side] = beyond_words(end, loud, gauge)
            if abs((farthest := farthest_felt(end, loud)) - end) > gauge:
                felt[side] = farthest
    sides = [rough.lateral] if used else [rough.lateral, rough.mirror]
    routes = [start_route(rough, y, used)[keep] for y in sides]
    coil = coiled(rough, routes[0], record)
    # Ground of an unusual Poisson's ratio makes waves of another form, which fit best a crest away.
    if coil is None and abs(ahead := anchors_ahead(rough, used)) > OFF_LINE:
        routes.append(routes[0] + np.array([ahead, 0.0, 0.0]))
    return FirstRoutes(rough.channel[keep], routes, used, disputed, coil, rough, felt=felt, unfitted=unfitted)


def agreeing(
    anchors: Sequence[Anchor],
    record: DASRecord,
    passes: Sequence[Pass],
    active: tuple[int, int],
    line: tuple[NDArray[np.int64], Array] | None,
    warnings: list[str],
) -> tuple[list[Anchor], list[str]]:
    """Anchors within reach that tracks and record do not contradict, and a sentence on each that they do.

    Parameters
    ----------
    active : first and last channel that record vehicles
    line : these channels and where vehicles are recorded on them, m; None where that is not known
    warnings : lines for the user are added: anchors out of reach, or all off alike

    Raises
    ------
    InputError
        If an anchor is out of every vehicle's reach, or all would be in place but for one mistake.
    """
    if line is not None and (caution := check_together(anchors, passes, *line, record)):
        warnings.append(caution)
    used = near(in_record(anchors, record, warnings), active, record.channel_spacing, warnings)
    check_reach(used, passes, active, record.channel_spacing)
    wrong = misplaced(used, *line) if line is not None else []
    rest = [one for one in used if one not in wrong]
    return rest, [misplaced_line(one, *line, alone=not rest) for one in wrong] if line is not None else []


def anchors_ahead(rough: Initialization, anchors: Sequence[Anchor]) -> float:
    """How much farther along x anchors lie than the line of the matched filter, m; 0 where they do not agree on it."""
    x0, slope = rough.x_of_channel
    miss = np.array([one.x - (x0 + slope * one.channel) for one in anchors])
    return float(miss.mean()) if len(miss) > 1 and np.ptp(miss) < OFF_LINE else 0.0


def coiled(rough: Initialization, route: Array, record: DASRecord) -> Coil | None:
    """The coil that the matched filter sees, beside a rough route."""
    if rough.coil is None:
        return None
    channel, length = rough.coil
    zero = float(record.distance[0] - record.channel[0] * record.channel_spacing)
    x0, slope = rough.x_of_channel[0], rough.x_of_channel[1] / record.channel_spacing
    y, z = np.median(route[:, 1:], axis=0).tolist()
    return Coil(zero + channel * record.channel_spacing, length, x0 - slope * zero, slope, y, z)


def along_road(
    record: DASRecord,
    passes: Sequence[Pass],
    found: Sequence[Found],
    anchors: Sequence[Anchor],
    warnings: list[str],
) -> FirstRoutes:
    """Join the sections of a long road; the other side is tried only where the widths leave it open."""
    chosen, other, evidence = sides_of(found)
    channel, route = joined(found, chosen)
    active = int(channel[0]), int(channel[-1])
    used, disputed = agreeing(anchors, record, passes, active, (channel, route[:, 0]), warnings)
    if nothing := silent(record, channel[[0, -1]]):
        warnings.append(nothing)
    gaps = np.flatnonzero(np.diff(channel) > 1)
    for gap in gaps:
        warnings.append(
            f"no vehicle is recorded between channels {channel[gap]} and {channel[gap + 1]}; the route there follows "
            "from the rest alone"
        )
    routes = [route] if used or evidence > TOLD * len(found) else [route, joined(found, other)[1]]
    return FirstRoutes(channel, routes, used, disputed, sections=found)
