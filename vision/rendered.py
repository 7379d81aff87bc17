"""A note in a video file that its pictures are rendered, not filmed."""

import struct
import uuid
from pathlib import Path

KIND = uuid.uuid5(uuid.NAMESPACE_DNS, "rendered.roadfiber")
# A box of a private type (ISO 14496-12, 11.1): players skip it, copies keep it.
NOTE = struct.pack(">I4s16s", 24, b"uuid", KIND.bytes)


def note_rendered(path: Path) -> None:
    """Append the note to an MP4 file."""
    with path.open("ab") as file:
        file.write(NOTE)


def is_rendered(path: Path) -> bool:
    """Whether a file ends with the note; one that was encoded anew has lost it.

    >>> is_rendered(Path(__file__))
    False
    """
    if path.is_dir():  # of pictures, which have no such note
        return False
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - len(NOTE), 0))
        return file.read() == NOTE
