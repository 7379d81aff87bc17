"""Numbers of a DAS file that stay on disk until they are needed."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.units import dascore
from solver.survey.das.unreadable import why_unreadable
from vision.contract import InputError


@dataclass(frozen=True)
class OnDisk:
    """Numbers [time, channel] of one file, read in parts through DASCore.

    Parameters
    ----------
    path : of the file
    format, version : as DASCore names them
    time : of the rows [time], ns since 1970; a range where they are evenly apart, which takes no memory
    distance : of the columns as DASCore gives it, in its unit [channel]
    dtype : of the numbers

    `numbers[first:stop, first:stop]` reads, without steps; `numpy.asarray` reads all.
    """

    path: Path
    format: str
    version: str
    time: range | NDArray[np.int64]
    distance: NDArray[np.float64]
    dtype: np.dtype[Any]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.time), len(self.distance)

    @property
    def size(self) -> int:
        """Count of numbers."""
        return len(self.time) * len(self.distance)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """All of them."""
        return self[:, :].astype(dtype or self.dtype, copy=False)

    def __getitem__(self, at: tuple[slice, slice]) -> NDArray[Any]:
        rows, columns = (range(*part.indices(count)) for part, count in zip(at, self.shape, strict=True))
        if not len(rows) or not len(columns):
            return np.empty((len(rows), len(columns)), self.dtype)
        # With a margin of half a step, so that limits stored in single precision are found too.
        step = float(np.median(np.diff(self.distance))) / 4 if len(self.distance) > 1 else 0.0
        chosen = {
            "time": tuple(np.datetime64(int(self.time[row]), "ns") for row in (rows[0], rows[-1])),
            "distance": (self.distance[columns[0]] - step, self.distance[columns[-1]] + step),
        }
        try:
            found = next(series(self.path, self.format, self.version, **chosen), None)
            if found is None or found.data.shape != (len(rows), len(columns)):
                whole = next(series(self.path, self.format, self.version))
                return np.asarray(whole.data)[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            return np.asarray(found.data)
        except Exception as error:  # on damaged bytes a parser can raise anything
            raise InputError(f"{self.path}: {why_unreadable(error)}") from error


@dataclass(frozen=True)
class InHDF5:
    """Numbers [time, channel] of a dataset of an HDF5 file, read in parts.

    Parameters
    ----------
    path, name : of the file, and of the dataset in it
    shape : rows and columns, of which the dataset may hold more
    turned : whether it is [channel, time]
    dtype : of the numbers

    `numbers[first:stop, first:stop]` reads, without steps; `numpy.asarray` reads all.
    """

    path: Path
    name: str
    shape: tuple[int, int]
    turned: bool
    dtype: np.dtype[Any]

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def size(self) -> int:
        """Count of numbers."""
        return self.shape[0] * self.shape[1]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """All of them."""
        return self[:, :].astype(dtype or self.dtype, copy=False)

    def __getitem__(self, at: tuple[slice, slice]) -> NDArray[Any]:
        import h5py

        rows, columns = (slice(*part.indices(count)) for part, count in zip(at, self.shape, strict=True))
        try:
            with h5py.File(self.path) as file:
                node = file[self.name]
                return np.asarray(node[columns, rows].T if self.turned else node[rows, columns])
        except (OSError, KeyError) as error:
            raise InputError(f"{self.path}: {why_unreadable(error)}") from error


def is_series(attributes: Any, dims: Any) -> bool:
    """Whether a patch with these attributes and dimensions holds samples over time and distance.

    PRODML may also hold energies in frequency bands; those have a `start_frequency`.
    """
    dims = dims.split(",") if isinstance(dims, str) else dims
    return {"time", "distance"} <= set(dims) and "start_frequency" not in dict(attributes)


def series(path: Path, name: str, version: str, **chosen: Any) -> Iterator[Any]:
    """The patches [time, distance] of a file, or of a part of it."""
    for patch in dascore().read(path, file_format=name, file_version=version, **chosen):
        if is_series(patch.attrs, patch.dims):
            yield patch.transpose("time", "distance")


def described(path: Path, name: str, version: str) -> tuple[Any, OnDisk] | None:
    """A patch with a file's first row, and the file's numbers, not yet read; None if DASCore cannot tell the times.

    The header gives the times of the rows; one row gives the columns' places along the fiber.
    """
    try:
        found = [
            one for one in dascore().scan(path, file_format=name, file_version=version) if is_series(one, one.dims)
        ]
        if len(found) != 1:
            return None
        time = dict(found[0].coords)["time"].to_coord().data
        heads = list(series(path, name, version, time=(time[0], time[0])))
    except Exception:  # uneven times, or damage: reading the whole file shows which
        return None
    if len(heads) != 1 or heads[0].data.shape[0] != 1:
        return None
    head = heads[0]
    distance = np.asarray(head.get_array("distance"), float)
    if len(distance) > 1 and np.diff(distance).min() <= 0:
        return None
    return head, OnDisk(path, name, version, evenly(time), distance, head.data.dtype)


def evenly(time: NDArray[np.datetime64]) -> range | NDArray[np.int64]:
    """Times in ns since 1970, as a range where they are evenly apart.

    >>> evenly(np.array(["1970-01-01T00:00:00", "1970-01-01T00:00:01"], "datetime64[ns]"))
    range(0, 2000000000, 1000000000)
    """
    found = time.astype("datetime64[ns]").astype(np.int64)
    steps = np.diff(found)
    if not len(steps) or steps[0] <= 0 or (steps != steps[0]).any():
        return found
    return range(int(found[0]), int(found[-1] + steps[0]), int(steps[0]))
