"""Reconcile what the files and the user say about a record: lengths, unit, channels."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.block import Block, checksum_of
from solver.survey.das.units import Unit
from vision.contract import InputError
from vision.contract.statements import Statements, Value, statement

Array = NDArray[np.float64]

Run = tuple[int, int, int]

TOLERANCE = 0.01  # largest relative difference between what the file and the user say

ROUNDED = 2e-3  # s; largest difference between two clocks of one file: a vehicle at 30 m/s moves 6 cm in it
RATE_OFF = 1e-3  # largest relative difference between two sampling rates of one record

logger = logging.getLogger("roadfiber")


def file_spacing(block: Block) -> float | None:
    """Return the spacing of a block's channels, m; None if the file does not give it."""
    if block.distance is None or len(block.distance) < 2:
        return None
    steps = np.diff(block.distance)
    spacing = float(np.median(steps))
    if spacing <= 0 or np.abs(steps / spacing - 1).max() > TOLERANCE:
        raise InputError(f"{block.path}: channels are not evenly spaced; export one stretch of fiber at one spacing")
    return spacing


def agreed(name: str, limits: tuple[float, float], stated: float | None, given: float | None, where: Path) -> float:
    """Return the user's value, else the file's; `statements_of` says where they differ.

    Raises
    ------
    InputError
        If neither is given, or no interrogator has such a length.
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
    return length


def statements_of(
    block: Block,
    interval: float,
    runs: Sequence[Run],
    stored: Unit,
    lengths: tuple[float, float],
    given: Mapping[str, float | str | None],
) -> Statements:
    """Hold what one file states, and what is `given` in site.toml, against what is taken of it.

    Parameters
    ----------
    block : the file
    interval : of sampling, ns
    runs : first row, rows, and time of the first, ns, of each stretch without a jump
    stored : what they are
    lengths : channel spacing and gauge length, m
    given : gauge_length, channel_spacing, quantity and scale of site.toml, None where it has none
    """
    (spacing, gauge), first, (_, count, last) = lengths, runs[0][2], runs[-1]
    ends = np.array([first, last + round((count - 1) * interval)]).astype("datetime64[ns]")
    taken: dict[str, tuple[Value | None, str, float, bool]] = {
        "maker": (block.format, "", 0.0, False),
        "start": (ends[0], "", ROUNDED, True),
        "end": (ends[1], "", ROUNDED + 1.5e-9 * interval, True),
        "zone": ("UTC", "", 0.0, False),
        "times of samples": ("", "", 0.0, False),
        "rate": (1e9 / interval, "Hz", RATE_OFF, False),
        "samples": (len(block.data), "", 0.0, False),
        "channels": (block.data.shape[1], "", 0.0, False),
        "first channel": (block.first_channel, "", 0.0, False),
        "first distance": (None if block.distance is None else float(block.distance[0]), "m", spacing, True),
        "channel spacing": (spacing, "m", TOLERANCE, False),
        "gauge length": (gauge, "m", TOLERANCE, False),
        "unit": (stored.quantity, "", 0.0, False),
        "scale": (f"{stored.factor:g}", "", 0.0, False),
        "filters": (None, "", 0.0, False),
    }
    said = {what: list(block.said.get(what, ())) for what in taken}
    said["unit"] += [("file", block.stated)] if block.stated else []
    for key, value in given.items():
        what = {"quantity": "unit"}.get(key, key.replace("_", " "))
        said[what] += [] if value is None else [("site.toml", f"{value:g}" if what == "scale" else value)]
    held = [
        statement(what, said[what], value, unit=unit, within=within, absolute=absolute)
        for what, (value, unit, within, absolute) in taken.items()
        if said[what] or value
    ]
    if block.stated and block.unit is None and given.get("scale") is None and stored.quantity != "idas_counts":
        told = f"the file's unit is not understood; its numbers are taken for {stored.quantity} in SI units"
        held = [replace(one, caution=told) if one.what == "unit" else one for one in held]
    gaps = [statement("gaps", (), f"{len(runs) - 1} between its samples")] if len(runs) > 1 else []
    return Statements(block.path.name, (*held, *gaps, *block.odd))


def chosen(where: Path, held: tuple[int, int], channels: tuple[int, int] | None) -> tuple[int, int]:
    """Return the first and last of the `channels` asked for out of those `held`; all if `channels` is None."""
    if channels is None:
        return held
    if not held[0] <= channels[0] < channels[1] <= held[1]:
        raise InputError(
            f"{where}: no channels {channels[0]} to {channels[1]}; the file has {held[0]} to {held[1]}, "
            "give channels = [first, last] within"
        )
    return channels


def check_excluded(where: Path, held: tuple[int, int], exclude: Sequence[int]) -> None:
    """Raise InputError if a channel to leave out is not among those `held`."""
    if unknown := [number for number in exclude if not held[0] <= number <= held[1]]:
        raise InputError(f"{where}: no channel {unknown[0]} to exclude; the file has {held[0]} to {held[1]}")


def distance_of(block: Block, channel: NDArray[np.int64], spacing: float, given: bool) -> Array:
    """Return the distance along the fiber of each channel, m [channel]; from the spacing if that is `given`."""
    if block.distance is None:
        return channel.astype(np.float64) * spacing
    distance = block.distance[channel - block.first_channel]
    return distance[0] + np.arange(len(channel), dtype=np.float64) * spacing if given else distance


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
