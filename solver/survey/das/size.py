"""How much memory a record takes once read."""

from pathlib import Path

from solver.survey.memory import require_memory
from vision.contract import InputError

#: Memory that reading takes, the record included, in records of double precision: 0.7 to 1.7 measured, the less the
#: larger they are.
COPIES = 2.0


def require_room_for_record(rows: int, columns: int, where: Path) -> None:
    """Refuse a record [rows, columns] if there is no memory for working copies of it.

    Raises
    ------
    InputError
        If there is not.
    """
    require_memory(
        8 * COPIES * rows * columns,
        f"{where}: a record of {rows} samples of {columns} channels",
        "name fewer channels, channels = [first, last], in [das] of site.toml, or fewer files at a time",
    )


def require_room_for_file(path: Path) -> None:
    """Refuse a file that must be read as a whole if there is no memory for what it unfolds to, or it holds nothing.

    Raises
    ------
    InputError
        If there is not, or none of its numbers was ever written.
    """
    import h5py

    held, written = path.stat().st_size, True
    if h5py.is_hdf5(path):
        arrays = list[h5py.Dataset]()
        with h5py.File(path) as file:
            file.visititems(lambda _, node: arrays.append(node) if isinstance(node, h5py.Dataset) else None)
            # Chunks that were never written take no room in the file, and all of theirs in memory.
            held = sum(array.nbytes for array in arrays)
            largest = max(arrays, key=lambda array: array.nbytes, default=None)
            written = largest is None or largest.is_virtual or largest.id.get_storage_size() > 0
    if not written:
        raise InputError(f"{path}: its {held / 1e9:.2g} GB of numbers were never written; leave this file out")
    require_memory(COPIES * held, f"{path}: reading it as a whole", "split the file, or take a larger machine")
