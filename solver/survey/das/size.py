"""How large a DAS file is once read, from its header alone."""

import struct
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from solver.survey.memory import require_memory

#: What reading takes beside the numbers of the files, in records of double precision: measured, 1.1 to 2.0.
COPIES = 2.0
#: Bytes of a number where the file does not say: interrogators store 2 or 4.
USUAL = {".tdms": 2}


def numbers_in(path: Path) -> tuple[int, int]:
    """How many numbers a file holds, and the bytes that they take as they are stored once unpacked.

    A file whose header cannot be read counts as what it takes on the disk: its reader will say what is wrong with it.
    """
    import h5py

    path = Path(path)
    size = path.stat().st_size
    try:
        if path.suffix.lower() == ".npy":
            with path.open("rb") as stream:
                return header_of(stream)
        if path.suffix.lower() == ".npz":
            return packed_in(path)
        if h5py.is_hdf5(path):
            return largest_in(path)
    except (OSError, ValueError, KeyError, RuntimeError, struct.error, zipfile.BadZipFile):
        pass
    return size // USUAL.get(path.suffix.lower(), 4), size


def header_of(stream: BinaryIO) -> tuple[int, int]:
    """Numbers and bytes by the header of a `.npy` stream."""
    major, _ = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    shape, _, kind = read(stream)
    count = int(np.prod(shape, dtype=np.float64))
    return count, count * kind.itemsize


def packed_in(path: Path) -> tuple[int, int]:
    """Numbers and bytes of the arrays of a `.npz` file."""
    with zipfile.ZipFile(path) as archive:
        found = []
        for name in archive.namelist():
            with archive.open(name) as stream:
                found.append(header_of(stream))  # type: ignore[arg-type]
    return max(found)


def largest_in(path: Path) -> tuple[int, int]:
    """Numbers and bytes of the largest array of an HDF5 file."""
    import h5py

    found = [(0, 0)]

    def look(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset):
            found.append((int(node.size or 0), int(node.size or 0) * node.dtype.itemsize))

    with h5py.File(path) as file:
        file.visititems(look)
    return max(found)


def require_room_for_files(files: Sequence[Path], whole: bool) -> None:
    """Refuse files that do not fit into memory, before they are read; `whole` where all their channels are wanted.

    Raises
    ------
    InputError
        If they do not.
    """
    numbers, stored = np.array([numbers_in(path) for path in files if Path(path).is_file()]).reshape(-1, 2).sum(0)
    needed = stored + (8 * COPIES * numbers if whole else 0)
    fewer = "name fewer channels, channels = [first, last], in [das] of site.toml, or fewer" if whole else "name fewer"
    require_memory(float(needed), f"reading {Path(files[0]).name}{beside(files)}", f"{fewer} files at a time")


def beside(files: Sequence[Path]) -> str:
    """How many files there are beside the first, in words."""
    return f" and {len(files) - 1} more" if len(files) > 1 else ""


def require_room_for_record(rows: int, columns: int, where: Path) -> None:
    """Refuse a record [rows, columns] of which no copies fit into memory beside the files.

    Raises
    ------
    InputError
        If they do not.
    """
    require_memory(
        8 * COPIES * rows * columns,
        f"{where}: a record of {rows} samples of {columns} channels",
        "name fewer channels, channels = [first, last], in [das] of site.toml, or fewer files at a time",
    )
