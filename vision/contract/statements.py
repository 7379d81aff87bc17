"""What a file states about itself, what is taken of it, and where two statements differ."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

#: A number, a time in UTC, or words.
Value = float | int | str | np.datetime64
#: What differs from file to file of one recording.
TIMES = ("start", "end")
#: Statements about one thing, each with the place in the file where it stands.
Said = Sequence[tuple[str, Value]]


@dataclass(frozen=True)
class Statement:
    """One thing that a file states.

    Parameters
    ----------
    what : that is stated, such as "rate"
    stated : in which place of the file, and what is stated there, in words
    taken : what is used, in words; empty where nothing is
    caution : how two statements differ, or what else the user must know; empty where all is well
    """

    what: str
    stated: tuple[tuple[str, str], ...]
    taken: str
    caution: str = ""


def worded(value: Value, unit: str = "") -> str:
    """A value in words.

    >>> worded(5.0, "Hz"), worded(np.datetime64("2025-08-11T06:00:00.200", "ns"))
    ('5 Hz', '2025-08-11T06:00:00.200Z')
    """
    if isinstance(value, np.datetime64):
        text = str(np.datetime_as_string(value, unit="us"))
        return f"{text.removesuffix('000')}Z"
    if isinstance(value, str):
        return value
    return f"{value:.10g} {unit}".strip()


def statement(
    what: str, said: Said, taken: Value | None, *, unit: str = "", within: float = 0.0, absolute: bool = False
) -> Statement:
    """Hold what is stated about one thing against what is taken.

    Parameters
    ----------
    what : that is stated
    said : the statements
    taken : what is used; words, or None, are compared with nothing
    unit : of numbers
    within : by which numbers may differ: relative, or `absolute`; s for times

    >>> statement("rate", [("OutputDataRate", 5.0), ("PartEndTime", 3.975)], 5.0, unit="Hz", within=1e-3).caution
    'PartEndTime says 3.975 Hz; 5 Hz is taken'
    """

    def differs(value: Value) -> bool:
        if isinstance(value, np.datetime64) and isinstance(taken, np.datetime64):
            return bool(abs((value - taken) / np.timedelta64(1, "s")) > within)
        if isinstance(value, int | float) and isinstance(taken, int | float):
            return abs(value - taken) > within * (1.0 if absolute else abs(taken))
        return False

    odd = [f"{place} says {worded(value, unit)}" for place, value in said if differs(value)]
    words = "" if taken is None else worded(taken, unit)
    caution = f"{', '.join(odd)}; {words} is taken" if odd else ""
    return Statement(what, tuple((place, worded(value, unit)) for place, value in said), words, caution)


@dataclass(frozen=True)
class Statements:
    """What one file states, what is taken of it, and where statements differ: the same table everywhere.

    Parameters
    ----------
    file : its name
    rows : a statement per line of the table
    """

    file: str
    rows: tuple[Statement, ...]

    @property
    def cautions(self) -> list[str]:
        """Where statements differ, a line each, without the file's name."""
        return [f"{one.what}: {one.caution}" for one in self.rows if one.caution]

    @property
    def table(self) -> "pd.DataFrame":
        """A row per statement: what, stated, taken, caution."""
        import pandas as pd

        return pd.DataFrame(
            [(one.what, stated_words(one), one.taken, one.caution) for one in self.rows],
            columns=["what", "stated", "taken", "caution"],
        )

    def lines(self) -> list[str]:
        """What a terminal shows."""
        wide = max((len(one.what) for one in self.rows), default=0)
        shown = [f"  {one.what:{wide}}  {one.taken or '-'}{beside(one)}" for one in self.rows]
        return [f"{self.file} states, and taken is:", *shown]

    def html(self) -> str:
        """The table as a part of a page."""
        cells = "".join(
            f"<tr><th scope='row'>{escape(one.what)}</th><td>{escape(one.taken)}</td>"
            f"<td>{escape(stated_words(one))}</td><td>{escape(one.caution)}</td></tr>"
            for one in self.rows
        )
        head = "<tr><th></th><th>taken</th><th>stated</th><th></th></tr>"
        return f"<table class='statements'><caption>{escape(self.file)}</caption>{head}{cells}</table>"

    def to_dict(self) -> dict[str, Any]:
        """As plain values, which `of` reads back."""
        return {"file": self.file, "rows": [asdict(one) for one in self.rows]}

    @classmethod
    def of(cls, found: Mapping[str, Any]) -> "Statements":
        """Read back what `to_dict` gave.

        >>> one = Statements("a.h5", (statement("rate", [("dt", 5.0)], 5.0, unit="Hz"),))
        >>> Statements.of(one.to_dict()) == one
        True
        """
        rows = [
            Statement(
                row["what"], tuple((place, value) for place, value in row["stated"]), row["taken"], row["caution"]
            )
            for row in found["rows"]
        ]
        return cls(str(found["file"]), tuple(rows))


def stated_words(one: Statement) -> str:
    """What is stated in each place."""
    return ", ".join(f"{place} {value}" for place, value in one.stated)


def beside(one: Statement) -> str:
    """What is stated, in brackets, and a mark where statements differ."""
    return (f" ({stated_words(one)})" if one.stated else "") + (f"  ! {one.caution}" if one.caution else "")


def caution_lines(files: Sequence[Statements]) -> list[str]:
    """Cautions of several files, those of many files said once.

    >>> odd = statement("rate", [("dt", 4.0)], 5.0, unit="Hz")
    >>> caution_lines([Statements(name, (odd,)) for name in ("a.h5", "b.h5")])
    ['a.h5 and 1 more: rate: dt says 4 Hz; 5 Hz is taken']
    """
    found: dict[str, list[str]] = {}
    for one in files:
        for line in one.cautions:
            found.setdefault(line, []).append(one.file)
    others = {line: f" and {len(names) - 1} more" if len(names) > 1 else "" for line, names in found.items()}
    return [f"{names[0]}{others[line]}: {line}" for line, names in found.items()]


def told_once(files: Sequence[Statements]) -> tuple[list[Statements], str]:
    """The table of the first file of each kind, of others what they state differently but for their times, and a count.

    Files of one kind have a statement in common: those of a record do, and those of tracks.

    >>> das, tracks = (statement("rate", (), rate, unit="Hz") for rate in (5.0, 12.5))
    >>> files = [Statements(name, (das,)) for name in ("a.h5", "b.h5")] + [Statements("t.csv", (tracks,))]
    >>> [one.file for one in told_once(files)[0]], told_once(files)[1]
    (['a.h5', 't.csv'], '1 more of the files state the same but for their times')
    """
    firsts, shown, alike = list[Statements](), list[Statements](), 0
    for file in files:
        rows = [one for one in file.rows if one.what not in TIMES]
        usual = next((one.rows for one in firsts if not set(rows).isdisjoint(one.rows)), None)
        if usual is None:
            firsts.append(file)
            shown.append(file)
        elif odd := tuple(one for one in rows if one not in usual):
            shown.append(Statements(file.file, odd))
        else:
            alike += 1
    line = f"{alike} more of the files state the same but for their times" if alike else ""
    return shown, line


def table_lines(files: Sequence[Statements]) -> list[str]:
    """What a terminal shows of several files."""
    shown, alike = told_once(files)
    return [*(line for one in shown for line in one.lines()), *([alike] if alike else [])]


def table_html(files: Sequence[Statements]) -> str:
    """What a page shows of several files, folded up; nothing where there are none."""
    shown, alike = told_once(files)
    tables = "".join(one.html() for one in shown) + (f"<p>{alike}.</p>" if alike else "")
    return f"<details><summary>What each file states, and what is taken</summary>{tables}</details>" if files else ""
