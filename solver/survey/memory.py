"""How much memory is left, checked before work that needs much of it; and what becomes of memory that is freed."""

import ctypes
import gc
import os
from pathlib import Path

from vision.contract import InputError

#: Where Linux states a container's memory limit and use, bytes.
CGROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)
MEMINFO = Path("/proc/meminfo")
#: Parameters of glibc's mallopt (malloc.h), and bytes from which on an array's memory goes back when it is freed.
TRIM_THRESHOLD, MMAP_THRESHOLD, LARGE = -1, -3, 1 << 26
#: Objects made beyond those let go of, after which Python looks for cycles among the newest.
SELDOM = 100_000


def reuse_freed_memory() -> None:
    """Let arrays of up to 64 MB use again what others have freed, where the C library is glibc.

    A fit makes and frees arrays of tens of MB by the thousand, and to get fresh pages from the system takes several
    times as long as what is done with them. Up to four times as much that nothing is on is kept. It holds for the whole
    process, so it is for the command to call.

    >>> reuse_freed_memory()
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(MMAP_THRESHOLD, LARGE)
    mallopt(TRIM_THRESHOLD, 4 * LARGE)


def collect_seldom() -> None:
    """Look for objects that only refer to one another a hundred times less often than Python does.

    Hundreds of thousands of objects of libraries stay to the end, and to look through them all again and again takes a
    tenth of a fit. Arrays are let go of where nothing refers to them, without any such search.

    >>> collect_seldom()
    """
    gc.set_threshold(SELDOM, 10, 10)


def give_back() -> None:
    """Give all pages that nothing is on to the system, where the C library is glibc: after what was large was let go.

    >>> give_back()
    """
    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (AttributeError, OSError, TypeError):
        return


def available() -> float:
    """Bytes that can still be used; infinity if the system does not say.

    >>> available() > 1e6
    True
    """
    rooms = [float("inf")]
    try:
        said = dict(line.split(":") for line in MEMINFO.read_text().splitlines())
        rooms.append(float(said["MemAvailable"].split()[0]) * 1024)
    except (OSError, KeyError, ValueError):
        rooms.append(free_pages())
    for limit, use in CGROUPS:
        try:
            # "No limit" is written as the word "max", or as a number beyond all memory.
            rooms.append(float(Path(limit).read_text()) - float(Path(use).read_text()))
        except (OSError, ValueError):
            continue
    return max(0.0, min(rooms))


def free_pages() -> float:
    """Bytes in free pages, if the system counts them."""
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


def require_memory(needed: float, what: str, mend: str) -> None:
    """Refuse work that needs more memory than is available.

    Parameters
    ----------
    needed : bytes, beyond what this process already uses
    what : the work, which begins the message
    mend : what the user can do

    Raises
    ------
    InputError
        If less is available.

    >>> require_memory(1e21, "reading a.h5", "name fewer channels")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    vision.contract.errors.InputError: reading a.h5 needs about 1000000000000 GB of memory, ...
    """
    room = available()
    if needed > room:
        free = f"{gigabytes(room)} are free, enough for {room / needed:.0%} of it"
        raise InputError(f"{what} needs about {gigabytes(needed)} of memory, and {free}; {mend}")


def gigabytes(size: float) -> str:
    """Write bytes for people.

    >>> gigabytes(5.04e9), gigabytes(3.2e8)
    ('5 GB', '0.32 GB')
    """
    return f"{size / 1e9:.2g} GB" if size < 1e11 else f"{size / 1e9:.0f} GB"
