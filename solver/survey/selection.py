"""Which part of a record a survey needs: the channels near the road, and the times around passes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.anchors import Anchor, within_reach
from solver.survey.das.opened import Raw
from solver.survey.das.store import Store

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

#: Time before and after a vehicle is seen, s: it still strains the fiber out of view, and noise is estimated from the
#: quiet time there.
AROUND = np.timedelta64(90, "s")
#: Time spans less than this apart are read as one.
CLOSE = np.timedelta64(120, "s")
#: An anchor farther than this from every track, m, does not tell where the road's channels are.
FAR = 60.0
#: Most fiber per meter of road, and extra fiber, m: coils, and quiet channels beside the road.
SLACK, SPARE = 1.3, 150.0


def times_around(tracks: "pd.DataFrame") -> list[tuple[np.datetime64, np.datetime64]]:
    """Spans of time, UTC, around the vehicles of a trajectory table.

    >>> import pandas as pd
    >>> times = pd.to_datetime(["2025-08-11T06:10:00Z", "2025-08-11T06:10:05Z", "2025-08-11T07:00:00Z"], utc=True)
    >>> for begin, end in times_around(pd.DataFrame({"time": times, "track_id": ["a", "a", "b"]})):
    ...     print(np.datetime_as_string(begin, unit="s"), np.datetime_as_string(end, unit="s"))
    2025-08-11T06:08:30 2025-08-11T06:11:35
    2025-08-11T06:58:30 2025-08-11T07:01:30
    """
    grouped = tracks.groupby("track_id", sort=False)["time"]
    begin = np.sort(grouped.min().dt.tz_convert(None).to_numpy("datetime64[ns]")) - AROUND
    end = np.sort(grouped.max().dt.tz_convert(None).to_numpy("datetime64[ns]")) + AROUND
    # Starts and ends may be sorted separately: a span is open while more have started than ended.
    cuts = np.flatnonzero(begin[1:] - end[:-1] > CLOSE) + 1
    return [(part[0], last[-1]) for part, last in zip(np.split(begin, cuts), np.split(end, cuts), strict=True)]


def near_road(
    held: tuple[int, int], spacing: float, tracks: "pd.DataFrame", anchors: Sequence[Anchor]
) -> tuple[int, int]:
    """First and last channel, out of those `held`, that may lie beside the road.

    The fiber from an anchor beside the road to the farthest vehicle is at most `SLACK` times as long as the distance
    there. Without such an anchor on a channel that is held, all channels may lie there.

    Parameters
    ----------
    held : first and last channel
    spacing : of channels, m
    tracks : trajectory table
    anchors : known points of the fiber

    >>> import pandas as pd
    >>> tracks = pd.DataFrame({"x": [0.0, 100.0], "y": 0.0})
    >>> inside, outside = (Anchor(name, at, 50, 5, 1, 0.1, 0.1) for name, at in (("a", 300), ("b", 1200)))
    >>> near_road((0, 999), 1.0, tracks, [inside, outside]), near_road((0, 999), 1.0, tracks, [outside])
    ((84, 516), (0, 999))
    """
    place = tracks[["x", "y"]].to_numpy(float)
    first, last = held[1], held[0]
    for one in within_reach(anchors, held, spacing):
        way = np.hypot(*(place - (one.x, one.y)).T)
        if way.min(initial=np.inf) > FAR + 5 * one.sigma_xy:
            continue
        reach = (SLACK * float(way.max()) + SPARE) / spacing
        first, last = min(first, int(np.floor(one.channel - reach))), max(last, int(np.ceil(one.channel + reach)))
    first, last = max(first, held[0]), min(last, held[1])
    return (first, last) if first < last else held


def wanted(known: Store | Raw, tracks: "pd.DataFrame | None", anchors: Sequence[Anchor]) -> dict[str, Any]:
    """The part of a record that a survey needs, as arguments of its `record`."""
    if tracks is None or not len(tracks):
        return {}
    times = [(a, b) for a, b in times_around(tracks) if a <= known.end and b >= known.start]
    if not times:
        # The clocks disagree, which the tracks' cautions report: a minute of record is enough for that.
        times = [(known.start, known.start + np.timedelta64(60, "s"))]
    channels = near_road(known.channels, known.channel_spacing, tracks, anchors)
    return {"times": times, "channels": channels}
