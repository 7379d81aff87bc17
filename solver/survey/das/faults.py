"""Which files of a record cannot be used with the others, and why."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from solver.survey.das.grid import Part, Placed
from solver.survey.das.setting import RATE_OFF, file_spacing
from vision.contract import InputError

#: Share of the recorded samples that the files of one setting must hold for the others to be left out.
MOST = 0.5
#: Share of the recorded samples that may be left out where files overlap and differ.
OVERLAP = 0.05
#: Channels and samples by which files that overlap are compared.
COMPARED, SAMPLES = 32, 2000
#: How many left-out files a message names.
NAMED = 3


@dataclass(frozen=True)
class LeftOut:
    """A file, or a part of one, that is not used, and the reason, which does not repeat its name."""

    path: Path
    why: str


def left_out_line(files: int, left_out: Sequence[LeftOut]) -> list[str]:
    """Say which of so many files are left out, and why; nothing if none is.

    >>> left_out_line(60, [LeftOut(Path("das/a.h5"), "an empty file, 0 bytes; copy it again")])
    ['of 60 files this is left out: a.h5 (an empty file, 0 bytes; copy it again)']
    """
    if not left_out:
        return []
    named = ", ".join(f"{one.path.name} ({one.why})" for one in left_out[:NAMED])
    more = f", and {len(left_out) - NAMED} more" if len(left_out) > NAMED else ""
    return [f"of {files} files this is left out: {named}{more}"]


def difference(one: Part, other: Part) -> str | None:
    """How the settings of two files differ, those of `other` first; None if they agree."""
    a, b = one.block, other.block
    for name, first, second in (
        ("channels", a.data.shape[1], b.data.shape[1]),
        ("first channel", a.first_channel, b.first_channel),
        ("quantity and scale", a.unit, b.unit),
        ("gauge length", a.gauge_length, b.gauge_length),
        ("channel spacing", file_spacing(a), file_spacing(b)),
    ):
        floats = isinstance(first, float) and isinstance(second, float)
        if not (np.isclose(first, second) if floats else first == second):  # type: ignore[arg-type]
            return f"{name} {second}, but {first} in {a.path.name}"
    if abs(other.interval / one.interval - 1) > RATE_OFF:
        return f"{1e9 / other.interval:g} samples/s, but {1e9 / one.interval:g} in {a.path.name}"
    return None


def of_one_setting(parts: Sequence[Part]) -> tuple[list[Part], list[LeftOut]]:
    """Keep the files of the setting with which most samples were recorded.

    Raises
    ------
    InputError
        If no setting has more than half of the samples, so that none can be preferred.
    """
    groups: list[list[Part]] = []
    for part in parts:
        alike = next((group for group in groups if difference(group[0], part) is None), None)
        if alike is None:
            groups.append([part])
        else:
            alike.append(part)
    seconds = [sum(len(part.block.data) * part.interval for part in group) for group in groups]
    kept = groups[int(np.argmax(seconds))]
    others = [part for group in groups if group is not kept for part in group]
    if others and max(seconds) <= MOST * sum(seconds):
        one, other = groups[0][0], groups[1][0]
        raise InputError(f"{other.block.path}: {difference(one, other)}; give files of one recording")
    return kept, [LeftOut(part.block.path, str(difference(kept[0], part))) for part in others]


def alike(one: Placed, other: Placed, begin: int, end: int) -> bool:
    """Whether two files hold the same numbers at the rows `begin` to `end` of the grid."""
    count = one.block.data.shape[1]
    some = slice(count // 2, min(count, count // 2 + COMPARED))
    end = min(end, begin + SAMPLES)
    try:
        return bool(np.array_equal(one.values(begin, end, some), other.values(begin, end, some)))
    except InputError:
        return False


def trimmed(one: Placed, begin: int, end: int) -> Iterator[Placed]:
    """The samples of a file between two rows of the grid; nothing if there are none."""
    begin, end = max(begin, one.row), min(end, one.stop)
    if end > begin:
        skip = begin - one.row
        # Samples off the grid are located by their distance from the file's first sample, which stays in place.
        if one.ahead:
            yield replace(one, row=begin, rows=end - begin, ahead=one.ahead + skip)
        else:
            yield replace(one, first=one.first + skip, count=end - begin, row=begin, rows=end - begin)


def without_overlaps(placed: Sequence[Placed], interval: float) -> tuple[list[Placed], list[LeftOut]]:
    """Use samples that two files share once; leave them out where the files differ, because a clock has jumped.

    Parameters
    ----------
    placed : sorted by row
    interval : of sampling, ns

    Raises
    ------
    InputError
        If files that differ overlap for more than a twentieth of the record.
    """
    kept: list[Placed] = []
    told: list[LeftOut] = []
    lost, measured = 0, sum(one.rows for one in placed)
    for one in placed:
        if not kept or one.row >= kept[-1].stop:
            kept.append(one)
            continue
        before = kept.pop()
        begin, end = one.row, min(before.stop, one.stop)
        length = f"{(end - begin) * interval * 1e-9:.3g} s"
        if alike(before, one, begin, end):
            told.append(LeftOut(one.block.path, f"{length} that {before.block.path.name} holds too are taken once"))
            kept += [before, *trimmed(one, before.stop, one.stop)]
            continue
        lost += end - begin
        if lost > OVERLAP * measured:
            raise InputError(
                f"{one.block.path}: overlaps {before.block.path.name} in time for {length}, with other numbers; give "
                "each recording once"
            )
        told.append(
            LeftOut(
                one.block.path,
                f"{length} overlap {before.block.path.name} with other numbers, so that a clock was set back: neither "
                "is used there, and times on one side are off by as much; check them against the camera",
            )
        )
        kept += [*trimmed(before, before.row, begin), *trimmed(one, end, one.stop), *trimmed(before, end, before.stop)]
    return kept, told
