"""data.npz of a run folder: who wrote it is not known, so types and shapes are checked before memory is taken."""

import lzma
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError

#: Bytes of all arrays of a run: an hour at 10 Hz over 10 km takes a tenth of it.
LARGEST = 2**33
#: Bytes of arrays for each of the file; measured strain rates hardly compress, what roadfiber writes has less than 3.
DENSEST = 50
#: Bytes of arrays that any file may have.
SMALL = 2**26

#: The one header that numpy writes of an array of plain numbers or text.
HEADER = re.compile(
    rb"\{'descr': '(\|b1|<i8|<f4|<f8|<U\d{1,5})', 'fortran_order': (?:False|True), 'shape': \(([\d, ]{0,99})\), \} *\n"
)
MAGIC = b"\x93NUMPY\x01\x00"

Arrays = Mapping[str, NDArray[Any]]

#: Kind and axes of arrays by name.
Expected = Mapping[str, tuple[str, tuple[str | int, ...]]]

#: Types that each kind of array may be stored as.
KINDS = {"flag": ("|b1",), "count": ("<i8",), "number": ("<f4", "<f8"), "text": ("<U",)}
#: Kind and axes of what is known of passes; a name is an axis that others share, a number its length.
OF_PASSES: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "rows": ("count", ("row",)),
    "position": ("number", ("row", 2)),
    "velocity": ("number", ("row", 2)),
    "sigma": ("number", ("row", 2)),
    "in_view": ("flag", ("row",)),
    "count": ("count", ("pass",)),
    "track_id": ("text", ("pass",)),
    "class": ("text", ("pass",)),
    "length": ("number", ("pass",)),
    "offset": ("number", ("pass",)),
    "wheelbase": ("number", ("pass", 2)),
}
#: Every array of a run.
EXPECTED: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "time": ("number", ("sample",)),
    "channel": ("count", ("channel",)),
    "distance": ("number", ("channel",)),
    "route": ("number", ("channel", 3)),
    "covariance": ("number", ("channel", 3, 3)),
    "tails": ("number", ("channel", 3, 3)),
    "added": ("number", ("channel", 3, 3)),
    "constrained": ("flag", ("channel",)),
    "data_share": ("number", ("channel", 3)),
    "vector": ("number", ("parameter",)),
    "samples": ("count", ("sample",)),
    "fitted_channel": ("count", ("fitted",)),
    "noise": ("number", ("fitted",)),
    "model": ("number", ("sample", "fitted")),
    "weight": ("number", ("sample", "fitted")),
    "record": ("number", ("moment", "fitted")),
    "start": ("number", ("fitted", 3)),
    "law_own": ("number", ("lag",)),
    "law_common": ("number", ("lag",)),
    "law_across": ("number", ("neighbor",)),
    "law_hidden": ("number", ("hidden lag",)),
} | {
    f"{prefix}_{name}": (kind, tuple(f"{prefix}'s {axis}" if isinstance(axis, str) else axis for axis in axes))
    for prefix in ("pass", "fitted_pass")
    for name, (kind, axes) in OF_PASSES.items()
}


@dataclass(frozen=True)
class Declared:
    """What an array says it is: type, shape, and at which byte of its file its numbers begin."""

    descr: str
    shape: tuple[int, ...]
    begin: int

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return prod(self.shape) * np.dtype(self.descr).itemsize


def read_arrays(path: Path, expected: Expected = EXPECTED) -> dict[str, NDArray[Any]]:
    """Read the arrays of a run, and nothing else that its file may hold; `expected` are their kinds and axes.

    Raises
    ------
    InputError
        If one is missing, of another type or shape than the others ask for, too large, or corrupt.
    """
    mend = "run `roadfiber locate` again"
    if not path.is_file():
        raise InputError(f"{path}: no such file, so the arrays of this run are missing; {mend}")
    try:
        with path.open("rb") as stream, ZipFile(stream) as file:
            stored = {info.filename: info for info in file.infolist()}
            missing = sorted(name for name in expected if f"{name}.npy" not in stored)
            if missing:
                raise UnfitError(f"{missing[0]} is missing")
            found = {name: declared(file, stored[f"{name}.npy"]) for name in expected}
            check_shapes(found, expected)
            check_sizes(sum(one.size for one in found.values()), path.stat().st_size)
            return {name: numbers(file, stored[f"{name}.npy"], one) for name, one in found.items()}
    except UnfitError as error:
        raise InputError(f"{path}: not the arrays of this run: {error}; {mend}") from error
    except (OSError, EOFError, ValueError, RuntimeError, MemoryError, BadZipFile, zlib.error, lzma.LZMAError) as error:
        told = type(error).__name__ if isinstance(error, MemoryError) else " ".join(str(error).split())[:120]
        raise InputError(f"{path}: not the arrays of a run ({told}); {mend}") from error


class UnfitError(ValueError):
    """What is wrong with arrays, in words that name one."""


def declared(file: ZipFile, info: ZipInfo) -> Declared:
    """Read what an array says it is, and not the array."""
    name = info.filename.removesuffix(".npy")
    if info.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
        raise UnfitError(f"{name} is compressed in an unusual way")
    with file.open(info) as stream:
        start = stream.read(len(MAGIC) + 2)
        length = int.from_bytes(start[len(MAGIC) :], "little")
        header = HEADER.fullmatch(stream.read(length))
    if not start.startswith(MAGIC) or header is None:
        raise UnfitError(f"{name} is not an array of plain numbers or text")
    shape = tuple(int(size) for size in header[2].decode().replace(",", " ").split())
    return Declared(header[1].decode(), shape, len(start) + length)


def check_shapes(found: Mapping[str, Declared], expected: Expected) -> None:
    """Refuse arrays of another type than expected, and those that share an axis and differ along it."""
    known: dict[str, tuple[int, str]] = {}
    for name, (kind, axes) in expected.items():
        one = found[name]
        if not one.descr.startswith(KINDS[kind]):
            raise UnfitError(f"{name} is of type {one.descr}, not {kind}s")
        if len(one.shape) != len(axes):
            raise UnfitError(f"{name} has {len(one.shape)} axes, not {len(axes)}")
        for size, axis in zip(one.shape, axes, strict=True):
            if not size:
                raise UnfitError(f"{name} is empty")
            wanted, by = (axis, "") if isinstance(axis, int) else known.setdefault(axis, (size, f" in {name}"))
            if size != wanted:
                raise UnfitError(f"{name} has {size} along an axis that has {wanted}{by}")


def check_sizes(total: int, stored: int) -> None:
    """Refuse arrays that take more memory than any run's, or than a file of so many bytes can honestly hold."""
    if total > LARGEST:
        raise UnfitError(f"they would take {total / 2**30:.3g} GiB, over {LARGEST >> 30}")
    if total > max(SMALL, DENSEST * stored):
        raise UnfitError(f"they would take {total / 2**20:.3g} MiB, out of a file of {stored / 2**20:.2g}")


def numbers(file: ZipFile, info: ZipInfo, one: Declared) -> NDArray[Any]:
    """Read an array that is what it should be."""
    if info.file_size != one.begin + one.size:
        raise UnfitError(f"{info.filename.removesuffix('.npy')} holds another number of values than it says")
    with file.open(info) as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
