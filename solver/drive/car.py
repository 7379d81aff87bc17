"""The GPS car: its fixes smoothed, and where it was at any time by the record's clock."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.trajectory.kalman import GATE, Fixes, Smoothed, between, smooth
from solver.trajectory.passes import likeliest, padded
from solver.trajectory.tracks import MINIMUM_FIXES, Track, track_of
from vision.contract import InputError

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

#: Between fixes farther apart than this, s, nobody knows where the car was.
UNKNOWN = 8.0
#: m of travel without which there is no drive.
TRAVEL = 100.0
#: Rounds in which wrong fixes are left out.
ROUNDS = 3


@dataclass(frozen=True)
class Car:
    """A car that drove along the fiber.

    Parameters
    ----------
    vehicle_class : as in the trajectory table
    time : of the fixes that are used, s since the start of the record, by the GPS [fix]
    smoothed, model : as `solver.trajectory.kalman.smooth` made and took them
    sigma : of a fix along each axis, m, as stated
    left_out : fixes that are wrong
    """

    vehicle_class: str
    time: Array
    smoothed: Smoothed
    model: tuple[Array, Array]
    sigma: float
    left_out: int

    @property
    def memory(self) -> float:
        """Time over which errors of the fixes are correlated, s."""
        return float(np.median(self.model[1]))

    def at(self, time: Array) -> "Driven":
        """Where the car was at times, s by the GPS [row], in any order."""
        inside = np.clip(time, self.time[0], self.time[-1])
        mean, covariance = between(self.smoothed, 0, self.time, inside, self.model[0][0], self.model[1][0])
        after = np.clip(np.searchsorted(self.time, inside), 1, len(self.time) - 1)
        known = (time >= self.time[0]) & (time <= self.time[-1])
        known &= (self.time[after] - self.time[after - 1]) < UNKNOWN
        sigma = np.sqrt(np.maximum(covariance[:, :, 0, 0], 1e-6))
        return Driven(mean[:, :, 0], mean[:, :, 1] * known[:, None], sigma, known)


@dataclass(frozen=True)
class Driven:
    """Where the car was: position, velocity and sigma [row, 2], m and m/s, and whether that is known [row]."""

    position: Array
    velocity: Array
    sigma: Array
    known: NDArray[np.bool_]

    @property
    def speed(self) -> Array:
        """m/s [row]."""
        return np.hypot(*self.velocity.T)


def smoothed_car(track: Track) -> Car:
    """Smooth the fixes of a drive; those that the smoothed drive is far from are left out."""
    kept = np.ones(len(track.time), bool)
    for _ in range(ROUNDS):
        part = Track(track.track_id, track.vehicle_class, track.time[kept], track.value[kept], track.sigma[kept])
        fixes: Fixes = padded([part])
        model = likeliest(fixes, np.array([np.median(np.diff(part.time))]))
        smoothed = smooth(fixes, *model)
        place, _ = between(
            smoothed, 0, part.time, np.clip(track.time, part.time[0], part.time[-1]), *(m[0] for m in model)
        )
        off = np.abs(track.value - place[:, :, 0]) / track.sigma
        scale = max(1.0, float(np.median(off[kept])) / 0.6745)
        wrong = (off / scale).max(1) > GATE - 1
        if (wrong == ~kept).all() or wrong.sum() > len(wrong) // 4:
            break
        kept = ~wrong
    return Car(track.vehicle_class, part.time, smoothed, model, float(np.median(track.sigma)), int((~kept).sum()))


def car_of(tracks: "pd.DataFrame", start: np.datetime64) -> Car:
    """The car of a trajectory table: the track that goes farthest, all of its segments together.

    Parameters
    ----------
    tracks : trajectory table
    start : of the record, UTC

    Raises
    ------
    InputError
        If no track goes 100 m.
    """
    import pandas as pd

    # Receivers begin a new segment after each loss of signal: "1", "1/2" ... are one car.
    name = tracks["track_id"].astype(str).str.replace(r"[/#]\d+$", "", regex=True)
    merged = tracks.assign(track_id=name).sort_values("time").drop_duplicates(["track_id", "time"])
    found = [track_of(one, start, str(key)) for key, one in merged.groupby("track_id", sort=False)]
    assert isinstance(merged, pd.DataFrame)
    found = [one for one in found if len(one.time) >= MINIMUM_FIXES]
    way = [float(np.hypot(*np.ptp(one.value, axis=0))) for one in found]
    if not way or max(way) < TRAVEL:
        farthest = max(way, default=0.0)
        raise InputError(
            f"trajectories: no track goes farther than {farthest:.0f} m, and [route] in site.toml says that one car "
            f"drove along the fiber, for {TRAVEL:.0f} m or more; leave [route] out to locate a street"
        )
    return smoothed_car(found[int(np.argmax(way))])
