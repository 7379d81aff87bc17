"""How much memory a record takes once read."""

from pathlib import Path

from solver.survey.memory import require_memory

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
