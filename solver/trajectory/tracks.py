"""The trajectory table taken apart: one track per drive of one vehicle, ready to be smoothed."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.contract import WHEELBASE

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

MINIMUM_FIXES = 3
MINIMUM_TRAVEL = 5.0  # m; less is a parked vehicle
SCATTER = 8.0  # sigma; so far do the fixes of a parked one spread
LONGEST_GAP = 20.0  # s between fixes; after it the vehicle comes by anew
MARGIN = 60.0  # s; fixes so long before and after the record still tell how the vehicle goes by
STANDING = 2.0  # m; a vehicle that stays this near to where its track begins or ends stands there
REST = 5.0  # s of standing that are kept
TURN = 10.0  # m back along the road; after it the vehicle comes by anew


@dataclass(frozen=True)
class Track:
    """The fixes of one vehicle.

    Parameters
    ----------
    track_id, vehicle_class : as in the trajectory table
    time : s since the start of the record [fix]
    value, sigma : position and its standard deviation, m [fix, axis]
    length : of the vehicle, m, where the table says it
    wheelbase : of the vehicle and its standard deviation, m, where the table says them
    """

    track_id: str
    vehicle_class: str
    time: Array
    value: Array
    sigma: Array
    length: float | None = None
    wheelbase: tuple[float, float] | None = None


def tracks_of(table: "pd.DataFrame", start: np.datetime64) -> Iterator[Track]:
    """Yield the tracks of a trajectory table, with times in seconds since `start`, UTC."""
    import pandas as pd

    for track_id, fixes in table.sort_values("time").groupby("track_id", sort=False):
        elapsed = (fixes["time"] - pd.Timestamp(start, tz="UTC")).dt.as_unit("ns")
        lengths = fixes["length"].dropna() if "length" in fixes else fixes["x"].iloc[:0]
        yield Track(
            track_id=str(track_id),
            vehicle_class=str(fixes["class"].mode().iloc[0]),
            time=np.asarray(elapsed.astype(np.int64), np.float64) * 1e-9,
            value=fixes[["x", "y"]].to_numpy(float),
            sigma=fixes[["sigma_x", "sigma_y"]].to_numpy(float),
            length=float(lengths.median()) if len(lengths) else None,
            wheelbase=wheelbase_of(fixes),
        )


def wheelbase_of(fixes: "pd.DataFrame") -> tuple[float, float] | None:
    """Return what the fixes of a track say of its wheelbase, and its standard deviation, m; None where they do not.

    >>> import pandas as pd
    >>> wheelbase_of(pd.DataFrame({"wheelbase": [2.8, None], "sigma_wheelbase": [0.06, None]}))
    (2.8, 0.06)
    """
    if any(name not in fixes for name in WHEELBASE):
        return None
    known = fixes[[*WHEELBASE]].dropna()
    return (float(known.iloc[:, 0].median()), float(known.iloc[:, 1].median())) if len(known) else None


def part_of(track: Track, fixes: slice, track_id: str | None = None) -> Track:
    """Return a track of some of the fixes."""
    return replace(
        track,
        track_id=track_id or track.track_id,
        time=track.time[fixes],
        value=track.value[fixes],
        sigma=track.sigma[fixes],
    )


def numbered(track_id: str, index: int) -> str:
    """Name the parts of a track: `7`, `7#2`, `7#3`."""
    return track_id if index == 0 else f"{track_id}#{index + 1}"


def unbroken(track: Track) -> list[Track]:
    """Split a track where it has no fix for `LONGEST_GAP`."""
    cuts = [0, *(np.flatnonzero(np.diff(track.time) > LONGEST_GAP) + 1), len(track.time)]
    return [
        part_of(track, slice(begin, end), numbered(track.track_id, index))
        for index, (begin, end) in enumerate(pairwise(cuts))
    ]


def during(track: Track, end: float) -> Track | None:
    """Return the fixes from `MARGIN` before the record to `MARGIN` after its `end`, s; None where there are none."""
    begin, stop = np.searchsorted(track.time, [-MARGIN, end + MARGIN])
    return part_of(track, slice(int(begin), int(stop))) if stop > begin else None


def moves(track: Track) -> bool:
    """Tell whether a track has enough fixes, and travel beyond their scatter, to be of a moving vehicle."""
    if len(track.time) < MINIMUM_FIXES:
        return False
    scatter = SCATTER * np.hypot(*np.median(track.sigma, axis=0))
    return bool(np.hypot(*np.ptp(track.value, axis=0)) >= max(MINIMUM_TRAVEL, scatter))


def driven(track: Track) -> Track:
    """Drop the fixes of a vehicle that stands before it sets out or after it arrives, but for `REST` seconds.

    >>> time = np.arange(100.0)
    >>> x = np.clip(10 * (time - 60), 0, 200)
    >>> still = Track("1", "car", time, np.stack([x, 0 * x], -1), np.full((100, 2), 0.1))
    >>> driven(still).time[[0, -1]].tolist()
    [56.0, 84.0]
    """
    reach = np.maximum(STANDING, SCATTER * np.median(track.sigma))
    away = [np.hypot(*(track.value - track.value[end]).T) > reach for end in (0, -1)]
    if not (away[0].any() and away[1].any()):
        return track
    leaves, arrives = int(away[0].argmax()), len(track.time) - 1 - int(away[1][::-1].argmax())
    begin = np.searchsorted(track.time, track.time[leaves] - REST)
    end = np.searchsorted(track.time, track.time[arrives] + REST, side="right")
    return part_of(track, slice(int(begin), int(end)))


def turns(x: Array) -> list[int]:
    """Return the indices where `x` [row], m, turns back by more than `TURN`.

    >>> turns(np.array([0.0, 20.0, 40.0, 35.0, 45.0, 20.0, 0.0]))
    [4]
    """
    found, extreme, direction = list[int](), 0, 0
    for index, value in enumerate(x):
        ahead = value - x[extreme]
        if direction == 0 and abs(ahead) > TURN:
            extreme, direction = index, int(np.sign(ahead))
        elif direction * ahead > 0:
            extreme = index
        elif direction * ahead < -TURN:
            found.append(extreme)
            extreme, direction = index, -direction
    return found
