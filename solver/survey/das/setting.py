"""Reconcile what the files and the user say about a record: lengths, unit, channels."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.block import Block, checksum_of
from solver.survey.das.units import Unit
from vision.contract import InputError

Array = NDArray[np.float64]

TOLERANCE = 0.01  # largest relative difference between what the file and the user say

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


def agreed(
    name: str, limits: tuple[float, float], stated: float | None, given: float | None, where: Path, notes: list[str]
) -> float:
    """Return the user's value, else the file's; add a note if they differ.

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
    if given is None:
        return length
    if stated is not None and abs(given / stated - 1) > TOLERANCE:
        notes.append(f"{name} {given:g} m as given; the file states {stated:g} m")
        logger.warning("%s: %s", where, notes[-1])
    return given


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
