"""Reading JSON files of a run folder: an error says in one line what is wrong and how to mend it."""

import re
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from solver.run.stored import ANY_FORMAT, FORMAT
from solver.run.stored_types import Stored
from vision.contract import InputError

#: Bytes of a JSON file; a run of 10 km of fiber and a thousand vehicles has a tenth of it.
LARGEST = 2**26
#: What is told of an error's place.
PLACE = 80
Model = TypeVar("Model", bound=Stored)


def printable(text: str, most: int = PLACE) -> str:
    r"""At most so many characters of untrusted text, none of which controls a terminal.

    >>> printable("a\x1b[2Jb"), printable("abc", 2)
    ('a?[2Jb', 'ab...')
    """
    shown = "".join(c if c.isprintable() else "?" for c in text[:most])
    return shown + "..." if len(text) > most else shown


def of_another_version(written: object) -> str | None:
    """What to do with a run of another format than this version's; None where a format is none of a run.

    >>> of_another_version("roadfiber run 1")
    'written by an older roadfiber (format "roadfiber run 1"); run `roadfiber locate` on its survey again'
    >>> of_another_version("roadfiber run 99")
    'written by a newer roadfiber (format "roadfiber run 99"); update roadfiber to open it'
    >>> of_another_version("a letter")
    """
    found = re.match(ANY_FORMAT, written) if isinstance(written, str) else None
    if found is None or written == FORMAT:
        return None
    if int(found[1]) > int(FORMAT.split()[-1]):
        return f'written by a newer roadfiber (format "{written}"); update roadfiber to open it'
    return f'written by an older roadfiber (format "{written}"); run `roadfiber locate` on its survey again'


def read_model(path: Path, model: type[Model], mend: str) -> Model:
    """Read a JSON file of a run folder.

    Parameters
    ----------
    path : of the file
    model : what it must be
    mend : what to do where it is not that

    Raises
    ------
    InputError
        If it is not a file, too large, not JSON, of another version's format, or something else than `model`.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; {mend}")
    if path.stat().st_size > LARGEST:
        raise InputError(f"{path}: over {LARGEST >> 20} MiB, which no run's is; {mend}")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {mend}") from error
    try:
        return model.model_validate_json(content)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        if problem["loc"] == ("format",) and (told := of_another_version(problem["input"])) is not None:
            raise InputError(f"{path}: {told}") from error
        place = printable(".".join(map(str, problem["loc"]))) or "all of it"
        said = printable(problem["msg"].removeprefix("Value error, "))
        if problem["type"] == "json_invalid":
            raise InputError(f"{path}: invalid JSON ({said}); {mend}") from error
        raise InputError(f"{path}: {place}: {said[:1].lower()}{said[1:]}; {mend}") from error
