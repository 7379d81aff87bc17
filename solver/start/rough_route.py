"""A rough route of what the matched filter saw."""

from collections.abc import Sequence

import numpy as np

from solver.start.initialization import Initialization
from solver.survey.anchors import Anchor
from solver.survey.das.record import DASRecord, channel_ranges
from solver.survey.dead_channels import recording, repeating
from solver.trajectory.vehicle_pass import Pass

#: Channels that the noise's law is learned from, in the middle of a long fiber.
TYPICAL = 400

#: An anchor farther along the road from the matched filter's line, m, is around a bend, or wrong.
OFF_LINE = 5.0


def view_of(rough: Initialization, passes: Sequence[Pass]) -> np.ndarray:
    """First and last channel [2] in view, by the matched filter's line."""
    x = np.concatenate([one.position[one.in_view, 0] for one in passes])
    x0, slope = rough.x_of_channel
    return np.asarray(np.sort((np.array([x.min(), x.max()]) - x0) / slope))


def silent(record: DASRecord, ends: np.ndarray) -> str | None:
    """Say which channels between `ends` [2] hold one value most of the time; None where none does."""
    inside = (record.channel >= ends[0]) & (record.channel <= ends[1])
    dead = repeating(record, record.channel[inside])
    if not len(dead):
        return None
    return f"one value most of the time on {channel_ranges(dead)}; the route there depends on their neighbors"


def felt_beyond(record: DASRecord, passes: Sequence[Pass], end: int, farthest: int) -> np.ndarray:
    """Numbers of channels beyond `end`, up to the `farthest`, that record vehicles while these are in view."""
    low, high = sorted((end, farthest))
    channel = record.channel[(record.channel >= low) & (record.channel <= high) & (record.channel != end)]
    return recording(record, channel, np.unique(np.concatenate([one.rows[one.in_view] for one in passes])))


def beyond_words(end: int, loud: np.ndarray, gauge: int) -> str:
    """Say why the fiber is not fitted beyond channel `end`, where the channels `loud` record vehicles in view.

    Within a `gauge`, channels, of the end all that is felt may be what a bend there senses.

    >>> beyond_words(120, np.array([124]), gauge=10)[:68]
    'vehicles are hardly recorded beyond channel 120 (on channel 124), th'
    """
    if len(loud) > gauge:
        return (
            f"vehicles are recorded beyond channel {end}, too ({channel_ranges(loud)}), but not where one line along "
            "the road expects them: the fiber turns or lies coiled there, or the tracks are off; it is not located"
        )
    much, where = ("hardly", f" (on {channel_ranges(loud)})") if len(loud) else ("not", "")
    return (
        f"vehicles are {much} recorded beyond channel {end}{where}, though the view and the record go on: the fiber "
        "leaves the road there, or records nothing; it is not located"
    )


def straight_part(rough: Initialization, passes: Sequence[Pass], gauge: int, recorded: tuple[int, int]) -> slice:
    """Active channels to fit: without the last gauge length where the fiber leaves the road before the view ends.

    A gauge across a sharp bend senses both legs; the end-point difference of the base model does not hold there. Where
    the record ends within a gauge length of the active channels, nothing shows that the fiber leaves.

    Parameters
    ----------
    gauge : gauge length, channels
    recorded : first and last channel of the record
    """
    ends = view_of(rough, passes)
    first, last = max(ends[0], recorded[0] + gauge / 2), min(ends[1], recorded[1] - gauge / 2)
    leaves = (rough.active[0] - first > gauge / 2, last - rough.active[1] > gauge / 2)
    start, stop = gauge * leaves[0], len(rough.channel) - gauge * leaves[1]
    return slice(start, stop) if stop - start > 2 * gauge else slice(None)


def start_route(rough: Initialization, lateral: np.ndarray, anchors: Sequence[Anchor]) -> np.ndarray:
    """Rough route [channel, 3] through the matched filter's line, moved onto the anchors where there are any."""
    route = np.column_stack([rough.route[:, 0], lateral, rough.route[:, 2]])
    if not anchors:
        return route
    at = np.array([a.channel for a in anchors])
    # Lateral position and depth of the anchors are better than any start; x keeps the slope of the line.
    for axis, name in enumerate("yz", 1):
        route[:, axis] = np.interp(rough.channel, at, [getattr(a, name) for a in anchors])
    x0, slope = rough.x_of_channel
    miss = np.array([a.x for a in anchors]) - (x0 + slope * at)
    on_line = np.abs(miss) < OFF_LINE
    if on_line.any():
        route[:, 0] += miss[on_line].mean()
    return route
