"""Properties of a TDMS file that DASCore leaves out: gauge length and calibration of a Silixa iDAS."""

import struct
from pathlib import Path
from typing import Any, BinaryIO

# Type codes of TDMS (National Instruments, "TDMS File Format Internal Structure").
NUMBERS = {1: "b", 2: "h", 3: "i", 4: "q", 5: "B", 6: "H", 7: "I", 8: "Q", 9: "f", 10: "d", 0x21: "?"}
TEXT, TIME_STAMP = 0x20, 0x44


def read_number(stream: BinaryIO, code: str) -> Any:
    """Read one little-endian number."""
    layout = f"<{code}"
    return struct.unpack(layout, stream.read(struct.calcsize(layout)))[0]


def read_text(stream: BinaryIO) -> str:
    """Read one length-prefixed text."""
    return stream.read(read_number(stream, "I")).decode("utf-8", errors="replace")


def read_value(stream: BinaryIO) -> Any:
    """Read a type code and the value after it; a time stamp is returned as its 16 bytes."""
    code = read_number(stream, "I")
    if code == TEXT:
        return read_text(stream)
    return stream.read(16) if code == TIME_STAMP else read_number(stream, NUMBERS[code])


def read_tdms_properties(path: Path) -> dict[str, Any]:
    """Return the properties {name: value} of the first object of a TDMS file.

    Raises
    ------
    struct.error, KeyError
        If the file is cut short or a property has a type that no DAS file uses.
    """
    with path.open("rb") as stream:
        stream.seek(28 + 4)  # lead-in; number of objects
        read_text(stream)  # path of the object
        stream.seek(4, 1)  # its raw data index
        count = read_number(stream, "I")
        return {read_text(stream): read_value(stream) for _ in range(count)}
