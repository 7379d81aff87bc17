"""Text tables from any program: separator, decimal mark and encoding are detected from the file."""

import codecs
import csv
import io
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vision.contract.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

SEPARATORS = ",;\t"
LOOKED_AT = 1 << 16  # bytes from which the form is detected
SAVE = "save it as CSV UTF-8"
# A number with a decimal comma that fills a whole field.
DECIMAL_COMMA = re.compile(r'(?:^|[;\t])[ "]*[-+]?\d*,\d+(?:[eE][-+]?\d+)?[ "]*(?=[;\t]|$)', re.MULTILINE)


@dataclass(frozen=True)
class Form:
    """How a table is written.

    Parameters
    ----------
    encoding : of the text
    skipped : lines before the header
    header : names as they are written
    separator, decimal : of fields and of numbers
    """

    encoding: str
    skipped: int
    header: list[str]
    separator: str
    decimal: str


def encoding_of(start: bytes, path: Path) -> str:
    """Detect the encoding of text from its first bytes; InputError if it is not text."""
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if start.startswith(b"PK"):
        raise InputError(f"{path}: is a workbook or an archive, no csv; open it and {SAVE}")
    # A header is ASCII: in UTF-16 every second byte of it is 0.
    for encoding, high in (("utf-16-le", start[1:64:2]), ("utf-16-be", start[0:64:2])):
        if high and not any(high):
            return encoding
    if b"\0" in start:
        raise InputError(f"{path}: is not text; {SAVE}")
    return "utf-8-sig"


def form_of(path: Path) -> Form:
    """Detect the form of a table from its beginning.

    Lines of `#` and Excel's `sep=;` before the header are passed over.

    Raises
    ------
    InputError
        If the file is empty or not text, a name occurs twice, or the first row has more fields than the header.
    """
    with path.open("rb") as stream:
        start = stream.read(LOOKED_AT)
    encoding = encoding_of(start, path)
    text = codecs.getincrementaldecoder(encoding)().decode(start)
    lines = [line.rstrip("\r") for line in text.split("\n")]
    skipped = next((n for n, line in enumerate(lines) if line.strip() and not re.match(r"#|sep=", line)), None)
    if skipped is None:
        raise InputError(f"{path}: empty file; write a header and one row per line")
    separator = max(SEPARATORS, key=lines[skipped].count)
    header, *rows = [*csv.reader(io.StringIO("\n".join(lines[skipped : skipped + 2])), delimiter=separator)]
    if rows and len(rows[0]) > len(header):
        comma = "; with decimal commas, separate columns by semicolons" if separator == "," else ""
        raise InputError(f"{path}: row 1 has {len(rows[0])} fields, but the header {len(header)}{comma or '; mend it'}")
    decimal = "," if separator != "," and DECIMAL_COMMA.search("\n".join(lines[skipped + 1 :])) else "."
    return Form(encoding, skipped, header, separator, decimal)


def read_csv(
    path: Path, text_columns: Collection[str] = (), comment: str | None = None, rows: int | None = None
) -> "pd.DataFrame":
    r"""Read a text table with a header.

    Parameters
    ----------
    path : UTF-8 or UTF-16; fields separated by commas, semicolons or tabs; with these two, numbers may have decimal
        commas
    text_columns : columns that stay text
    comment : character that starts a comment within a line; by default only lines of `#` before the header are comments
    rows : that are read; all by default

    Returns
    -------
    table : its names stripped and in lower case

    Raises
    ------
    InputError
        If the file is missing, empty, not text or not a table, or a name occurs twice.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.csv"
    >>> _ = path.write_text("Name; X \nwest;1,5\n", encoding="utf-16")
    >>> read_csv(path, ["name"]).to_dict("records")
    [{'name': 'west', 'x': 1.5}]
    """
    import pandas as pd

    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a table")
    try:
        form = form_of(path)
        names = [name.strip().lower() for name in form.header]
        if twice := [name for number, name in enumerate(names) if name and name in names[:number]]:
            raise InputError(f"{path}: column {twice[0]} is there twice; keep one")
        table = pd.read_csv(
            path,
            sep=form.separator,
            decimal=form.decimal,
            encoding=form.encoding,
            skiprows=form.skipped,
            header=0,
            names=[name or f"unnamed {number}" for number, name in enumerate(names, 1)],
            dtype=dict.fromkeys((name for name in names if name in text_columns), str),
            skipinitialspace=True,
            comment=comment,
            nrows=rows,
        )
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise InputError(f"{path}: not UTF-8 text (byte 0x{byte:02x}); {SAVE}") from error
    except (OSError, pd.errors.ParserError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: cannot be read ({reason}); check that the file is whole") from error
    return table
