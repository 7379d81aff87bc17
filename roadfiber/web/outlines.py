"""Regions that fail as outlines on the maps of a pass."""

import numpy as np
from numpy.typing import NDArray

from roadfiber.web.strain_maps import PassMaps
from solver.criticism.comparison.pass_windows import touches
from solver.criticism.comparison.regions import Region
from solver.run.seen import Seen

Array = NDArray[np.float64]
#: Least height of an outline, s: what is shorter could not be seen.
LEAST = 0.4


def outline(region: Region, run: Seen, maps: PassMaps) -> tuple[Array, Array] | None:
    """Channels and seconds of the corners of a region in a pass, closed; None where it is elsewhere.

    A region at some distance from the vehicle is a band along its path.
    """
    times = touches(region, run, maps.number)
    if times is None:
        return None
    if region.ahead is not None and len((band := along_path(region, run, maps))[0]):
        return band
    left, right = region.channels[0] - 0.5, region.channels[1] + 0.5
    first, last = (one - maps.start for one in times)
    more = max(0.0, LEAST - (last - first)) / 2
    first, last = first - more, last + more
    return np.array([left, right, right, left, left]), np.array([first, first, last, last, first])


def along_path(region: Region, run: Seen, maps: PassMaps) -> tuple[Array, Array]:
    """The band of a region along the vehicle's path."""
    path = maps.path[np.isfinite(maps.path).all(1)]
    if not len(path) or region.ahead is None:
        return np.zeros(0), np.zeros(0)
    forward = 1.0 if path[-1, 0] >= path[0, 0] else -1.0
    low, high = (forward * meters / run.facts["settings"]["channel_spacing"] for meters in region.ahead)
    x = np.concatenate([path[:, 0] + low, path[::-1, 0] + high, path[:1, 0] + low])
    y = np.concatenate([path[:, 1], path[::-1, 1], path[:1, 1]])
    return np.clip(x, maps.channel[0] - 0.5, maps.channel[-1] + 0.5), y


def pass_of(region: Region, run: Seen, misfits: Array) -> int | None:
    """The pass that shows a region best: of those that it touches, the one that fits worst."""
    touched = [number for number in range(len(run.passes)) if touches(region, run, number) is not None]
    return max(touched, key=lambda number: np.nan_to_num(misfits[number])) if touched else None


def window(box: tuple[Array, Array], maps: PassMaps) -> tuple[tuple[float, float], tuple[float, float]]:
    """What to zoom to, to see an outline with what is around it."""
    spans = []
    for values, (low, high) in zip(box, (maps.extent[:2], maps.extent[2:]), strict=True):
        first, last = float(values.min()), float(values.max())
        more = max(0.6 * (last - first), 0.05 * (high - low))
        spans.append((max(low, first - more), min(high, last + more)))
    return spans[0], spans[1]
