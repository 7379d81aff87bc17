"""The one error that a user can mend, and errors of the machine in its own words."""

import errno
import os

#: Error numbers of a full disk, a used-up quota, or a file beyond the size limit.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

#: What PyTorch, OpenCV and the loader of libraries say where there is too little memory.
NO_MEMORY = ("can't allocate memory", "Insufficient memory", "failed to map segment from shared object")


class InputError(ValueError):
    """Something the user gave cannot be used; the message says what, where and how to mend it, in one line.

    The command line prints it as it is and exits with status 2; nothing has been written then.

    >>> raise InputError("site.toml: no such file; give the path of a survey's site.toml")
    Traceback (most recent call last):
    vision.contract.errors.InputError: site.toml: no such file; give the path of a survey's site.toml
    """


def is_full(error: BaseException) -> bool:
    """Whether an error means a full disk; libraries turn the system's error number into words.

    >>> is_full(RuntimeError("Can't close file (file write failed: errno = 28, No space left on device)"))
    True
    """
    return getattr(error, "errno", None) in FULL or any(os.strerror(number) in str(error) for number in FULL)


def machine_words(error: BaseException) -> str | None:
    """An error of the machine, in one line; None for every other error, which is a fault of the program.

    >>> machine_words(PermissionError(13, "Permission denied", "run"))
    'run: Permission denied'
    >>> machine_words(KeyError("x")) is None
    True
    """
    said = " ".join(str(error).split())
    if isinstance(error, MemoryError) or any(words in said for words in NO_MEMORY):
        return (
            "not enough memory; name fewer channels in [das] of site.toml, locate one part of the record at a time, or "
            "take a larger machine"
        )
    if is_full(error):
        return f"{getattr(error, 'filename', None) or 'the disk'}: no space left; make room, or write elsewhere"
    if not isinstance(error, OSError):
        return None
    place = f"{error.filename}: " if error.filename else ""
    return place + (error.strerror or said or type(error).__name__)
