"""Outputs appear whole or not at all."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def writing(target: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `target`; rename it to `target` on success, remove it on any error.

    The path is free: create a file or a folder there. An existing target is replaced only at the end.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with writing(folder / "a.txt") as path:
    ...     _ = path.write_text("whole")
    >>> (folder / "a.txt").read_text()
    'whole'
    """
    target = Path(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    # A folder of its own on the same file system keeps the suffix (writers choose the format by it) and the replacing
    # atomic.
    scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        temporary = scratch / target.name
        yield temporary
        if target.is_dir() and temporary.is_dir():
            target.replace(scratch / "replaced")
        temporary.replace(target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
