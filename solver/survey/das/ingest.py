"""Ingest record files of any length into a store, part by part; every part is written whole or not at all."""

import csv
import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.block import linked_files
from solver.survey.das.description import Description
from solver.survey.das.grid import Grid, merged
from solver.survey.das.health import PartHealth, joined
from solver.survey.das.lowpass import FIT_RATE, Lowpass, factor_of, taps_of
from solver.survey.das.prodml import write_prodml
from solver.survey.das.reading import Reading
from solver.survey.das.record import filled_line, unmeasured_line
from solver.survey.das.reduced import Lost, Values, filter_of, gain_of, reduce
from solver.survey.das.rounding import rounding_of
from solver.survey.das.setting import distance_of
from solver.survey.das.store import (
    CHANNELS,
    FILE,
    FILES,
    FORMAT,
    Store,
    StoreFile,
    part_name,
    raw_files,
    read_store_file,
)
from solver.survey.das.values import check_size
from solver.survey.das.watch import Watch
from vision.contract import InputError, progress, writing

if TYPE_CHECKING:
    import h5py

#: Size of a part, bytes, and its fewest rows.
BYTES, FEWEST = 32_000_000, 200
#: Folders in which `writing` makes the files of a store, and which a killed run leaves behind.
SCRATCH = (*(f".{name}." for name in (FILE, CHANNELS, FILES)), ".part-")
#: Rows of stored numbers kept to estimate rounding: in all, and at least in each part.
LOOKED_AT, AT_LEAST = 4000, 32


def planned(grid: Grid, low: Lowpass, channels: int) -> list[tuple[int, int]]:
    """Row ranges (first, one after last) of the parts: each without a gap, and not too large.

    Parameters
    ----------
    grid : of the files
    low : the filter; rows that it cannot compute are in no part
    channels : their count
    """
    runs: list[list[int]] = []
    for one in grid.placed:
        if runs and runs[-1][1] == one.row:
            runs[-1][1] = one.stop
        else:
            runs.append([one.row, one.stop])
    most = max(FEWEST, BYTES // (4 * channels))
    parts = []
    for begin, end in runs:
        first, stop = -(-(begin + low.half) // low.factor), (end - 1 - low.half) // low.factor + 1
        parts += [(row, min(row + most, stop)) for row in range(first, stop, most)]
    return parts


def said_of(known: Description, low: Lowpass, files: Sequence[Path], asked: dict[str, Any], folder: Path) -> StoreFile:
    """Description of a store before its parts are written."""
    grid = known.grid
    parts = planned(grid, low, len(known.channel))
    if not parts:
        raise InputError(f"{known.where}: too few samples without a gap to reduce; give a longer record")
    raw = raw_files(files, folder)
    provenance = {
        "files": [os.path.relpath(path.resolve(), folder.resolve()) for path in files],
        "sha256": [one.sha256 for one in raw],
        "format": known.blocks[0].format,
        "quantity": known.stored.quantity,
        "unit": known.blocks[0].stated,
        "scale": known.stored.factor,
        "notes": list(known.notes),
    }
    if low.factor > 1:
        provenance["decimated"] = f"from {grid.sampling_rate:g} Hz by {low.factor}"
    if known.left_out:
        provenance["left_out"] = [f"{one.path.name}: {one.why}" for one in known.left_out]
    used = [path for path, one in zip(files, raw, strict=True) if one.bytes >= 0]
    provenance["files"] = [os.path.relpath(path.resolve(), folder.resolve()) for path in used]
    provenance["sha256"] = [one.sha256 for one in raw if one.bytes >= 0]
    first = distance_of(known.blocks[0], known.channel, known.channel_spacing, known.spaced)[0]
    return StoreFile(
        format=FORMAT,
        files=raw,
        linked=raw_files([one for path in files for one in linked_files(path)], folder),
        asked=asked,
        start=str(known.start),
        interval=grid.interval,
        factor=low.factor,
        rows=parts[-1][1],
        gauge_length=known.gauge_length,
        channel_spacing=known.channel_spacing,
        channels=known.channels,
        first_distance=float(first),
        held=known.held,
        parts=tuple(parts),
        gaps=seconds_of(grid.holes, grid.interval),
        provenance=provenance,
    )


def ingest(
    known: Description, files: Sequence[Path], asked: dict[str, Any], folder: Path, rate: float = FIT_RATE
) -> Store:
    """Write the store of a described record, or continue an unfinished one.

    Parameters
    ----------
    known : the record
    files : all its files
    asked : settings that identify the store as belonging to the survey
    folder : of the store; parts of another record in it are replaced
    rate : sampling rate wanted, Hz, or a little above

    Raises
    ------
    InputError
        If the folder holds something else or cannot be written, or there is nothing to store. Finished parts stay, and
        the next call continues from them.
    """
    low = filter_of(known.grid, factor_of(known.grid.sampling_rate, rate), Reading.all_of(known).stored())
    said = said_of(known, low, files, asked, folder)
    fresh = not folder.exists()
    prepare(folder, said)
    missing = [part for part in said.parts if not (folder / part_name(part)).is_file()]
    with progress("ingesting DAS", len(missing)) as advance:
        for part in missing:
            try:
                write_part(known, low, part, said, folder)
            except InputError:
                if fresh and part == said.parts[0]:
                    shutil.rmtree(folder)
                raise
            advance(1)
    return finish(known, said, folder)


def bare(said: StoreFile) -> StoreFile:
    """What identifies a store: its files and settings, without file times and results."""
    files = tuple(one.model_copy(update={"changed": 0}) for one in said.files)
    found = dict.fromkeys(("gaps", "cautions", "statements", "law"), ()) | {"whole": False, "complete": False}
    return said.model_copy(update={"files": files} | found)


def seconds_of(rows: Sequence[tuple[int, int]], interval: float) -> tuple[tuple[float, float], ...]:
    """First and last row of each gap as s from the first row, at an `interval` in ns."""
    return tuple((first * interval * 1e-9, last * interval * 1e-9) for first, last in rows)


def prepare(folder: Path, said: StoreFile) -> None:
    """Prepare the folder: remove unfinished parts of a killed run, and parts of another record."""
    found = list(folder.iterdir()) if folder.is_dir() else []
    left = [path for path in found if path.is_dir() and path.name.startswith(SCRATCH)]
    strange = len(found) > len(left) and not (folder / FILE).is_file()
    if strange or (folder.exists() and not folder.is_dir()):
        raise InputError(f"{folder}: holds something that is not a store; name another folder with --out")
    same = False
    if (folder / FILE).is_file():
        with suppress(InputError):
            same = bare(read_store_file(folder)) == bare(said)
    kept = {part_name(part) for part in said.parts} if same else set()
    for path in left:
        shutil.rmtree(path, ignore_errors=True)
    for path in found:
        if path.name.startswith("part-") and path.name not in kept:
            path.unlink()
    if not same:
        with writing(folder / FILE) as path:
            path.write_text(said.model_dump_json(indent=1), encoding="utf-8")


def write_part(known: Description, low: Lowpass, rows: tuple[int, int], said: StoreFile, folder: Path) -> None:
    """Read, reduce and write one part."""
    whole, grid = Reading.all_of(known), known.grid
    stored, lost = whole.stored(), Lost()
    rate = np.full((rows[1] - rows[0], len(known.channel)), np.nan, np.float32)
    gain = gain_of(stored, grid.sampling_rate, known.gauge_length)
    looked_at = max(AT_LEAST, LOOKED_AT // len(said.parts))
    watch = Watch(max(1, (rows[1] - rows[0]) * low.factor // looked_at))

    def take(row: int, values: Values) -> None:
        rate[row - rows[0] : row - rows[0] + len(values)] = gain * whole.narrowed(values)

    reduce(grid, whole.columns, low, rows, watch.look, take, lost)
    filled = whole.clear(rate, low.factor * np.arange(*rows), lost, low.half, watch)
    rate[:, whole.excluded] = np.nan
    swing = np.fmax.reduce(rate, axis=0) - np.fmin.reduce(rate, axis=0)
    if (swing > 0).any():
        check_size(swing[swing > 0].astype(np.float64), known.where)
    health = PartHealth.of(watch, rate, lost, whole.columns.stop - whole.columns.start, filled)
    distance = distance_of(known.blocks[0], known.channel, known.channel_spacing, known.spaced)

    def more(file: "h5py.File") -> None:
        add_axes(file["Acquisition/Raw[0]"], distance)
        health.write(file.create_group("Health"))

    write_prodml(
        folder / part_name(rows),
        rate,
        start=grid.time_of(rows[0] * low.factor),
        sampling_rate=grid.sampling_rate / low.factor,
        gauge_length=known.gauge_length,
        channel_spacing=known.channel_spacing,
        first_channel=int(known.channel[0]),
        packed=False,
        more=more,
    )


def add_axes(raw: Any, distance: NDArray[np.float64]) -> None:
    """Declare the axes of a part as netCDF-4 does, so that xarray recognizes them."""
    time, data = raw["RawDataTime"], raw["RawData"]
    time.attrs.update(units="microseconds since 1970-01-01", calendar="proleptic_gregorian")
    raw.create_dataset("distance", data=distance).attrs["units"] = "m"
    data.attrs["units"] = "nm/m/s"
    for number, scale in enumerate((time, raw["distance"])):
        scale.make_scale(scale.name.rpartition("/")[2])
        data.dims[number].attach_scale(scale)


def finish(known: Description, said: StoreFile, folder: Path) -> Store:
    """Combine the health of all parts, and mark the store complete."""
    import h5py

    parts = []
    for part in said.parts:
        with h5py.File(folder / part_name(part)) as file:
            parts.append(PartHealth.read(file["Health"]))
    watch, noise = joined(parts)
    lost = merged(one for part in parts for one in part.lost)
    whole, stored = Reading.all_of(known), Reading.all_of(known).stored()
    if watch.bad is None:
        faults = [*(line for one in parts for line in one.faults), *known.lines]
        raise InputError([*faults, f"{known.where}: no channel holds a signal in any sample"][0])
    rounding = rounding_of(whole.narrowed(watch.looked_at), stored, known.grid.sampling_rate, known.gauge_length)
    if rounding is not None and said.factor > 1:
        taps = taps_of(said.factor)
        rounding = rounding.filtered(taps / taps.sum(), said.factor)
    dead = whole.paired(watch.still) | whole.excluded
    if dead.all():
        raise InputError(f"{known.where}: no channel holds a signal; check channels and exclude in [das] of site.toml")
    step = np.zeros(len(dead)) if rounding is None else rounding.step
    cautions = [line for line in [watch.clipped(), *(line for one in parts for line in one.faults)] if line]
    cautions += filled_line(known.channel[np.any([one.filled for one in parts], 0) & ~dead])
    write_tables(known, folder, noise, step, dead, watch)
    said = said.model_copy(
        update={
            "cautions": (*known.lines, *unmeasured_line(lost, known.grid.interval * 1e-9), *cautions),
            "statements": tuple(one.to_dict() for one in known.stated([one.path for one in known.blocks], lost)),
            "gaps": seconds_of(known.grid.without(lost), known.grid.interval),
            "law": () if rounding is None else tuple(rounding.law.tolist()),
            "whole": rounding is not None and rounding.whole,
            "complete": True,
        }
    )
    with writing(folder / FILE) as path:
        path.write_text(said.model_dump_json(indent=1), encoding="utf-8")
    return Store(folder, said)


def write_tables(
    known: Description,
    folder: Path,
    noise: NDArray[np.float64],
    step: NDArray[np.float64],
    dead: NDArray[np.bool_],
    watch: Watch,
) -> None:
    """Write channels.csv and files.csv."""
    distance = distance_of(known.blocks[0], known.channel, known.channel_spacing, known.spaced)
    n = known.pair
    inner = slice(n, len(watch.still) - n)
    at_ends = sum(end.count for end in watch.ends if end.count is not None) if watch.clipped() else 0 * watch.still
    bad = np.zeros(len(watch.still), int) if watch.bad is None else watch.bad
    columns = (known.channel, distance, noise, step, dead.astype(int), bad[inner], np.asarray(at_ends)[inner])
    with writing(folder / CHANNELS) as path, path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(["channel", "distance", "noise", "step", "dead", "bad", "clipped"])
        table.writerows(zip(*(column.tolist() for column in columns), strict=True))
    why = [(one.path, one.why) for one in known.left_out]
    spans: dict[Path, list[int]] = {}
    for one in known.grid.placed:
        span = spans.setdefault(one.block.path, [one.row, one.stop, 0])
        span[1], span[2] = one.stop, span[2] + one.rows
    with writing(folder / FILES) as path, path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(["file", "start", "end", "seconds_used", "left_out"])
        for raw, (begin, end, rows) in spans.items():
            ends = [np.datetime_as_string(known.grid.time_of(row), unit="ms") + "Z" for row in (begin, end)]
            lines = "; ".join(line for path, line in why if path == raw)
            table.writerow([raw.name, *ends, f"{rows * known.grid.interval * 1e-9:.3f}", lines])
        for raw, line in why:
            if raw not in spans:
                table.writerow([raw.name, "", "", "0.000", line])
