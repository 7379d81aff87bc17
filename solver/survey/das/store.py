"""The store of a record: its strain rate at the sampling rate of the fit, in parts of a few minutes, with their health.

A store is a folder:

- `store.json`: what it was made from and how (`StoreFile`); `complete` once all parts are there
- `part-<first>-<last>.h5`: strain rate of the rows `first` to before `last`, without a gap, PRODML 2.0. A row is
  `factor` samples of the files; row 0 is at `start`. `Acquisition/Raw[0]/RawData` [time, channel] is float32 in
  (nm/m)/s, with the HDF5 dimension scales `RawDataTime` (us since 1970, UTC) and `distance` (m), as netCDF-4 has them:
  DASCore opens the folder (`dascore.spool(folder)`), xarray a part (`xarray.open_dataset(part, engine="h5netcdf",
  group="Acquisition/Raw[0]")`). `Health` holds what `solver.survey.das.health.PartHealth` describes
- `channels.csv`: channel, distance (m), noise and rounding step (1/s), dead, bad and clipped samples
- `files.csv`: every file, its begin and end, and what of it was left out and why
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from solver.survey.das.block import fingerprint
from solver.survey.das.prodml import STORED
from solver.survey.das.record import DASRecord, Extent, gap_lines
from solver.survey.das.rounding import Rounding
from solver.survey.das.time_windows import Windows
from vision.contract import InputError, progress, read_text
from vision.contract.statements import Statements

Format = Literal["roadfiber store 1"]
(FORMAT,) = get_args(Format)
FILE, CHANNELS, FILES = "store.json", "channels.csv", "files.csv"
Finite = Annotated[float, Field(allow_inf_nan=False)]
Rows = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=1)]]


class Kept(BaseModel):
    """A table of store.json."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RawFile(Kept):
    """A file that the store was made from: its path relative to the store's folder, size, times, checksum."""

    path: str
    bytes: int
    changed: int
    sha256: str


class StoreFile(Kept):
    """store.json: what a store was made from and how.

    Attributes
    ----------
    format : of the store
    files : that it was made from
    linked : other files that those show numbers of
    asked : the settings of `[das]` in site.toml
    start : of row 0, UTC
    interval : between samples of the files, ns
    factor : samples of the files that are a row
    rows : of the record
    gauge_length, channel_spacing : of the record, m
    channels : first and last
    first_distance : of the first channel along the fiber, m
    held : first and last channel of the files
    parts : rows of each part: first, and one after the last
    gaps : first and last time of missing samples, s after `start`
    provenance : format, original unit, scale, notes
    cautions : what must be known about the record, a line each
    statements : what each file states, and what is taken of it
    law : autocovariance of the error of rounding, by lag; empty where values were not rounded
    whole : whether values were rounded to whole steps
    complete : whether all parts are there
    """

    format: Format
    files: tuple[RawFile, ...]
    linked: tuple[RawFile, ...] = ()
    asked: dict[str, Any]
    start: str
    interval: Finite
    factor: Annotated[int, Field(ge=1)]
    rows: Annotated[int, Field(ge=1)]
    gauge_length: Finite
    channel_spacing: Finite
    channels: tuple[int, int]
    first_distance: Finite
    held: tuple[int, int]
    parts: tuple[Rows, ...]
    gaps: tuple[tuple[Finite, Finite], ...]
    provenance: dict[str, Any]
    cautions: tuple[str, ...] = ()
    statements: tuple[dict[str, Any], ...] = ()
    law: tuple[Finite, ...] = ()
    whole: bool = False
    complete: bool = False


def part_name(rows: tuple[int, int]) -> str:
    """File name of a part.

    >>> part_name((0, 4000))
    'part-000000000-000004000.h5'
    """
    return f"part-{rows[0]:09d}-{rows[1]:09d}.h5"


def raw_files(files: Sequence[Path], folder: Path) -> tuple[RawFile, ...]:
    """Describe the files that a store in `folder` is made from."""
    found = []
    for path in files:
        status = path.stat() if path.is_file() else None
        size, changed = (status.st_size, status.st_mtime_ns) if status else (-1, 0)
        name = os.path.relpath(path.resolve(), folder.resolve())
        found.append(RawFile(path=name, bytes=size, changed=changed, sha256=fingerprint(path) if status else ""))
    return tuple(found)


@dataclass(frozen=True)
class Store:
    """A complete store, opened."""

    folder: Path
    said: StoreFile

    @classmethod
    def open(cls, folder: Path) -> "Store":
        """Open the store in a folder.

        Raises
        ------
        InputError
            If there is no store, or it is not complete.
        """
        said = read_store_file(folder)
        if not said.complete:
            raise InputError(f"{folder}: the store is not complete; run roadfiber ingest again, which goes on with it")
        return cls(Path(folder), said)

    def stale(self, files: Sequence[Path], asked: dict[str, Any]) -> str | None:
        """Why the store does not match these files and settings; None if it does."""
        if self.said.asked != asked:
            return "[das] of site.toml changed"
        names = [os.path.relpath(path.resolve(), self.folder.resolve()) for path in files]
        if sorted(names) != sorted(one.path for one in self.said.files):
            return "there are other DAS files"
        for one in (*self.said.files, *self.said.linked):
            path = self.folder / one.path
            status = path.stat() if path.is_file() else None
            if status is None or status.st_size != one.bytes:
                return f"{path.name} changed"
            if status.st_mtime_ns != one.changed and fingerprint(path) != one.sha256:
                return f"{path.name} changed"
        return None

    @property
    def files(self) -> list[str]:
        """Paths of the files that the store was made from."""
        return [os.path.normpath(self.folder.resolve() / one) for one in self.said.provenance["files"]]

    @property
    def statements(self) -> tuple[Statements, ...]:
        """What each file states, and what was taken of it."""
        return tuple(Statements.of(one) for one in self.said.statements)

    @property
    def interval(self) -> float:
        """Time between two rows, ns."""
        return self.said.interval * self.said.factor

    @property
    def start(self) -> np.datetime64:
        """Time of row 0, UTC."""
        return np.datetime64(self.said.start, "ns")

    @property
    def end(self) -> np.datetime64:
        """Time of the last row, UTC."""
        return self.time_of(self.said.rows - 1)

    @property
    def channels(self) -> tuple[int, int]:
        """First and last channel."""
        return self.said.channels

    @property
    def channel_spacing(self) -> float:
        """Of the channels, m."""
        return self.said.channel_spacing

    def time_of(self, row: int) -> np.datetime64:
        """UTC of a row."""
        return self.start + np.timedelta64(round(row * self.interval), "ns")

    @cached_property
    def table(self) -> dict[str, NDArray[np.float64]]:
        """channels.csv, a column by name [channel]."""
        path = self.folder / CHANNELS
        try:
            found = np.genfromtxt(path, delimiter=",", names=True, dtype=float, ndmin=1)
            return {name: np.asarray(found[name], float) for name in ("channel", "distance", "noise", "step", "dead")}
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read ({error}); run roadfiber ingest again") from error

    def rows_of(self, times: Sequence[tuple[np.datetime64, np.datetime64]] | None) -> list[tuple[int, int]]:
        """Row ranges (first, one after last) of time spans, in order; all rows if None."""
        if times is None:
            return [(0, self.said.rows)]
        ends = [[(one - self.start) / np.timedelta64(1, "ns") / self.interval for one in span] for span in times]
        found = [(max(0, int(np.floor(a))), min(self.said.rows, int(np.ceil(b)) + 1)) for a, b in ends]
        return [(a, b) for a, b in found if b > a] or [(0, self.said.rows)]

    def record(
        self,
        *,
        channels: tuple[int, int] | None = None,
        times: Sequence[tuple[np.datetime64, np.datetime64]] | None = None,
    ) -> DASRecord:
        """Read the store, or a part of it; arguments as in `solver.survey.das.reader.record_from`."""
        import h5py

        said = self.said
        first, last = said.channels if channels is None else channels
        columns = slice(first - said.channels[0], last - said.channels[0] + 1)
        spans = self.rows_of(times)
        windows = Windows.of(spans, 1e9 / self.interval)
        begin, end = windows.begin, windows.end
        rate: NDArray[Any] = np.full((windows.rows, last - first + 1), np.nan, np.float32)
        wanted = [(part, span) for part in said.parts for span in spans if part[0] < span[1] and part[1] > span[0]]
        with progress("reading the store", len(wanted)) as advance:
            for part, span in wanted:
                low, high = max(part[0], span[0]), min(part[1], span[1])
                path = self.folder / part_name(part)
                try:
                    with h5py.File(path) as file:
                        rows = slice(low - part[0], high - part[0])
                        there = windows.place(low)
                        rate[there : there + high - low] = file["Acquisition/Raw[0]/RawData"][rows, columns]
                except (OSError, KeyError, TypeError, ValueError) as error:
                    raise InputError(f"{path}: cannot be read ({error}); run roadfiber ingest again") from error
                advance(1)
        rate *= np.float32(STORED)
        rate[:, self.table["dead"][columns] > 0] = np.nan
        if not np.isfinite(rate).any():
            raise InputError(f"{self.folder}: no samples at the times that are wanted; check the clocks")
        ahead = begin * self.interval * 1e-9
        lasts = ahead + (end - 1 - begin) * self.interval * 1e-9
        gaps = tuple((max(a, ahead) - ahead, min(b, lasts) - ahead) for a, b in said.gaps if a < lasts and b > ahead)
        start, step = self.time_of(begin), self.table["step"][columns]
        partly = spans != [(0, said.rows)] or (first, last) != said.held
        return DASRecord(
            strain_rate=rate,
            time=(windows.grid_rows - begin).astype(np.float64) * (self.interval * 1e-9),
            start=start,
            distance=self.table["distance"][columns],
            channel=np.arange(first, last + 1),
            gauge_length=said.gauge_length,
            channel_spacing=said.channel_spacing,
            sampling_rate=1e9 / self.interval,
            gaps=gaps,
            provenance=said.provenance | {"files": self.files, "store": self.folder.name},
            rounding=Rounding(step, np.array(said.law), said.whole) if len(said.law) and step.any() else None,
            cautions=(*said.cautions, *gap_lines(start, gaps, said.interval * 1e-9)),
            extent=Extent(self.start, self.end, said.held) if partly else None,
            statements=self.statements,
        )


def read_store_file(folder: Path) -> StoreFile:
    """Read store.json of a folder.

    Raises
    ------
    InputError
        If there is no such file, or it is of another version or damaged.
    """
    path = Path(folder) / FILE
    try:
        return StoreFile.model_validate_json(read_text(path, "the store that roadfiber ingest writes"))
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(map(str, problem["loc"]))
        raise InputError(f"{path}: {where}: {problem['msg'].lower()}; remove it and run roadfiber ingest") from error
