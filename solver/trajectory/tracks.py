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
NAMED = 5  # tracks that a message names


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


def tracks_of(table: "pd.DataFrame", start: np.datetime64, warnings: list[str]) -> Iterator[Track]:
    """Yield the drives of a trajectory table, with times in seconds since `start`, UTC.

    One `track_id` may be of several drives, see `cuts`, and each of those of another vehicle. Where it is, a line is
    added to `warnings`.
    """
    shared = list[str]()
    for track_id, fixes in table.sort_values("time").groupby("track_id", sort=False):
        whole = track_of(fixes, start, str(track_id))
        drives = [
            track_of(fixes.iloc[begin:end], start, numbered(whole.track_id, index))
            for index, (begin, end) in enumerate(pairwise(cuts(whole)))
        ]
        behind, back = begun_anew(whole)
        if behind.any() or (back.any() and len({one.vehicle_class for one in drives}) > 1):
            shared.append(whole.track_id)
        yield from drives
    if shared:
        warnings.append(
            f"trajectories: {named(shared)}: several vehicles have the same track_id, one after the other; they are "
            "told apart by where they drive, but give each its own track_id"
        )


def named(names: Sequence[str]) -> str:
    """The first few of some names.

    >>> named(list("abcdefg"))
    'a, b, c, d, e ...'
    """
    return ", ".join(names[:NAMED]) + (" ..." if len(names) > NAMED else "")


def track_of(fixes: "pd.DataFrame", start: np.datetime64, track_id: str) -> Track:
    """The track of some rows of a trajectory table, in order of time."""
    import pandas as pd

    elapsed = (fixes["time"] - pd.Timestamp(start, tz="UTC")).dt.as_unit("ns")
    lengths = fixes["length"].dropna() if "length" in fixes else fixes["x"].iloc[:0]
    return Track(
        track_id=track_id,
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


def part_of(track: Track, fixes: slice) -> Track:
    """Return a track of some of the fixes."""
    return replace(track, time=track.time[fixes], value=track.value[fixes], sigma=track.sigma[fixes])


def numbered(track_id: str, index: int) -> str:
    """Name the parts of a track: `7`, `7#2`, `7#3`."""
    return track_id if index == 0 else f"{track_id}#{index + 1}"


def leaps(track: Track) -> NDArray[np.bool_]:
    """Which steps [fix - 1] are longer than any vehicle goes in their time, beyond the scatter of the fixes."""
    step = np.hypot(*np.diff(track.value, axis=0).T)
    scatter = SCATTER * np.hypot(*track.sigma.T)
    return np.asarray(step - np.maximum(scatter[1:], scatter[:-1]) > FASTEST * np.diff(track.time))


def too_fast(track: Track) -> bool:
    """Whether no vehicle can have driven a track: several went by its name, or it is in no meters or seconds.

    Between its two halves it is faster than `FASTEST`, or more than one of `MOST_LEAPS` steps is.

    >>> time = np.arange(50) / 10
    >>> car = Track("1", "car", time, np.stack([15 * time, 0 * time], -1), np.full((50, 2), 0.1))
    >>> too_fast(car), too_fast(replace(car, value=1000 * car.value)), too_fast(replace(car, time=time / 10))
    (False, True, True)
    """
    half = len(track.time) // 2
    if half == 0:
        return False
    way = np.hypot(*(track.value[half:] - track.value[:-half]).T) - SCATTER * np.hypot(*np.median(track.sigma, axis=0))
    speed = np.median(way / (track.time[half:] - track.time[:-half]))
    return bool(speed > FASTEST or MOST_LEAPS * leaps(track).sum() > len(track.time) - 1)


def to_and_fro(track: Track) -> bool:
    """Whether fixes of several vehicles take turns in a track: it turns within too few fixes to be driven, and often.

    >>> time = np.arange(40.0)
    >>> x = 10 * time - 40 * (time % 2)
    >>> to_and_fro(Track("1", "car", time, np.stack([x, 0 * x], -1), np.full((40, 2), 0.5)))
    True
    """
    least = max(TURN, SCATTER * float(np.median(track.sigma)))
    short = np.diff(turns(track.value[:, 0], least)) < MINIMUM_FIXES
    return bool(MOST_LEAPS * short.sum() > len(track.time) - 1)


def begun_anew(track: Track) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """In which steps [fix - 1] a vehicle is back behind the place it had reached, and in which it has turned unseen.

    Back behind, going the same way as before, without a fix on the way there, it is another vehicle.

    >>> time = np.arange(20.0)
    >>> twice = Track("1", "car", time, np.stack([10 * (time % 10), 0 * time], -1), np.full((20, 2), 0.1))
    >>> [np.flatnonzero(one).tolist() for one in begun_anew(twice)]
    [[9], []]
    """
    x, some = track.value[:, 0], MINIMUM_FIXES
    behind, back = (np.zeros(max(len(x) - 1, 0), bool) for _ in range(2))
    if len(x) < 2 * some:
        return behind, back
    each = np.lib.stride_tricks.sliding_window_view(x, some)
    before, after = each[:-some], each[some:]
    scatter = SCATTER * np.median(track.sigma)
    first, then = before[:, -1] - before[:, 0], after[:, -1] - after[:, 0]
    way, far = np.sign(first), np.sign(first)[:, None] * after
    step = way * (before[:, -1] - after[:, 0])
    inner = slice(some - 1, len(x) - some)
    beyond = (far.max(1) < (way[:, None] * before).min(1)) & (step > max(TURN, scatter))
    behind[inner] = (way == np.sign(then)) & beyond
    gap = np.diff(track.time)
    unseen = (gap > some * np.median(gap))[inner]
    back[inner] = (way == -np.sign(then)) & (np.minimum(np.abs(first), np.abs(then)) > scatter) & unseen
    return behind, back


def cuts(track: Track) -> list[int]:
    """Fixes at which the drives of a track begin, and its end.

    It is cut where it has no fix for `LONGEST_GAP`, where it leaps and goes on from there, and where it begins anew.
    """
    leap = leaps(track).astype(int)
    # A fix that alone is wrong is a leap there and one back; the smoother bears it.
    beside = (
        np.convolve(leap, np.ones(2 * MINIMUM_FIXES - 1, int))[MINIMUM_FIXES - 1 :][: len(leap)] if len(leap) else leap
    )
    alone = (leap == 1) & (beside == 1)
    apart = (np.diff(track.time) > LONGEST_GAP) | alone | np.logical_or(*begun_anew(track))
    return [0, *(np.flatnonzero(apart) + 1).tolist(), len(track.time)]


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


def turns(x: Array, least: float = TURN) -> list[int]:
    """Return the indices where `x` [row], m, turns back by more than `least`.

    >>> turns(np.array([0.0, 20.0, 40.0, 35.0, 45.0, 20.0, 0.0]))
    [4]
    """
    found, extreme, direction = list[int](), 0, 0
    for index, value in enumerate(x):
        ahead = value - x[extreme]
        if direction == 0 and abs(ahead) > least:
            extreme, direction = index, int(np.sign(ahead))
        elif direction * ahead > 0:
            extreme = index
        elif direction * ahead < -least:
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
