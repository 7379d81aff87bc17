"""The trajectory table taken apart: one track per drive of one vehicle, ready to be smoothed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.survey.limits import FASTEST
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
MOST_LEAPS = 5  # one step in so many may be faster than any vehicle: a mistake of the detector
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


def leaps(track: Track) -> NDArray[np.bool_]:
    """Which steps [fix - 1] are longer than any vehicle goes in their time, beyond the scatter of the fixes."""
    step = np.hypot(*np.diff(track.value, axis=0).T)
    scatter = SCATTER * np.hypot(*track.sigma.T)
    return np.asarray(step - np.maximum(scatter[1:], scatter[:-1]) > FASTEST * np.diff(track.time))


def impossible(track: Track) -> bool:
    """Whether no vehicle can have driven a track: several went by its name, or it is in no meters or seconds.

    Between its two halves it is faster than `FASTEST`, or more than one of `MOST_LEAPS` steps is.

    >>> time = np.arange(50) / 10
    >>> car = Track("1", "car", time, np.stack([15 * time, 0 * time], -1), np.full((50, 2), 0.1))
    >>> impossible(car), impossible(replace(car, value=1000 * car.value)), impossible(replace(car, time=time / 10))
    (False, True, True)
    """
    half = len(track.time) // 2
    if half == 0:
        return False
    way = np.hypot(*(track.value[half:] - track.value[:-half]).T) - SCATTER * np.hypot(*np.median(track.sigma, axis=0))
    speed = np.median(way / (track.time[half:] - track.time[:-half]))
    return bool(speed > FASTEST or MOST_LEAPS * leaps(track).sum() > len(track.time) - 1)


def unbroken(track: Track) -> list[Track]:
    """Split a track where it has no fix for `LONGEST_GAP`, and where it leaps and goes on from there."""
    leap = leaps(track).astype(int)
    # A fix that alone is wrong is a leap there and one back; the smoother bears it.
    alone = (
        (leap == 1) & (np.convolve(leap, np.ones(2 * MINIMUM_FIXES - 1, int), "same") == 1) if len(leap) else leap > 0
    )
    cuts = [0, *(np.flatnonzero((np.diff(track.time) > LONGEST_GAP) | alone) + 1), len(track.time)]
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


def why_still(tracks: Sequence[Track]) -> str:
    """Say why none of some tracks is of a moving vehicle, and how to mend it."""
    many = [track for track in tracks if len(track.time) >= MINIMUM_FIXES]
    if not many:
        return f"no track has {MINIMUM_FIXES} fixes; give all fixes of a vehicle the same track_id"
    travel = [float(np.hypot(*np.ptp(track.value, axis=0))) for track in many]
    if max(travel) < MINIMUM_TRAVEL:
        return f"no track goes farther than {max(travel):.2g} m; check that x and y are in m"
    sigma = float(np.median([np.hypot(*np.median(track.sigma, axis=0)) for track in many]))
    return f"tracks of up to {max(travel):.2g} m are lost in fixes of sigma {sigma:.2g} m; check the sigmas, in m"
