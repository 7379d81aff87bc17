"""Text and TOML as any editor saves them."""

import codecs
import re
import tomllib
from pathlib import Path
from typing import Any

from vision.contract.errors import InputError

#: What no name holds: it breaks lines, controls terminals, or is half a character.
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
#: Characters of a name at most.
LONGEST = 200


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
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give {wanted}") from error
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
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: invalid TOML ({error}); mend that line") from error
