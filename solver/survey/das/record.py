"""DAS files of any maker -> one record of strain rate on a regular grid of time and channel."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.das_files import Block, checksum_of, read_blocks
from solver.survey.das.grid import assemble, sampling_interval, segments_of
from solver.survey.das.rounding import Rounding, rounding_of
from solver.survey.das.size import require_room_for_files, require_room_for_record
from solver.survey.das.units import Unit, across_gauge, resolve, to_strain_rate
from solver.survey.das.values import check_size, clipped
from solver.survey.limits import CHANNEL_SPACINGS, GAUGE_LENGTHS
from vision.contract import InputError, progress

Array = NDArray[np.float64]

AT_ONCE = 64  # channels that are converted
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
    rounding : of the stored numbers; None where they were not rounded
    cautions : what the user should know of the record, a line each
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

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Where a row has samples [time]; false in gaps."""
        return np.asarray(np.isfinite(self.strain_rate).any(axis=1))

    @cached_property
    def dead(self) -> NDArray[np.bool_]:
        """Where a channel has no samples [channel]: excluded, or constant in the file."""
        return np.asarray(~np.isfinite(self.strain_rate).any(axis=0))


def ranges(numbers: NDArray[np.int64]) -> str:
    """Write sorted channel numbers as ranges.

    >>> ranges(np.array([3, 4, 5, 9]))
    '3-5, 9'
    """
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def read_all(files: Sequence[Path], whole: bool) -> list[Block]:
    """Read every file; blocks sorted by time. `whole`: all channels are wanted."""
    if not files:
        raise InputError("no DAS files; give at least one")
    require_room_for_files(files, whole)
    blocks = list[Block]()
    with progress("reading DAS", len(files)) as advance:
        for path in files:
            blocks += read_blocks(Path(path))
            advance(1)
    return sorted(blocks, key=lambda block: int(block.time[0]))


def check_alike(blocks: Sequence[Block]) -> None:
    """Raise InputError where two files cannot be parts of one record."""
    first = blocks[0]
    for block in blocks[1:]:
        for name, one, other in (
            ("channels", first.data.shape[1], block.data.shape[1]),
            ("first channel", first.first_channel, block.first_channel),
            ("quantity and scale", first.unit, block.unit),
            ("gauge length", first.gauge_length, block.gauge_length),
            ("channel spacing", file_spacing(first), file_spacing(block)),
        ):
            alike = np.isclose(one, other) if isinstance(one, float) and isinstance(other, float) else one == other
            if not alike:
                raise InputError(
                    f"{block.path}: {name} {other}, but {one} in {first.path.name}; give files of one recording"
                )


def file_spacing(block: Block) -> float | None:
    """Return the spacing of a block's channels, m; None where the file does not say it."""
    if block.distance is None or len(block.distance) < 2:
        return None
    steps = np.diff(block.distance)
    spacing = float(np.median(steps))
    if spacing <= 0 or np.abs(steps / spacing - 1).max() > TOLERANCE:
        raise InputError(f"{block.path}: channels are not evenly spaced; export one stretch of fiber at one spacing")
    return spacing


def agreed(
    name: str, limits: tuple[float, float], stated: float | None, given: float | None, where: Path, notes: list[str]
) -> float:
    """Return what the user gives, else what the file states; note it where they differ.

    Raises
    ------
    InputError
        If neither is there, or no interrogator has such a length.
    """
    key = name.replace(" ", "_")
    length = stated if given is None else given
    if length is None:
        raise InputError(f"{where}: {name} absent; give {key}, m, in [das] of site.toml")
    if not limits[0] <= length <= limits[1]:
        source = "stated" if given is None else "given"
        raise InputError(
            f"{where}: {name} {length:g} m as {source}, but none is below {limits[0]:g} or above {limits[1]:g} m; "
            f"give {key}, m, in [das] of site.toml"
        )
    if given is None:
        return length
    if stated is not None and abs(given / stated - 1) > TOLERANCE:
        notes.append(f"{name} {given:g} m as given; the file states {stated:g} m")
        logger.warning("%s: %s", where, notes[-1])
    return given


def differenced(block: Block, spacing: float, gauge_length: float) -> Block:
    """Turn velocity along the fiber into strain rate; channels without a partner on both sides are left out."""
    data, n = across_gauge(block.data.astype(np.float64), spacing, gauge_length)
    if not data.size:
        raise InputError(f"{block.path}: fewer channels than one gauge length of {gauge_length:g} m; give more fiber")
    distance = None if block.distance is None else block.distance[n:-n]
    return replace(block, data=data, distance=distance, first_channel=block.first_channel + n)


def columns_of(block: Block, channels: tuple[int, int] | None) -> slice:
    """Return the columns of the channels from first to last, both included; all where `channels` is None."""
    first, last = block.first_channel, block.first_channel + block.data.shape[1] - 1
    if channels is None:
        return slice(0, last - first + 1)
    if not first <= channels[0] < channels[1] <= last:
        raise InputError(
            f"{block.path}: no channels {channels[0]} to {channels[1]}; the file has {first} to {last}, "
            "give channels = [first, last] within"
        )
    return slice(channels[0] - first, channels[1] - first + 1)


def checked(block: Block, columns: slice, excluded: NDArray[np.bool_]) -> Array:
    """Return the values of the columns as float64 [time, channel], excluded channels as 0.

    Raises
    ------
    InputError
        If any other sample is NaN or infinite.
    """
    values = block.data[:, columns].astype(np.float64)
    values[:, excluded] = 0.0
    bad = np.flatnonzero(~np.isfinite(values).all(axis=0))
    if len(bad):
        names = ranges(bad + block.first_channel + int(columns.start))
        raise InputError(
            f"{block.path}: NaN or infinite samples in {len(bad)} of {values.shape[1]} channels ({names}); "
            "give channels = [first, last] without them, or exclude = [...], in [das] of site.toml"
        )
    return values


def excluded_of(block: Block, channel: NDArray[np.int64], exclude: Sequence[int]) -> NDArray[np.bool_]:
    """Tell which channels [channel] to leave out; a number that the file does not have is an InputError."""
    first, last = block.first_channel, block.first_channel + block.data.shape[1] - 1
    if unknown := [number for number in exclude if not first <= number <= last]:
        raise InputError(f"{block.path}: no channel {unknown[0]} to exclude; the file has {first} to {last}")
    return np.isin(channel, list(exclude))


def converted(values: Array, unit: Unit, sampling_rate: float, gauge_length: float) -> Array:
    """Convert `values` [time, channel], NaN rows in gaps, in place to strain rate, 1/s; each run between gaps alone."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        span = slice(run[0], run[-1] + 1)
        # A derivative takes ten times the memory of what it is of.
        for first in range(0, values.shape[1], AT_ONCE):
            part = slice(first, first + AT_ONCE)
            values[span, part] = to_strain_rate(values[span, part], unit, sampling_rate, gauge_length)
    return values


def distance_of(block: Block, channel: NDArray[np.int64], spacing: float, given: bool) -> Array:
    """Return the distance along the fiber of each channel, m [channel]; from the spacing where that is `given`."""
    if block.distance is None:
        return channel.astype(np.float64) * spacing
    distance = block.distance[channel - block.first_channel]
    return distance[0] + np.arange(len(channel), dtype=np.float64) * spacing if given else distance


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


def without_dead(strain_rate: Array, channel: NDArray[np.int64], excluded: NDArray[np.bool_], where: Path) -> Array:
    """Set channels that never change to NaN, in place: what does not move is not measured."""
    still = np.nanmax(strain_rate, axis=0) == np.nanmin(strain_rate, axis=0)
    if still.all():
        raise InputError(f"{where}: no channel holds a signal; check channels and exclude in [das] of site.toml")
    check_size((np.nanmax(strain_rate, axis=0) - np.nanmin(strain_rate, axis=0))[~still], where)
    dead = still & ~excluded
    if dead.any():
        logger.warning(
            "%s: %d channels never change, so they are left out: %s", where, dead.sum(), ranges(channel[dead])
        )
    strain_rate[:, still] = np.nan
    return strain_rate


def provenance_of(blocks: Sequence[Block], stored: Unit, notes: list[str]) -> dict[str, Any]:
    """Say where a record comes from and what was done to its numbers."""
    return {
        "files": [str(block.path) for block in blocks],
        "sha256": [checksum_of(block) for block in blocks],
        "format": blocks[0].format,
        "quantity": stored.quantity,
        "unit": blocks[0].stated,
        "scale": stored.factor,
        "notes": notes,
    }


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
    """Read DAS files as one record of strain rate.

    Parameters
    ----------
    files : PRODML, Silixa TDMS or HDF5, Terra15, OptoDAS, Febus, AP Sensing and what else DASCore reads, or numpy
        `.npy` / `.npz` with a `.toml` or `.json` beside it (`solver.survey.das.das_files.SideFile`); in any order
    gauge_length, channel_spacing : m; win over the file's, with a warning where they differ by over 1 %
    quantity : what the numbers are, one of `solver.survey.das.units.QUANTITIES`, where the file does not say
    channels : (first, last) to read, both included; all by default
    exclude : channels to leave out (they stay in the record as NaN)
    scale : stored number -> SI unit of the quantity; wins over the file's unit

    Returns
    -------
    record on a regular grid of time. Samples missing between files are NaN rows (`gaps`), so that a filter needs no
    special case and sees what is missing. Strain and phase are differentiated in time, phase is converted with
    `strain_per_radian`, raw iDAS counts with `strain_rate_per_count`, velocity is differenced over the gauge length.

    Raises
    ------
    InputError
        If a file is missing, damaged or of no known format, files overlap or differ in their setting, unit or gauge
        length are absent, channels are out of range or hold NaN, or no channel holds a signal.
    """
    return record_of(
        read_all(files, channels is None),
        gauge_length=gauge_length,
        channel_spacing=channel_spacing,
        quantity=quantity,
        channels=channels,
        exclude=exclude,
        scale=scale,
    )


def record_of(
    blocks: Sequence[Block],
    *,
    gauge_length: float | None = None,
    channel_spacing: float | None = None,
    quantity: str | None = None,
    channels: tuple[int, int] | None = None,
    exclude: Sequence[int] = (),
    scale: float | None = None,
) -> DASRecord:
    """Put blocks, sorted by time, together to one record; the rest is as of `read_das`."""
    notes = list[str]()
    check_alike(blocks)
    first = blocks[0]
    whole = np.issubdtype(first.data.dtype, np.integer)
    stored = resolve(first.unit, first.stated, quantity, scale, first.path, whole=whole)
    spacing = agreed("channel spacing", CHANNEL_SPACINGS, file_spacing(first), channel_spacing, first.path, notes)
    gauge = agreed("gauge length", GAUGE_LENGTHS, first.gauge_length, gauge_length, first.path, notes)
    unit = stored
    if stored.quantity == "velocity":
        blocks = [differenced(block, spacing, gauge) for block in blocks]
        gauge = (first.data.shape[1] - blocks[0].data.shape[1]) * spacing
        unit = Unit("strain_rate", stored.factor)
        notes.append(f"strain rate is the difference of velocity over {gauge:g} m, an even number of channels")
        logger.info("%s: %s", first.path, notes[-1])
    interval = sampling_interval(blocks)
    columns = columns_of(blocks[0], channels)
    channel = blocks[0].first_channel + np.arange(columns.start, columns.stop)
    excluded = excluded_of(blocks[0], channel, exclude)
    require_room_for_record(sum(len(block.data) for block in blocks), len(channel), first.path)
    segments = [part for block in blocks for part in segments_of(block, checked(block, columns, excluded), interval)]
    values, gaps = assemble(segments, interval)
    del segments
    start = np.datetime64(int(first.time[0]), "ns")
    cautions = [gap_line(start, *gap, interval * 1e-9) for gap in gaps]
    if cut_off := clipped(values):
        cautions.append(cut_off)
    rounding = rounding_of(values, unit, 1e9 / interval, gauge)
    strain_rate = converted(values, unit, 1e9 / interval, gauge)
    return DASRecord(
        strain_rate=without_dead(strain_rate, channel, excluded, first.path),
        time=np.arange(len(strain_rate), dtype=np.float64) * (interval * 1e-9),
        start=start,
        distance=distance_of(blocks[0], channel, spacing, channel_spacing is not None),
        channel=channel,
        gauge_length=gauge,
        channel_spacing=spacing,
        sampling_rate=1e9 / interval,
        gaps=gaps,
        provenance=provenance_of(blocks, stored, notes),
        rounding=rounding,
        cautions=tuple(cautions),
    )
