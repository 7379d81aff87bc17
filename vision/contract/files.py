"""Outputs appear whole or not at all."""

import ctypes
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from glob import escape
from pathlib import Path

from vision.contract.errors import InputError, is_full, machine_words

if sys.platform != "win32":
    import fcntl

#: What ends the names of the folders in which outputs are made, before eight letters of their own.
MAKING = ".roadfiber-"
#: Name in one of them of the earlier folder, where two cannot be exchanged at once.
REPLACED = "replaced"
#: Free bytes required at the target before the work begins.
ROOM = 1 << 20


@contextmanager
def writing(target: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `target`; rename it to `target` on success, remove it on any error.

    The path is free: create a file or a folder there. An existing target is replaced only at the end.

    Raises
    ------
    InputError
        If it cannot be written there, or the disk is full.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with writing(folder / "a.txt") as path:
    ...     _ = path.write_text("whole")
    >>> (folder / "a.txt").read_text()
    'whole'
    """
    target = Path(target)
    with scratch_for(target) as scratch:
        temporary = scratch / target.name
        yield temporary
        if not (target.is_dir() and temporary.is_dir()):
            temporary.replace(target)
        elif not exchange(temporary, target):
            target.replace(scratch / REPLACED)
            temporary.replace(target)


@contextmanager
def writing_into(folder: str | Path) -> Iterator[Path]:
    """Yield a temporary folder; move the files written there into `folder` on success, remove them on any error.

    Files of other names stay as they are.

    Raises
    ------
    InputError
        As in `writing`.
    """
    folder = Path(folder)
    with scratch_for(folder / "files", folder) as scratch:
        yield scratch
        for path in sorted(scratch.iterdir()):
            path.replace(folder / path.name)


@contextmanager
def scratch_for(target: Path, named: Path | None = None) -> Iterator[Path]:
    """Yield an empty folder beside `target` and remove it; tell in a line where that (`named` so) cannot be written."""
    scratch, made, lock = beside(target, named)
    try:
        yield scratch
        made.clear()
    except Exception as error:
        if isinstance(error, InputError) and str(scratch) in str(error):
            # Already reported by the writer inside: its file belongs beside the target.
            raise InputError(str(error).replace(str(scratch), str(target.parent))) from error
        # Errors of reading inside are not errors of writing.
        ours = is_full(error) or (isinstance(error, OSError) and str(scratch) in str(error.filename or scratch))
        if not ours or isinstance(error, InputError):
            raise
        raise InputError(unwritable(named or target, error)) from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        os.close(lock)
        remove(made)


def exchange(one: Path, other: Path) -> bool:
    """Exchange two folders in a single step, so that a kill leaves one of them in place; False where Linux is not.

    >>> exchange(Path("absent"), Path("absent too"))
    False
    """
    try:
        rename = ctypes.CDLL(None).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    here, swap = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of fcntl.h and stdio.h
    return bool(rename(here, os.fsencode(one), here, os.fsencode(other), swap) == 0)


def locked(folder: Path, wait: bool = True) -> int:
    """Descriptor of a folder that is locked until that is closed, where the system can.

    Raises
    ------
    OSError
        If the folder is gone, or without `wait` where it cannot be locked at once.
    """
    if sys.platform == "win32":
        if not wait:
            raise OSError("no locks")
        return os.open(os.devnull, os.O_RDONLY)
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError) if wait else nullcontext():
            fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        folder.stat()
    except OSError:
        os.close(lock)
        raise
    return lock


def clean(target: Path) -> None:
    """Remove what was left by those who were killed while they made `target`; those who make it now hold locks."""
    for left in target.parent.glob(f".{escape(target.name)}{MAKING}????????"):
        with suppress(OSError):
            lock = locked(left, wait=False)
            if not target.exists() and (left / REPLACED).exists():
                (left / REPLACED).replace(target)
            shutil.rmtree(left, ignore_errors=True)
            os.close(lock)


def beside(target: Path, named: Path | None = None) -> tuple[Path, list[Path], int]:
    """Make an empty folder beside `target`; return it, the parent folders made for it, deepest first, and its lock.

    A folder of its own on the same file system keeps the suffix (writers choose the format by it) and the replacing
    atomic.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    made = list[Path]()
    try:
        for folder in reversed([target.parent, *target.parent.parents]):
            if not folder.exists():
                folder.mkdir(exist_ok=True)
                made.insert(0, folder)
        clean(target)
        scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}{MAKING}", dir=target.parent))
        return scratch, made, locked(scratch)
    except OSError as error:
        remove(made)
        raise InputError(unwritable(named or target, error)) from error


def remove(made: list[Path]) -> None:
    """Remove folders that are still empty, the deepest first."""
    with suppress(OSError):
        for folder in made:
            folder.rmdir()


def unwritable(target: Path, error: Exception) -> str:
    """Say why `target` cannot be written, and what to do."""
    if is_full(error):
        return f"{target}: no space left to write it; make room, or write elsewhere"
    reason = getattr(error, "strerror", None) or machine_words(error)
    return f"{target}: cannot be written ({reason}); name a place that can be"


def require_writable(*targets: str | Path) -> None:
    """Test, before the work rather than after it, whether files or folders can be written; leave no trace.

    Raises
    ------
    InputError
        If one cannot: its folder is read-only or not a folder, or its disk is full.

    >>> require_writable(Path(tempfile.mkdtemp()) / "new" / "a.txt")
    """
    for target in map(Path, targets):
        scratch, made, lock = beside(target)
        try:
            (scratch / "room").write_bytes(bytes(ROOM))
        except OSError as error:
            raise InputError(unwritable(target, error)) from error
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
            os.close(lock)
            remove(made)
