"""DAS files of any maker -> one record of strain rate on a regular grid of time and channel."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.das_files import Block, checksum, read_blocks
from solver.units import Unit, across_gauge, resolve, to_strain_rate
from vision.contract import InputError, progress

# A vehicle at 30 m/s moves 6 cm in this time: files whose samples are off the common grid by less are not shifted.
ALIGNED = 2_000_000  # ns
TOLERANCE = 0.01  # between what the file and the user say

logger = logging.getLogger("roadfiber")


@dataclass(frozen=True)
class DASRecord:
    """Strain rate along the fiber.

    Parameters
    ----------
    strain_rate : [time, channel], 1/s; NaN = not measured: rows in a gap between files, dead or excluded channels
    time : s since `start` [time], regular, gaps included
    start : UTC, datetime64[ns]
    distance : m along the fiber [channel]
    channel : number of each channel as the file counts; anchors refer to it [channel]
    gauge_length, channel_spacing : m
    sampling_rate : Hz
    gaps : (first, last) time of the missing samples of each gap, s
    provenance : files, checksums, format, original unit, scale and notes
    """

    strain_rate: NDArray[np.float64]
    time: NDArray[np.float64]
    start: np.datetime64
    distance: NDArray[np.float64]
    channel: NDArray[np.int64]
    gauge_length: float
    channel_spacing: float
    sampling_rate: float
    gaps: tuple[tuple[float, float], ...]
    provenance: dict[str, Any]

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Where a row has samples [time]; false in gaps."""
        return np.isfinite(self.strain_rate).any(axis=1)

    @cached_property
    def dead(self) -> NDArray[np.bool_]:
        """Where a channel has no samples [channel]: excluded, or constant in the file."""
        return ~np.isfinite(self.strain_rate).any(axis=0)


@dataclass(frozen=True)
class Segment:
    """Consecutive samples of one file: values [time, channel], and the time of the first one, ns UTC."""

    path: Path
    values: NDArray[Any]
    start: int


def agreed(name: str, stated: float | None, given: float | None, where: Path, notes: list[str]) -> float:
    """Return the user's value, else the file's; note it where they differ, InputError where neither is there."""
    if given is None and stated is None:
        raise InputError(f"{where}: {name} absent; give {name.replace(' ', '_')} in [das] of site.toml, m")
    if given is None or stated is None:
        return float(stated if given is None else given)
    if abs(given / stated - 1) > TOLERANCE:
        notes.append(f"{name} {given:g} m as given; the file says {stated:g} m")
        logger.warning("%s: %s", where, notes[-1])
    return float(given)


def check_alike(blocks: Sequence[Block]) -> None:
    """Raise InputError where two files cannot be parts of one record."""
    first = blocks[0]
    for block in blocks[1:]:
        for name, ours, theirs in (
            ("channels", first.data.shape[1], block.data.shape[1]),
            ("first channel", first.first_channel, block.first_channel),
            ("unit", first.unit, block.unit),
            ("gauge length", first.gauge_length, block.gauge_length),
        ):
            if ours != theirs:
                raise InputError(
                    f"{block.path}: {name} {theirs}, but {ours} in {first.path.name}; "
                    "give files of one recording with one setting"
                )


def file_spacing(block: Block) -> float | None:
    """Return the spacing of the channels, m, or None where the file does not say it."""
    if block.distance is None or len(block.distance) < 2:
        return None
    steps = np.diff(block.distance)
    spacing = float(np.median(steps))
    if spacing <= 0 or np.abs(steps / spacing - 1).max() > TOLERANCE:
        raise InputError(
            f"{block.path}: channels are not evenly spaced; export one stretch of fiber at one spacing"
        )
    return spacing


def file_interval(block: Block) -> float:
    """Return the sampling interval of a file, ns."""
    steps = np.diff(block.time)
    if not len(steps) or steps.min() <= 0:
        raise InputError(f"{block.path}: times do not increase; export the recording again")
    return float(np.median(steps) if steps.max() > 1.5 * np.median(steps) else steps.mean())


def sampling_interval(blocks: Sequence[Block]) -> float:
    """Return the sampling interval of a record, ns.

    The starts of adjoining files say it better than the nominal rate in one file: at 500 Hz a clock that is off by
    1e-5 would lose a sample every 200 s.
    """
    nominal = [file_interval(block) for block in blocks]
    if max(nominal) > min(nominal) * (1 + 1e-3):
        odd = blocks[int(np.argmax(np.abs(np.array(nominal) - np.median(nominal))))]
        raise InputError(
            f"{odd.path}: sampling rates differ between files ({1e9 / max(nominal):g} and {1e9 / min(nominal):g} Hz); "
            "give files of one recording"
        )
    interval = float(np.median(nominal))
    lengths = np.array([len(block.time) for block in blocks[:-1]])
    steps = np.diff([block.time[0] for block in blocks])
    adjoining = np.abs(steps - lengths * interval) < interval / 2
    return float(steps[adjoining].sum() / lengths[adjoining].sum()) if adjoining.any() else interval


def segments_of(block: Block, values: NDArray[np.float64], interval: float) -> list[Segment]:
    """Split the values of a file where its times jump."""
    cuts = np.flatnonzero(np.diff(block.time) > 1.5 * interval) + 1
    starts = [0, *cuts]
    return [
        Segment(block.path, part, int(block.time[at]))
        for at, part in zip(starts, np.split(values, cuts), strict=True)
    ]


def on_grid(segment: Segment, origin: int, interval: float) -> tuple[int, NDArray[np.float64]]:
    """Return the first row of a segment on the grid and its values there.

    Values off the grid by more than `ALIGNED` are moved onto it along a cubic spline.
    """
    from scipy.interpolate import CubicSpline

    position = (segment.start - origin) / interval
    row, count = round(position), len(segment.values)
    if abs(position - row) * interval <= ALIGNED or count < 4:
        return row, segment.values
    rows = np.arange(int(np.ceil(position)), int(np.floor(position + count - 1)) + 1)
    spline = CubicSpline(np.arange(count), segment.values, axis=0)
    return int(rows[0]), np.asarray(spline(rows - position))


def assemble(
    segments: Sequence[Segment], interval: float
) -> tuple[NDArray[np.float64], tuple[tuple[float, float], ...]]:
    """Put segments, sorted by time, on one regular grid: (strain rate [time, channel], gaps); NaN in the gaps."""
    origin = segments[0].start
    placed = [on_grid(segment, origin, interval) for segment in segments]
    ends = [row + len(values) for row, values in placed]
    for (row, _), end, before, after in zip(placed[1:], ends, segments, segments[1:], strict=False):
        if row < end:
            raise InputError(f"{after.path}: overlaps {before.path.name} in time; give each recording once")
    if ends[-1] > 20 * sum(len(values) for _, values in placed):
        hours = ends[-1] * interval / 3.6e12
        raise InputError(
            f"{segments[-1].path}: a few minutes spread over {hours:.1f} h; locate each part on its own"
        )
    whole = np.full((ends[-1], placed[0][1].shape[1]), np.nan)
    for row, values in placed:
        whole[row : row + len(values)] = values
    seconds = interval * 1e-9
    gaps = [
        (end * seconds, (row - 1) * seconds)
        for end, (row, _) in zip(ends, placed[1:], strict=False)
        if row > end
    ]
    return whole, tuple(gaps)


def selected(block: Block, channels: tuple[int, int] | None) -> slice:
    """Return the columns of the channels from first to last, both included."""
    first, last = block.first_channel, block.first_channel + block.data.shape[1] - 1
    if channels is None:
        return slice(0, last - first + 1)
    if not first <= channels[0] < channels[1] <= last:
        raise InputError(
            f"{block.path}: channels {list(channels)}, but the file has {first} to {last}; "
            "give [first, last] within them"
        )
    return slice(channels[0] - first, channels[1] - first + 1)


def checked_values(
    block: Block, columns: slice, channel: NDArray[np.int64], exclude: Sequence[int]
) -> NDArray[np.float64]:
    """Return the selected values as float64, excluded channels as 0.

    Raises InputError where others are not finite.
    """
    values = block.data[:, columns].astype(np.float64)
    values[:, np.isin(channel, exclude)] = 0.0
    bad = channel[~np.isfinite(values).all(axis=0)]
    if len(bad):
        names = ", ".join(map(str, bad[:5])) + (" ..." if len(bad) > 5 else "")
        raise InputError(
            f"{block.path}: {len(bad)} of {len(channel)} channels hold NaN or infinite samples ({names}); "
            "set channels = [first, last] or list them in exclude, in [das] of site.toml"
        )
    return values


def without_dead(
    strain_rate: NDArray[np.float64], channel: NDArray[np.int64], exclude: Sequence[int], where: Path
) -> NDArray[np.float64]:
    """Set excluded and constant channels to NaN: what does not move is not measured."""
    spread = np.nanmax(strain_rate, axis=0) - np.nanmin(strain_rate, axis=0)
    constant = (spread == 0) & ~np.isin(channel, exclude)
    if constant.any():
        logger.warning(
            "%s: %d channels are constant, so dead: %s", where, constant.sum(), ranges(channel[constant])
        )
    if (spread == 0).all():
        raise InputError(f"{where}: no channel holds a signal; check channels, exclude and the recording")
    return np.where(spread == 0, np.nan, strain_rate)


def ranges(numbers: NDArray[np.int64]) -> str:
    """Write sorted channel numbers as ranges.

    >>> ranges(np.array([3, 4, 5, 9]))
    '3-5, 9'
    """
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def strain_rate_block(
    block: Block, unit: Unit, spacing: float, gauge_length: float, notes: list[str]
) -> Block:
    """Turn a block of velocity along the fiber into strain rate; any other is returned as it is."""
    from dataclasses import replace

    data, n = across_gauge(block.data.astype(np.float64), spacing, gauge_length)
    distance = None if block.distance is None else block.distance[n:-n]
    return replace(block, data=data, distance=distance, first_channel=block.first_channel + n)


def read_all(files: Sequence[Path]) -> list[Block]:
    """Read every file, sorted by time."""
    if not files:
        raise InputError("no DAS files; give at least one")
    blocks: list[Block] = []
    with progress("reading DAS", len(files)) as advance:
        for path in files:
            blocks += read_blocks(Path(path))
            advance(1)
    return sorted(blocks, key=lambda block: int(block.time[0]))


def read_das(
    files: Sequence[Path],
    *,
    gauge_length: float | None = None,
    channel_spacing: float | None = None,
    quantity: str | None = None,
    channels: tuple[int, int] | None = None,
    exclude: Sequence[int] = (),
    scale: float | None = None,
) -> DASRecord:
    """Read DAS files as one record."""
    blocks = read_all(files)
    check_alike(blocks)
    first, notes = blocks[0], list[str]()
    unit = resolve(first.unit, quantity, scale, str(first.path))
    spacing = agreed("channel spacing", file_spacing(first), channel_spacing, first.path, notes)
    gauge = agreed("gauge length", first.gauge_length, gauge_length, first.path, notes)
    interval = sampling_interval(blocks)
    columns = selected(first, channels)
    channel = first.first_channel + np.arange(first.data.shape[1])[columns]
    parts = [
        Segment(part.path, to_strain_rate(part.values, unit, 1e9 / interval, gauge), part.start)
        for block in blocks
        for part in segments_of(block, checked_values(block, columns, channel, exclude), interval)
    ]
    strain_rate, gaps = assemble(parts, interval)
    strain_rate = without_dead(strain_rate, channel, exclude, first.path)
    distance = channel * spacing if channel_spacing or first.distance is None else first.distance[columns]
    for begin, end in gaps:
        logger.warning("%s: gap of %.3g s at %.3g s", first.path, end - begin + interval * 1e-9, begin)
    return DASRecord(
        strain_rate=strain_rate,
        time=np.arange(len(strain_rate)) * interval * 1e-9,
        start=np.datetime64(int(first.time[0]), "ns"),
        distance=distance,
        channel=channel,
        gauge_length=gauge,
        channel_spacing=spacing,
        sampling_rate=1e9 / interval,
        gaps=gaps,
        provenance={
            "files": [str(block.path) for block in blocks],
            "sha256": [checksum(block.path) for block in blocks],
            "format": first.format,
            "quantity": unit.quantity,
            "original_unit": first.stated,
            "scale": unit.factor,
            "notes": notes,
        },
    )
