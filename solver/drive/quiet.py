"""The record of a drive at a low rate, whitened, in units of each channel's noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.lowpass import Lowpass, taps_of
from solver.survey.das.opened import Raw
from solver.survey.das.reader import record_from
from solver.survey.das.record import DASRecord
from solver.survey.das.store import Store
from vision.contract import InputError
from vision.contract.statements import Statements

Array = NDArray[np.float64]
Times = Sequence[tuple[np.datetime64, np.datetime64]]

#: Hz, or a little above. At 20 m/s a gauge of 8 m hears hardly anything beyond 3 Hz.
RATE = 6.0
#: Coefficients of the autoregression that whitens.
ORDER = 6
#: Noise is estimated from samples within this many of its standard deviations.
CLIP = 3.0
#: Channels at once, and channels that the autoregression is estimated from.
SOME, ASKED = 256, 200
MAD = 1.4826


@dataclass(frozen=True)
class Quiet:
    """A whitened record.

    Parameters
    ----------
    values : [channel, time], in noise sigmas, single precision; 0 where nothing was measured
    start : of the record, UTC
    rate : Hz
    whitener : taps [lag] of the filter that whitened it
    channel, distance : [channel]; number, and m along the cable
    dead : [channel], no signal
    noise : [channel], 1/s, after whitening
    gauge_length, channel_spacing : m
    files, sha256 : that it was read from
    cautions, statements : as of `solver.survey.das.record.DASRecord`
    """

    values: NDArray[np.float32]
    start: np.datetime64
    rate: float
    whitener: Array
    channel: NDArray[np.int64]
    distance: Array
    dead: NDArray[np.bool_]
    noise: Array
    gauge_length: float
    channel_spacing: float
    files: tuple[str, ...]
    sha256: tuple[str, ...]
    cautions: tuple[str, ...]
    statements: tuple[Statements, ...]

    @property
    def time(self) -> Array:
        """Of the samples, s since `start` [time]."""
        return np.arange(self.values.shape[1]) / self.rate

    @property
    def end(self) -> np.datetime64:
        """Time of the last sample, UTC."""
        return self.start + np.timedelta64(round(1e9 * (self.values.shape[1] - 1) / self.rate), "ns")


def slow_record(source: Raw | Store, times: Times) -> DASRecord:
    """Read a record at `RATE`; a store some channels at a time, as it is kept at a higher rate."""
    if isinstance(source, Raw):
        return record_from(source.known, times=times, rate=RATE)
    first, last = source.channels
    parts = []
    for low in range(first, last + 1, SOME):
        parts.append(slower(source.record(channels=(low, min(low + SOME - 1, last)), times=times)))
    one = parts[0]
    return DASRecord(
        **vars(one)
        | {
            "strain_rate": np.concatenate([part.strain_rate for part in parts], axis=1),
            "distance": np.concatenate([part.distance for part in parts]),
            "channel": np.concatenate([part.channel for part in parts]),
            "rounding": None,
        }
    )


def slower(record: DASRecord) -> DASRecord:
    """A record at `RATE` or a little above."""
    factor = max(1, int(record.sampling_rate // RATE))
    if factor == 1:
        return record
    low = Lowpass(taps_of(factor), factor, np.float32)
    count = (len(record.time) - len(low.taps)) // factor + 1
    if count < 2:
        return record
    first = record.time[low.half]
    rate = np.empty((count, len(record.channel)), np.float32)
    rate[:] = low(np.asarray(record.strain_rate, np.float32), 0, count)
    return DASRecord(
        **vars(record)
        | {
            "strain_rate": rate,
            "time": np.arange(count) * factor / record.sampling_rate,
            "start": record.start + np.timedelta64(round(1e9 * first), "ns"),
            "sampling_rate": record.sampling_rate / factor,
        }
    )


def whitened(record: DASRecord) -> Quiet:
    """Take out what all channels have in common, whiten in time, and divide by each channel's noise.

    Raises
    ------
    InputError
        If no channel holds a signal.
    """
    from scipy.signal import lfilter

    rate = record.strain_rate
    level, dead = levels(rate)
    if dead.all():
        raise InputError("das: no channel holds a signal during the drive")
    alive = np.flatnonzero(~dead)
    common = common_of(rate, level, alive)
    asked = alive[:: max(1, len(alive) // ASKED)]
    taps = whitener((rate[:, asked] / level[asked]).astype(np.float64) - common[:, None])
    values = np.zeros((rate.shape[1], rate.shape[0]), np.float32)
    noise = np.full(rate.shape[1], np.nan)
    for first in range(0, rate.shape[1], SOME):
        part = slice(first, min(first + SOME, rate.shape[1]))
        live = ~dead[part]
        some = (rate[:, part] / np.where(live, level[part], 1.0)).T - common.astype(np.float32)
        some[~live] = 0.0
        white = lfilter(taps.astype(np.float32), [1.0], np.nan_to_num(some, nan=0.0, posinf=0.0, neginf=0.0), axis=1)
        white[:, : len(taps)] = 0.0
        scale = MAD * np.median(np.abs(white[:, :: max(1, white.shape[1] // 4000)]), axis=1)
        scale = np.where(live & (scale > 0), scale, 1.0)
        values[part] = np.where(live[:, None], white / scale[:, None], 0.0)
        noise[part] = np.where(live, scale * level[part], np.nan)
    values[:, ~np.isfinite(rate[:, alive[0]])] = 0.0
    return Quiet(
        values=values,
        start=record.start,
        rate=record.sampling_rate,
        whitener=taps,
        channel=record.channel,
        distance=np.asarray(record.distance, float),
        dead=dead,
        noise=noise,
        gauge_length=record.gauge_length,
        channel_spacing=record.channel_spacing,
        files=tuple(str(one) for one in record.provenance["files"]),
        sha256=tuple(str(one) for one in record.provenance["sha256"]),
        cautions=record.cautions,
        statements=record.statements,
    )


def levels(rate: NDArray[Any]) -> tuple[Array, NDArray[np.bool_]]:
    """Noise [channel], 1/s, of a record [time, channel], and which channels measure nothing."""
    step = max(1, len(rate) // 4000)
    level = np.zeros(rate.shape[1])
    rows = step * np.flatnonzero(np.isfinite(rate[::step]).any(axis=1))
    for first in range(0, len(level), SOME):
        some = rate[rows, first : first + SOME].astype(np.float64)
        level[first : first + SOME] = MAD * np.median(np.abs(np.nan_to_num(some)), axis=0)
    alive = np.isfinite(level) & (level > 0)
    return np.where(alive, level, 1.0), ~alive


def common_of(rate: NDArray[Any], level: Array, alive: NDArray[np.int64]) -> Array:
    """What all channels have in common [time], in sigmas: the median over channels."""
    common = np.zeros(len(rate))
    for first in range(0, len(rate), 1024):
        part = slice(first, first + 1024)
        common[part] = np.median(np.nan_to_num(rate[part, alive] / level[alive]), axis=1)
    return common


def whitener(values: Array) -> Array:
    """Taps [lag] of the filter that whitens values [time, channel]: an autoregression (Yule and Walker)."""
    from scipy.linalg import solve_toeplitz

    clipped = np.clip(np.nan_to_num(values), -CLIP, CLIP)
    count = len(clipped)
    lags = np.array([float((clipped[lag:] * clipped[: count - lag]).sum()) for lag in range(ORDER + 1)])
    lags[0] *= 1 + 1e-6
    return np.concatenate([[1.0], -solve_toeplitz(lags[:-1], lags[1:])])
