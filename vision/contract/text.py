"""Text, times, TOML and JSON as any editor saves them."""

import codecs
import json
import re
import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vision.contract.errors import InputError

#: What no name holds: it breaks lines, controls terminals, or is half a character.
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
#: Characters of a name at most.
LONGEST = 200
#: Bytes of a text at most; a map of a country has less.
LARGEST = 1 << 28
#: Times of records: from the first to before the second. Nanoseconds of 64 bits hold their differences.
YEARS = datetime(1970, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
#: s; clocks that start in 1970 are off by less.
FARTHEST = 4e9
TIME_MEND = "write ISO 8601 in UTC, as 2025-08-11T06:00:00.25Z"


def is_name(text: str) -> bool:
    r"""Whether a text can be the name of something: one line that every file and terminal takes.

    >>> is_name("m$^$ <1>"), is_name("manhole\nwest"), is_name("\x1b[2J")
    (True, False, False)
    """
    return len(text) <= LONGEST and not CONTROL.search(text)


def plain(text: str) -> str:
    r"""A text without what controls a terminal.

    >>> plain("a\x1b[2Jb")
    'a?[2Jb'
    """
    return CONTROL.sub("?", text)


def read_text(path: Path, wanted: str) -> str:
    r"""Read text in UTF-8, with or without a byte order mark.

    Parameters
    ----------
    path : of the file
    wanted : what the user should give instead, for the message

    Raises
    ------
    InputError
        If there is no such file, it cannot be read, or it is in UTF-16 or not text.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "site.toml"
    >>> _ = path.write_bytes("\ufeffname = 'Ö'".encode())
    >>> read_text(path, "a site.toml")
    "name = 'Ö'"
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        # A device or a pipe need have no end.
        content = path.read_bytes() if path.is_file() and size <= LARGEST else None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', error)}); give {wanted}") from error
    if content is None:
        raise InputError(f"{path}: not a file of at most {LARGEST >> 20} MiB; give {wanted}")
    marks = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    if content.startswith(marks) or b"\0" in content[:2]:
        raise InputError(f"{path}: is in UTF-16; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}: line {line} is not UTF-8; save it as UTF-8, or give {wanted}") from error


def read_toml(path: Path, wanted: str) -> dict[str, Any]:
    """Read a TOML file; arguments and errors are those of `read_text`, and a line that is not TOML is named."""
    try:
        return tomllib.loads(read_text(path, wanted))
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: invalid TOML ({error}); mend that line") from error


def read_json(path: Path, wanted: str) -> Any:
    """Read a JSON file; arguments and errors are those of `read_text`, and text that is not JSON is told."""
    try:
        return json.loads(read_text(path, wanted))
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({error}); give {wanted}") from error


def moment(given: str | datetime, what: str) -> datetime:
    """A time with a zone, of a year in which there are records.

    Parameters
    ----------
    given : ISO 8601 where it is text
    what : it is the time of, which begins the message

    Raises
    ------
    InputError
        If it is none.

    >>> moment("2025-08-11T06:00:00+02:00", "--start").utcoffset().seconds
    7200
    """
    try:
        found = datetime.fromisoformat(given.strip()) if isinstance(given, str) else given
    except ValueError as error:
        raise InputError(f"{what} {given!r}: is not a time; {TIME_MEND}") from error
    if found.tzinfo is None:
        raise InputError(f"{what} {given}: has no time zone; {TIME_MEND}")
    if not YEARS[0] <= found < YEARS[1]:
        raise InputError(f"{what} {given}: is of no year from {YEARS[0].year} to {YEARS[1].year - 1}; {TIME_MEND}")
    return found
