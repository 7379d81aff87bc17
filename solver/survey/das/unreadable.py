"""Why a DAS file cannot be read: empty, cut short, text, another kind of HDF5, axes exchanged."""

import re
import struct
from pathlib import Path

HDF5 = b"\x89HDF\r\n\x1a\n"
TDMS = b"TDSm"
#: What HDF5 says of a file that another program has open.
OPEN = re.compile(r"already open for write|unable to lock file|consistency flags", re.IGNORECASE)
WRITTEN = "a file that is still being written; wait until the recorder has closed it, or leave it out"


def why_unknown(path: Path) -> str:
    """Say in one line why the format of a file is not known, and how to mend it."""
    with path.open("rb") as stream:
        start = stream.read(4096)
    if not start:
        return "an empty file, 0 bytes; copy it again"
    if start.startswith(HDF5):
        return why_no_hdf5(path)
    if start.startswith(TDMS):
        return "TDMS that breaks off or is of no DAS; copy the file again"
    if b"\0" not in start and start.isascii():
        return "text, whatever its name says; give the file of an interrogator, or numpy with a side file"
    return "no known DAS format; give a file of an interrogator, or numpy with a side file"


def why_no_hdf5(path: Path) -> str:
    """Say why an HDF5 file is of no known DAS format."""
    import h5py

    try:
        with h5py.File(path) as file:
            held = ", ".join(sorted(file)) or "nothing"
    except OSError as error:
        if sizes := re.search(r"truncated file: eof = (\d+).*?stored_eof = (\d+)", str(error)):
            return f"HDF5 that breaks off after {sizes[1]} of {sizes[2]} bytes; copy it again once it is whole"
        return WRITTEN if OPEN.search(str(error)) else "damaged HDF5; copy the file again"
    return f"HDF5 of no known DAS format (it holds {held}); export PRODML, or numpy with a side file"


def why_unreadable(error: Exception) -> str:
    """Say in one line why DASCore could not read a file, and how to mend it.

    Only what the file system or a decompressor says shows damage; else a header may be written otherwise.

    >>> why_unreadable(ValueError("Data array has a shape of (241, 322) which doesnt match (322, 241)."))
    'its data are [241, 322], but time and channel [322, 241]: the axes are exchanged; transpose them in the file'
    >>> why_unreadable(KeyError("GaugeLength"))
    "not as DASCore expects a file of this kind ('GaugeLength'); export PRODML, or numpy with a side file"
    >>> why_unreadable(ValueError("'bananas' is not defined in the unit registry"))
    "unknown unit 'bananas'; write one such as (nm/m)/s or rad/s into the file"
    """
    if isinstance(error, OverflowError):
        return "a number in its header, perhaps in a unit, is beyond all range; mend it"
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    if unit := re.search(r"('.+') is not defined in the unit registry", reason):
        return f"unknown unit {unit[1]}; write one such as (nm/m)/s or rad/s into the file"
    shapes = re.findall(r"\((\d+), (\d+)\)", reason)
    if len(shapes) == 2 and shapes[0] == shapes[1][::-1]:
        held, wanted = (f"[{', '.join(shape)}]" for shape in shapes)
        return f"its data are {held}, but time and channel {wanted}: the axes are exchanged; transpose them in the file"
    if isinstance(error, ImportError):
        return f"a package that reads it is missing ({reason}); install it, or export PRODML"
    if OPEN.search(reason):
        return WRITTEN
    if isinstance(error, OSError | EOFError | struct.error):
        return f"damaged or incomplete ({reason}); copy the file again"
    return f"not as DASCore expects a file of this kind ({reason}); export PRODML, or numpy with a side file"
