"""A DAS record: strain rate on a regular grid of time and channel."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.rounding import Rounding
from solver.survey.das.time_windows import stretches
from vision.contract.statements import Statements

Array = NDArray[np.float64]

#: How many gaps are told one by one.
NAMED = 3


@dataclass(frozen=True)
class Extent:
    """Extent of the files of a record: first and last time, UTC, and first and last channel."""

    start: np.datetime64
    end: np.datetime64
    channels: tuple[int, int]


@dataclass(frozen=True)
class DASRecord:
    """Strain rate along the fiber.

    Parameters
    ----------
    strain_rate : [time, channel], 1/s; NaN = not measured, or not read: rows in a gap between files, dead or excluded
        channels; in single precision where it was read
    time : s since `start` [time], regular, gaps included; where only some times were read, it jumps from one window to
        the next, with empty rows on both sides (`solver.survey.das.time_windows`)
    start : UTC, datetime64[ns]
    distance : m along the fiber [channel]
    channel : number of each channel as the file counts; anchors refer to it [channel]
    gauge_length, channel_spacing : m
    sampling_rate : Hz
    gaps : (first, last) time of the missing samples of each gap, s
    provenance : files, checksums, format, original unit, scale and notes
    rounding : of the stored numbers; None if they were not rounded
    cautions : what the user should know about the record, a line each
    extent : of the files, if only a part of them was read; None: all was read
    statements : what each file that was read states, and what is taken of it
    """

    strain_rate: Array
    time: Array
    start: np.datetime64
    distance: Array
    channel: NDArray[np.int64]
    gauge_length: float
    channel_spacing: float
    sampling_rate: float
    gaps: tuple[tuple[float, float], ...]
    provenance: dict[str, Any]
    rounding: Rounding | None = None
    cautions: tuple[str, ...] = ()
    extent: "Extent | None" = None
    statements: tuple[Statements, ...] = ()

    @property
    def recorded(self) -> "Extent":
        """The extent of the files, however much was read."""
        end = self.start + np.timedelta64(round(float(self.time[-1]) * 1e9), "ns")
        return self.extent or Extent(self.start, end, (int(self.channel[0]), int(self.channel[-1])))

    @property
    def windows(self) -> list[slice]:
        """Rows between jumps of time."""
        return stretches(self.time, self.sampling_rate)

    @property
    def row_time(self) -> Array:
        """Time that passes while rows do, s [time]: without the jumps of `time`."""
        return np.arange(len(self.time)) / self.sampling_rate

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Where a row has samples [time]; false in gaps."""
        return np.asarray(np.isfinite(self.strain_rate).any(axis=1))

    @cached_property
    def dead(self) -> NDArray[np.bool_]:
        """Where a channel has no samples [channel]: excluded, or constant in the file."""
        return np.asarray(~np.isfinite(self.strain_rate).any(axis=0))


def channel_ranges(numbers: NDArray[np.int64]) -> str:
    """Write sorted channel numbers as ranges.

    >>> channel_ranges(np.array([3, 4, 5, 9])), channel_ranges(np.array([9]))
    ('channels 3-5, 9', 'channel 9')
    """
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    listed = ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
    return f"channel{'s' * (len(numbers) > 1)} {listed}"


def gap_line(start: np.datetime64, first: float, last: float, interval: float) -> str:
    """Say when a record has no samples: the first and last missing one, s after `start`, and their interval, s.

    >>> gap_line(np.datetime64("2025-08-11T06:00:00", "ns"), 128.0, 727.8, 0.2)
    'the record has a gap of 10 min 0 s, from 2025-08-11T06:02:08Z to 06:12:08Z; what lies on either side is used'
    """
    ends = start + np.round(np.array([first, last + interval]) * 1e9).astype("timedelta64[ns]")
    begin, end = np.datetime_as_string(ends, unit="s")
    minutes, seconds = divmod(last - first + interval, 60)
    length = f"{minutes:.0f} min {seconds:.0f} s" if minutes else f"{seconds:.1f} s"
    end = end.partition("T")[2] if end[:10] == begin[:10] else end
    return f"the record has a gap of {length}, from {begin}Z to {end}Z; what lies on either side is used"


def gap_lines(start: np.datetime64, gaps: Sequence[tuple[float, float]], interval: float) -> list[str]:
    """`gap_line` of the longest gaps, and how many others there are."""
    longest = sorted(sorted(gaps, key=lambda gap: gap[0] - gap[1])[:NAMED])
    lines = [gap_line(start, *gap, interval) for gap in longest]
    if len(gaps) > NAMED:
        seconds = sum(last - first + interval for first, last in gaps)
        lines.append(f"these are the longest of {len(gaps)} gaps, {seconds:.1f} s in all")
    return lines


def filled_line(channel: NDArray[np.int64]) -> list[str]:
    """Say that some channels [channel] were not measured all the time; nothing where there are none.

    >>> filled_line(np.array([4, 5]))[0][:64]
    'no number, one and the same, or a straight line for a while on c'
    """
    if not len(channel):
        return []
    left = "nothing was measured there then, and that is left out"
    return [f"no number, one and the same, or a straight line for a while on {channel_ranges(channel)}: {left}"]


def unmeasured_line(lost: Sequence[tuple[int, int]], interval: float) -> list[str]:
    """Say how much of a record was written without being measured; nothing if none was.

    >>> unmeasured_line([(100, 114), (210, 224)], 0.2)[0][:72]
    'in 30 samples (6.0 s) all channels hold one number, or one and the same '
    """
    rows = sum(last - first + 1 for first, last in lost)
    if not rows:
        return []
    return [
        f"in {rows} samples ({rows * interval:.1f} s) all channels hold one number, or one and the same row again: "
        "nothing was measured then, so these are gaps"
    ]
