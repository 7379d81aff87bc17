"""DAS files of any maker -> one record of strain rate on a regular grid of time and channel."""

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

import numpy as np

from solver.survey.das.block import Block
from solver.survey.das.description import Description, Stated, describe, description_of
from solver.survey.das.grid import part_of
from solver.survey.das.lowpass import factor_of
from solver.survey.das.reading import Reading
from solver.survey.das.record import DASRecord, Extent, gap_lines, unmeasured_line
from solver.survey.das.reduced import touched
from solver.survey.das.setting import distance_of, provenance_of
from vision.contract import InputError


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
    gauge_length, channel_spacing : m; override the file's, with a warning if they differ by over 1 %
    quantity : what the numbers are, one of `solver.survey.das.units.QUANTITIES`, where the file does not say
    channels : (first, last) to read, both included; all by default
    exclude : channels to leave out (they stay in the record as NaN)
    scale : stored number -> SI unit of the quantity; overrides the file's unit

    Returns
    -------
    record on a regular time grid. Samples missing between files are NaN rows (`gaps`), so that filters see gaps without
    a special case. Strain and phase are differentiated in time; phase is converted with `strain_per_radian`, raw iDAS
    counts with `strain_rate_per_count`; velocity is differenced over the gauge length.

    Raises
    ------
    InputError
        If no file can be read, no one setting holds for most of the record, much of it overlaps, unit or gauge length
        is missing, channels are out of range or hold NaN, or no channel holds a signal. Single files that are missing,
        damaged or of another setting are left out; the record's cautions say so.
    """
    known = describe(
        files,
        gauge_length=gauge_length,
        channel_spacing=channel_spacing,
        quantity=quantity,
        channels=channels,
        exclude=exclude,
        scale=scale,
    )
    return record_from(known)


def record_of(blocks: Sequence[Block], *, rate: float | None = None, **stated: Unpack[Stated]) -> DASRecord:
    """Join blocks, sorted by time, into one record; `rate` is as in `record_from`."""
    return record_from(description_of([part_of(block) for block in blocks], **stated), rate=rate)


def spans_of(known: Description, times: Sequence[tuple[np.datetime64, np.datetime64]] | None) -> list[tuple[int, int]]:
    """Row ranges (first, one after last) of time spans; all rows if the spans are None or outside the record."""
    whole = (0, known.grid.rows)
    if times is None:
        return [whole]
    ends = [[(one.astype("datetime64[ns]") - known.start).astype(np.int64) for one in span] for span in times]
    found = [(int(np.floor(a / known.grid.interval)), int(np.ceil(b / known.grid.interval)) + 1) for a, b in ends]
    return [(max(a, 0), min(b, whole[1])) for a, b in found if b > 0 and a < whole[1]] or [whole]


def record_from(
    known: Description,
    *,
    channels: tuple[int, int] | None = None,
    times: Sequence[tuple[np.datetime64, np.datetime64]] | None = None,
    rate: float | None = None,
) -> DASRecord:
    """Read a described record, or a part of it.

    Parameters
    ----------
    known : the record
    channels : first and last channel wanted, out of those of `known`; all by default
    times : (start, end) of the spans wanted, UTC, in order; all by default. The record holds a window for each, or for
        several that are near each other, NaN between them
    rate : sampling rate, Hz, to which it is filtered and decimated while it is read, or a little above. None: unchanged

    Returns
    -------
    record : in single precision

    Raises
    ------
    InputError
        As in `read_das`.
    """
    first, last = known.channels if channels is None else channels
    channel, columns = np.arange(first, last + 1), known.columns((first, last))
    excluded = np.isin(channel, known.exclude)
    grid, spans = known.grid, spans_of(known, times)
    factor = 1 if rate is None else factor_of(grid.sampling_rate, rate)
    used = touched(grid, spans)
    if not used:
        raise InputError(f"{known.where}: no samples at the times that are wanted; check the clocks")
    part = Reading(known, channel, columns, excluded, spans)
    found = part.whole() if factor == 1 else part.reduced(factor)
    files = list({one.block.path: one.block for one in used}.values())
    interval, begin = grid.interval * found.factor, found.windows.begin * found.factor
    end = min((found.windows.end - 1) * found.factor + 1, grid.rows)
    holes = [(max(a, begin), min(b, end - 1)) for a, b in grid.without(found.lost) if a < end and b >= begin]
    gaps = tuple(((a - begin) * grid.interval * 1e-9, (b - begin) * grid.interval * 1e-9) for a, b in holes)
    start = grid.time_of(begin)
    said = list(known.lines)
    said += [*unmeasured_line(found.lost, grid.interval * 1e-9), *gap_lines(start, gaps, grid.interval * 1e-9)]
    provenance = provenance_of(files, known.stored, list(known.notes))
    if known.left_out:
        provenance["left_out"] = [f"{one.path.name}: {one.why}" for one in known.left_out]
    if found.factor > 1:
        provenance |= {"decimated": f"from {grid.sampling_rate:g} Hz by {factor}"}
    partly = spans != [(0, grid.rows)] or (first, last) != known.held
    return DASRecord(
        strain_rate=found.values,
        time=(found.windows.grid_rows - found.windows.begin).astype(np.float64) * (interval * 1e-9),
        start=start,
        distance=distance_of(known.blocks[0], channel, known.channel_spacing, known.spaced),
        channel=channel,
        gauge_length=known.gauge_length,
        channel_spacing=known.channel_spacing,
        sampling_rate=1e9 / interval,
        gaps=gaps,
        provenance=provenance,
        rounding=found.rounding,
        cautions=(*said, *found.cautions),
        extent=Extent(known.start, known.end, known.held) if partly else None,
        statements=known.stated({one.block.path for one in used}, found.lost),
    )
