"""What one DAS file holds: its numbers, and what the file says about them."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.samples import InHDF5, OnDisk
from solver.survey.das.units import Unit
from vision.contract.statements import Said, Statement

#: Size up to which the checksum covers the whole file, bytes; of larger files, how many blocks it covers, and their
#: size.
WHOLE, BLOCKS, BLOCK = 1 << 26, 64, 1 << 16


@dataclass(frozen=True)
class Block:
    """What one file holds.

    Parameters
    ----------
    path : of the file
    format : its name and version
    data : [time, channel], as stored; on the disk where the format allows it
    time : ns since 1970, UTC [time]
    distance : m along the fiber [channel], or None where the file gives no spacing
    first_channel : number of the first channel
    gauge_length : m, or None where the file does not say
    unit : of `data`, or None where the file does not say
    stated : the unit as the file words it
    said : what the file states, by what it is about, each with the place where it stands
    odd : what else of it must be known
    """

    path: Path
    format: str
    data: NDArray[Any] | OnDisk | InHDF5
    time: NDArray[np.int64]
    distance: NDArray[np.float64] | None
    first_channel: int
    gauge_length: float | None
    unit: Unit | None
    stated: str
    said: Mapping[str, Said] = field(default_factory=dict)
    odd: tuple[Statement, ...] = ()


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fingerprint(path: Path) -> str:
    """Return the SHA-256 of a file of a record.

    Of a file over 64 MiB it covers the size and 64 evenly spread blocks of 64 KiB, first and last included, and begins
    with "sampled:", so that a survey of days need not be read in full.
    """
    size = path.stat().st_size
    if size <= WHOLE:
        return checksum(path)
    with path.open("rb") as stream:
        found = hashlib.sha256(str(size).encode())
        for number in range(BLOCKS):
            stream.seek((size - BLOCK) * number // (BLOCKS - 1))
            found.update(stream.read(BLOCK))
        return f"sampled:{found.hexdigest()}"


def checksum_of(block: Block) -> str:
    """Return the SHA-256 of a block's file, or of its numbers if they came from memory."""
    if block.path.is_file():
        return fingerprint(block.path)
    return hashlib.sha256(np.ascontiguousarray(block.data[:, :]).data).hexdigest()
