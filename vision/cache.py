"""Results cached between runs, in a folder per user, by checksum of their inputs."""

import hashlib
import logging
import os
import re
import sys
import zlib
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.contract.progress import progress

log = logging.getLogger("roadfiber.cache")

BLOCK = 1 << 24  # bytes read at a time
LIMIT = 1_000_000_000  # most bytes in the folder: a few days of video at 25 frames/s
KINDS = ("detections/*/*.npz", "timestamps/*.npz")  # patterns of cached files in the folder


def cache_folder() -> Path | None:
    """Return the folder of kept results: `ROADFIBER_CACHE`, else roadfiber's in the platform's place for caches.

    None for a user who has no home.
    """
    if os.environ.get("ROADFIBER_CACHE"):
        return Path(os.environ["ROADFIBER_CACHE"])
    stated = {"win32": "LOCALAPPDATA", "darwin": ""}.get(sys.platform, "XDG_CACHE_HOME")
    if os.environ.get(stated):
        return Path(os.environ[stated]) / "roadfiber"
    try:
        home = Path.home()
    except RuntimeError:
        log.warning("nothing is kept for a second look: this user has no home; ROADFIBER_CACHE names a folder")
        return None
    usual = {"win32": "AppData/Local", "darwin": "Library/Caches"}
    return home / usual.get(sys.platform, ".cache") / "roadfiber"


def checksum(path: Path) -> str:
    """SHA-256 of a file; an unchanged file is not read twice.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a"
    >>> _ = path.write_bytes(b"abc")
    >>> checksum(path)[:8]
    'ba7816bf'
    """
    state = path.stat()
    return _checksum(path.absolute(), state.st_size, state.st_mtime_ns)


@cache
def _checksum(path: Path, size: int, modified: int) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file, progress(f"checksum of {path.name}", -(-size // BLOCK)) as advance:
        while block := file.read(BLOCK):
            digest.update(block)
            advance(1)
    return digest.hexdigest()


def keep_arrays(path: Path, arrays: Mapping[str, Any]) -> bool:
    """Write arrays whole or not at all; if that fails, log it and return False."""
    try:
        with writing(path) as temporary:
            np.savez_compressed(temporary, **arrays)
    except InputError as error:
        log.warning("nothing is kept for a second look: %s", error)
        return False
    return True


def kept_arrays(path: Path) -> dict[str, NDArray[Any]] | None:
    """Read cached arrays; None if there are none. Damaged ones are logged and removed."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (BadZipFile, EOFError, KeyError, OSError, ValueError, zlib.error):
        log.warning("%s: is damaged and made anew", path)
        path.unlink(missing_ok=True)
        return None
    with suppress(OSError):  # a folder that can only be read
        os.utime(path)  # used now, so it is pruned last
    return found


def prune(folder: Path, limit: int) -> int:
    """Remove the least recently used files until at most `limit` bytes are left; return how many were removed.

    Parameters
    ----------
    folder : of the cache; only what roadfiber keeps in it counts
    limit : bytes

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = keep_arrays(folder / "timestamps" / "a.npz", {"time": np.zeros(9)})
    >>> prune(folder, 1000), prune(folder, 10) > 0
    (0, True)
    """
    files = list[tuple[int, int, Path]]()
    for path in (path for kind in KINDS for path in folder.glob(kind)):
        with suppress(FileNotFoundError):  # another run is pruning, too
            state = path.stat()
            files.append((state.st_mtime_ns, state.st_size, path))
    excess, gone = sum(size for _, size, _ in files) - limit, 0
    for _, size, path in sorted(files):
        if excess - gone <= 0:
            break
        with suppress(OSError):
            path.unlink()
            gone += size
            path.parent.rmdir()  # which fails while others are in it
    return gone


def allowed() -> int:
    """Most bytes in the cache: `LIMIT`, or the value of `ROADFIBER_CACHE_MB`; InputError if that is not a number."""
    stated = os.environ.get("ROADFIBER_CACHE_MB")
    if not stated:
        return LIMIT
    if not re.fullmatch(r"\d+(\.\d*)?", stated.strip()):
        raise InputError(f"ROADFIBER_CACHE_MB is {stated!r}; give a number of megabytes")
    return round(float(stated) * 1e6)
