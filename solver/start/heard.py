"""Vehicles that the fiber heard, listed in the trajectories or not.

A vehicle at constant speed is a straight line in the matched filter's map of place and time. For every direction, speed
and time of passing the middle the filter's output is averaged along the line; what stands out is a vehicle.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.start.coupling_curve import coupling_curve
from solver.start.detections import FRAME_RATE, THRESHOLD_DB, decibel, excess, mended, snr_maps, thinned
from solver.start.initialization import Initialization, bank_scales
from solver.survey.das.record import DASRecord
from solver.trajectory.vehicle_pass import Pass
from vision.contract import progress

Array = NDArray[Any]

#: Speeds that are tried, m/s: neighbors are a response's width apart at the ends of 100 m.
SPEEDS = np.geomspace(3.0, 40.0, 36)
#: dB of one channel that count at most: one loud channel is no vehicle.
LOUDEST = 40.0
#: Mean dB along a line, and share of its channels over the threshold of detections, from which it is a vehicle.
MEAN, SHARE = 8.0, 0.6
#: Lines within so many seconds of a louder one, the same way, are of the same vehicle.
SAME = 2.0
#: Beside a vehicle, within so many meters of its way and so many dB below it, are its own lobes; the fainter they are,
#: the farther off, by so many meters per dB.
LOBES, FAINTER, FARTHER = 30.0, 5.0, 6.0
#: Largest difference of the clocks that is looked for, s; width of the window that counts pairs; and of a pair.
CLOCKS, WINDOW, PAIR = 20.0, 0.6, 1.5
#: Relative difference of the speeds of a pair.
ALIKE = 0.3


@dataclass(frozen=True)
class Heard:
    """A vehicle that the fiber heard.

    Parameters
    ----------
    time : of passing the middle of the channels, s of the record's rows (`DASRecord.row_time`)
    speed : along x, m/s; negative against +x
    snr_db : mean along its line, dB
    share : of the channels that heard it over 7 dB
    """

    time: float
    speed: float
    snr_db: float
    share: float


@dataclass(frozen=True)
class Paired:
    """What was heard and what was seen.

    Parameters
    ----------
    heard : in the order of time
    seen : number of the pass that each is [heard], -1 where no camera saw it
    middle : time at which each pass goes by the middle of the channels [pass], s, by the clock of the trajectories; NaN
        where it never does
    offset, sigma : of the clocks: heard less seen, s; NaN without pairs
    """

    heard: list[Heard]
    seen: NDArray[np.int64]
    middle: Array
    offset: float
    sigma: float


def middle_times(passes: Sequence[Pass], x: float, time: Array) -> Array:
    """When each pass goes by x, s [pass]; NaN where it never does."""
    found = np.full(len(passes), np.nan)
    for number, one in enumerate(passes):
        place = one.position[:, 0]
        order = np.argsort(place)
        if place.min() <= x <= place.max():
            found[number] = np.interp(x, place[order], time[one.rows][order])
    return found


def lines(snr_db: Array, ahead: Array, way: int, rate: float) -> list[Heard]:
    """What may be vehicles of one direction in a map [frame, channel] of dB, loudest first.

    Parameters
    ----------
    ahead : how far along x from the middle each channel is [channel], m
    way : 1 along +x, -1 against it
    rate : frames per second

    >>> frames, places = np.arange(300)[:, None], np.linspace(-50, 50, 60)
    >>> passing = 20.0 * np.exp(-0.5 * ((places - 12.0 * (frames / 10 - 15)) / 5) ** 2)
    >>> [(round(one.time, 1), round(one.speed)) for one in lines(passing, places, 1, 10.0)]
    [(15.0, 12)]
    >>> lines(passing, places, -1, 10.0)
    []
    """
    count, bounded, loud = len(snr_db), np.clip(snr_db, 0.0, LOUDEST), snr_db > THRESHOLD_DB
    mean, share = np.zeros((2, len(SPEEDS), count))
    frames, columns = np.arange(count), np.arange(len(ahead))
    for row, speed in enumerate(SPEEDS):
        at = frames[:, None] + np.rint(ahead / (way * speed) * rate).astype(int)
        inside = (at >= 0) & (at < count)
        at, total = np.clip(at, 0, count - 1), np.maximum(inside.sum(1), 1)
        mean[row] = (bounded[at, columns] * inside).sum(1) / total
        share[row] = (loud[at, columns] & inside).sum(1) / total
        # Half the line at least must be in the record.
        mean[row, inside.mean(1) < 0.5] = 0.0
    mean[(share < SHARE) | (mean < MEAN)] = 0.0
    found, reach = list[Heard](), round(SAME * rate)
    while mean.max() > 0:
        number, frame = np.unravel_index(mean.argmax(), mean.shape)
        around = mean[:, frame] ** 16
        fast = float((SPEEDS * around).sum() / around.sum())
        found.append(Heard(float(frame) / rate, way * fast, float(mean[number, frame]), float(share[number, frame])))
        mean[:, max(0, frame - reach) : frame + reach + 1] = 0.0
    return found


def without_lobes(found: Sequence[Heard]) -> list[Heard]:
    """Vehicles without the fainter lines that each makes beside itself, in the order of time.

    >>> found = [Heard(20.0, 12.0, 25.0, 1.0), Heard(22.5, 13.0, 15.0, 0.8), Heard(20.5, -12.0, 24.0, 1.0)]
    >>> [(one.time, one.speed) for one in without_lobes(found)]
    [(20.0, 12.0), (20.5, -12.0)]
    """
    kept: list[Heard] = []
    for one in sorted(found, key=lambda one: -one.snr_db):
        less = [louder.snr_db - one.snr_db for louder in kept]
        apart = [abs(one.time - louder.time) * abs(louder.speed) for louder in kept]
        if not any(d > FAINTER and way < LOBES + FARTHER * d for d, way in zip(less, apart, strict=True)):
            kept.append(one)
    return sorted(kept, key=lambda one: one.time)


@dataclass(frozen=True)
class Hearing:
    """The matched filter's maps on the active channels of a rough route.

    Parameters
    ----------
    snr_db : by direction (1 along +x, -1 against it), dB [frame, channel]
    x : of the channels [channel], m, as the rough route has them
    rate : frames per second
    """

    snr_db: Mapping[int, Array]
    x: Array
    rate: float

    @classmethod
    def of(cls, record: DASRecord, rough: Initialization, *, depth: float, poisson_ratio: float) -> "Hearing":
        """Of a whole record; `depth`, m, and `poisson_ratio` are prior means."""
        stride = max(1, int(record.sampling_rate / FRAME_RATE))
        thin, _ = thinned(record.strain_rate, [], stride)
        frames = thin[:]
        curve = coupling_curve("car", depth=depth, gauge_length=record.gauge_length, poisson_ratio=poisson_ratio)
        scales = bank_scales([curve], record.channel_spacing)
        both = snr_maps(mended(frames / excess(frames)), scales, np.asarray(np.isfinite(frames).any(0)))
        x0, slope = rough.x_of_channel
        columns = np.searchsorted(record.channel, rough.channel)
        maps = {way: decibel(both[0 if rough.polarity * way > 0 else 1][:, columns]) for way in (1, -1)}
        return cls(maps, x0 + slope * rough.channel, record.sampling_rate / stride)

    @property
    def middle(self) -> float:
        """Place along x of the middle of the channels, m."""
        return float(self.x.mean())

    def along(self, time: float, speed: float) -> Heard:
        """What is heard along the line of a vehicle at a constant speed, m/s, that passes the middle at a time, s."""
        snr, frame = self.snr_db[1 if speed > 0 else -1], np.rint((time + (self.x - self.middle) / speed) * self.rate)
        inside = (frame >= 0) & (frame < len(snr))
        level = snr[frame[inside].astype(int), np.flatnonzero(inside)]
        if not len(level):
            return Heard(time, speed, 0.0, 0.0)
        mean, share = np.clip(level, 0.0, LOUDEST).mean(), (level > THRESHOLD_DB).mean()
        return Heard(time, speed, float(mean), float(share))

    def vehicles(self) -> list[Heard]:
        """All that were heard, in the order of time."""
        found: list[Heard] = []
        with progress("listening for vehicles", 2) as advance:
            for way in (1, -1):
                found += lines(self.snr_db[way], self.x - self.middle, way, self.rate)
                advance(1)
        return without_lobes(found)


def pair(heard: Sequence[Heard], middle: Array, speed: Array) -> Paired:
    """Match what was heard with what was seen, and tell how far the clocks are apart.

    The offset at which most pairs of one direction agree is taken first; each vehicle is then matched with the nearest.

    Parameters
    ----------
    heard : by time
    middle, speed : when passes go by the middle, s, and how fast along x, m/s [pass]

    >>> heard = [Heard(t, v, 5.0, 1.0) for t, v in ((10.5, 9.0), (20.5, -12.0), (24.0, 14.0), (30.5, 11.0))]
    >>> found = pair(heard, np.array([10.0, 20.0, 30.0]), np.array([9.0, -12.0, 11.0]))
    >>> found.seen.tolist(), round(found.offset, 2)
    ([0, 1, -1, 2], 0.5)
    """
    time, fast = (np.array([getattr(one, name) for one in heard]) for name in ("time", "speed"))
    seen = np.full(len(heard), -1)
    if not len(heard) or not np.isfinite(middle).any():
        return Paired(list(heard), seen, middle, np.nan, np.nan)
    late = time[:, None] - middle
    alike = (np.abs(fast[:, None] - speed) < ALIKE * np.abs(speed)) & np.isfinite(late)
    near = np.sort(late[alike & (np.abs(late) < CLOCKS)])
    if not len(near):
        return Paired(list(heard), seen, middle, np.nan, np.nan)
    count = np.searchsorted(near, near + WINDOW) - np.arange(len(near))
    # Of offsets with as many pairs, the smallest.
    best = max(range(len(near)), key=lambda i: (int(count[i]), -abs(float(near[i]))))
    offset = float(np.median(near[best : best + count[best]]))
    cost = np.where(alike, np.abs(late - offset), np.inf)
    while cost.min() < PAIR:
        which, number = np.unravel_index(cost.argmin(), cost.shape)
        seen[which] = number
        cost[which], cost[:, number] = np.inf, np.inf
    pairs = late[np.flatnonzero(seen >= 0), seen[seen >= 0]]
    offset = float(np.median(pairs))
    spread = 1.4826 * float(np.median(np.abs(pairs - offset)))
    # Frames are tenths of a second; the median's error is 1.25 times the mean's.
    sigma = 1.25 * max(spread, 0.1) / np.sqrt(len(pairs))
    return Paired(list(heard), seen, middle, offset, float(sigma))
