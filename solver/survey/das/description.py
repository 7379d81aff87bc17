"""A record as the headers of its files describe it, before any of its numbers is read."""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.block import Block
from solver.survey.das.das_files import read_blocks
from solver.survey.das.faults import LeftOut, left_out_line, of_one_setting, without_overlaps
from solver.survey.das.grid import Grid, Part, on_grid, part_of, sampling_interval
from solver.survey.das.setting import agreed, check_excluded, chosen, file_spacing, logger, statements_of
from solver.survey.das.units import Unit, resolve
from solver.survey.limits import CHANNEL_SPACINGS, GAUGE_LENGTHS
from vision.contract import InputError, progress
from vision.contract.statements import Statements, caution_lines, statement


@dataclass(frozen=True)
class Description:
    """A record that has not been read yet.

    Parameters
    ----------
    blocks : of all files, sorted by time; their numbers may still be on disk
    grid : times of the rows of every file
    stored : quantity and unit of the numbers
    channels : first and last channel asked for
    held : first and last channel in the files
    exclude : channels to leave out
    channel_spacing, gauge_length : m
    pair : channels to either side between which velocity is differenced; 0 if the files hold no velocity
    spaced : whether the user gave the channel spacing
    notes : what was decided, a line each
    files : how many there are
    left_out : files, and parts of files, that are not used
    statements : what each file states, and what is taken of it
    """

    blocks: tuple[Block, ...]
    grid: Grid
    stored: Unit
    channels: tuple[int, int]
    held: tuple[int, int]
    exclude: tuple[int, ...]
    channel_spacing: float
    gauge_length: float
    pair: int
    spaced: bool
    notes: tuple[str, ...]
    files: int
    left_out: tuple[LeftOut, ...] = ()
    statements: tuple[Statements, ...] = ()

    @property
    def where(self) -> Path:
        """The first file, by which messages name the record."""
        return self.blocks[0].path

    @property
    def start(self) -> np.datetime64:
        """Time of the first sample, UTC."""
        return self.grid.time_of(0)

    @property
    def end(self) -> np.datetime64:
        """Time of the last sample, UTC."""
        return self.grid.time_of(self.grid.rows - 1)

    @property
    def channel(self) -> NDArray[np.int64]:
        """Numbers of the channels asked for [channel]."""
        return np.arange(self.channels[0], self.channels[1] + 1)

    @property
    def lines(self) -> list[str]:
        """What to tell the user about files that are left out, and about statements that differ."""
        return [*left_out_line(self.files, self.left_out), *caution_lines(self.statements)]

    def stated(self, files: Container[Path], lost: Sequence[tuple[int, int]]) -> tuple[Statements, ...]:
        """Statements of some files, with how many of their samples were written without being measured."""
        gone = dict[str, int]()
        for one in self.grid.placed:
            inside = sum(max(0, min(one.stop, last + 1) - max(one.row, first)) for first, last in lost)
            gone[one.block.path.name] = gone.get(one.block.path.name, 0) + inside
        told = {name: (statement("not measured", (), f"{count} samples"),) for name, count in gone.items() if count}
        named = [block.path for block in self.blocks]
        both = zip(named, self.statements, strict=True)
        return tuple(replace(one, rows=(*one.rows, *told.get(one.file, ()))) for path, one in both if path in files)

    def columns(self, channels: tuple[int, int]) -> slice:
        """Columns of the files that a range of channels is made from."""
        first = self.blocks[0].first_channel
        return slice(channels[0] - self.pair - first, channels[1] + self.pair - first + 1)


def read_headers(files: Sequence[Path]) -> tuple[list[Part], list[LeftOut]]:
    """Describe every file; parts sorted by time, and the files that cannot be read.

    Raises
    ------
    InputError
        If none can be read; the message says why the first cannot.
    """
    if not files:
        raise InputError("no DAS files; give at least one")
    parts, left_out, errors = list[Part](), list[LeftOut](), list[InputError]()
    with progress("reading DAS headers", len(files)) as advance:
        for path in files:
            try:
                for part in map(part_of, read_blocks(Path(path))):
                    file_spacing(part.block)
                    parts.append(part)
            except InputError as error:
                errors.append(error)
                left_out.append(LeftOut(Path(path), str(error).removeprefix(f"{path}: ")))
            advance(1)
    if not parts:
        raise errors[0]
    return sorted(parts, key=lambda part: part.runs[0][2]), left_out


class Stated(TypedDict, total=False):
    """What may be stated about a record beside its files; see `solver.survey.das.reader.read_das`."""

    gauge_length: float | None
    channel_spacing: float | None
    quantity: str | None
    channels: tuple[int, int] | None
    exclude: Sequence[int]
    scale: float | None


def describe(files: Sequence[Path], **stated: Unpack[Stated]) -> Description:
    """Describe the record of some files from their headers; errors are those of `read_das`."""
    parts, left_out = read_headers(files)
    return description_of(parts, left_out=left_out, **stated)


def description_of(
    parts: Sequence[Part],
    *,
    left_out: Sequence[LeftOut] = (),
    gauge_length: float | None = None,
    channel_spacing: float | None = None,
    quantity: str | None = None,
    channels: tuple[int, int] | None = None,
    exclude: Sequence[int] = (),
    scale: float | None = None,
) -> Description:
    """Describe the record of parts, sorted by time."""
    notes = list[str]()
    files = len({part.block.path for part in parts}) + len(left_out)
    parts, others = of_one_setting(parts)
    first = parts[0].block
    whole = bool(np.issubdtype(first.data.dtype, np.integer))
    stored = resolve(first.unit, first.stated, quantity, scale, first.path, whole=whole)
    spacing = agreed("channel spacing", CHANNEL_SPACINGS, file_spacing(first), channel_spacing, first.path)
    gauge = agreed("gauge length", GAUGE_LENGTHS, first.gauge_length, gauge_length, first.path)
    pair, count = 0, first.data.shape[1]
    if stored.quantity == "velocity":
        pair = max(1, round(gauge / spacing / 2))
        if count <= 2 * pair:
            raise InputError(f"{first.path}: fewer channels than one gauge length of {gauge:g} m; give more fiber")
        gauge = 2 * pair * spacing
        notes.append(f"strain rate is the difference of velocity over {gauge:g} m, an even number of channels")
        logger.info("%s: %s", first.path, notes[-1])
    given = {"gauge_length": gauge_length, "channel_spacing": channel_spacing, "quantity": quantity, "scale": scale}
    held = first.first_channel + pair, first.first_channel + count - 1 - pair
    interval = sampling_interval(parts)
    placed, twice = without_overlaps(on_grid(parts, interval), interval)
    grid = Grid(parts[0].runs[0][2], interval, tuple(placed))
    asked = chosen(first.path, held, channels)
    check_excluded(first.path, held, exclude)
    return Description(
        blocks=tuple(part.block for part in parts),
        grid=grid,
        stored=stored,
        channels=asked,
        held=held,
        exclude=tuple(exclude),
        channel_spacing=spacing,
        gauge_length=gauge,
        pair=pair,
        spaced=channel_spacing is not None,
        notes=tuple(notes),
        files=files,
        left_out=(*left_out, *others, *twice),
        statements=tuple(
            statements_of(part.block, part.interval, part.runs, stored, (spacing, gauge), given) for part in parts
        ),
    )
