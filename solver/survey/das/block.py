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


def linked_files(path: Path) -> list[Path]:
    """Other files whose numbers an HDF5 file shows as its own, whether they are there or not; none for other files."""
    import h5py

    found = dict[Path, None]()

    def look(_: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            names = [one.file_name for one in node.virtual_sources()] if node.is_virtual else []
            # HDF5 itself looks for these where the process is.
            outer = [(path.parent / name, Path(name)) for name, _, _ in node.external or ()]
            found.update({beside if beside.is_file() else there: None for beside, there in outer})
        else:
            links = (node.get(name, getlink=True) for name in node)
            names = [link.filename for link in links if isinstance(link, h5py.ExternalLink)]
        found.update({path.parent / name: None for name in names if name != "."})

    try:
        with h5py.File(path) as file:
            look("", file)
            file.visititems(look)
    except (OSError, RuntimeError):
        return []
    # `%b` in a name stands for the number of a block.
    several = {one: sorted(one.parent.glob(one.name.replace("%b", "*"))) for one in found if "%b" in one.name}
    return [each for one in found for each in several.get(one) or [one]]


def fingerprint(path: Path) -> str:
    """Return the SHA-256 of a file of a record, and of those that it shows numbers of.

    Of a file over 64 MiB it covers the size and 64 evenly spread blocks of 64 KiB, first and last included, and begins
    with "sampled:", so that a survey of days need not be read in full.
    """
    parts = [own_fingerprint(one) for one in (path, *linked_files(path)) if one.is_file()]
    if len(parts) == 1:
        return parts[0]
    sampled = "sampled:" * any(part.startswith("sampled:") for part in parts)
    return sampled + hashlib.sha256(" ".join(parts).encode()).hexdigest()


def own_fingerprint(path: Path) -> str:
    """`fingerprint` of a file without those that it links."""
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
