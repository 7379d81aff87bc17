"""Numbers that no fiber produces: too large, too small, clipped at the end of a range, or written without measuring."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.limits import FAINTEST, LOUDEST
from vision.contract import InputError

Array = NDArray[np.float64]

#: Samples at the end of the range that make a record clipped, and how many times rarer the next lower number must be:
#: without clipping the tails thin out, even of rounded numbers.
CLIPPED, THINNER = 20, 3
#: Channels that must hold them: a single one may be stuck.
CLIPPED_CHANNELS = 2
#: Chance that a run of one number in a slab is called filled where numbers are rounded and nothing is filled.
ALARM = 1e-3
#: Channels by which rows are looked through first, and rows by which channels that never change are left aside.
FIRST, SAMPLED = 16, 256
#: Roundings of a number by which three on a straight line may miss it: one each, the middle one counted twice.
DIGITS = 4


def check_size(swing: Array, where: Path) -> None:
    """Raise InputError where numbers cannot be strain rates.

    Parameters
    ----------
    swing : largest minus smallest value [channel], 1/s, of the channels that change

    >>> try: check_size(np.array([800.0, 900.0]), Path("a.h5"))
    ... except InputError as error: print(str(error).partition(";")[0])
    a.h5: strain rates of 4e+02 1/s, but the ground never strains faster than 0.1 1/s
    """
    size = float(np.median(swing)) / 2
    if size > LOUDEST:
        fault = f"strain rates of {size:.1g} 1/s, but the ground never strains faster than {LOUDEST:g} 1/s"
    elif size < FAINTEST:
        fault = f"strain rates of {size:.1g} 1/s at most, but no interrogator resolves less than {FAINTEST:g} 1/s"
    else:
        return
    raise InputError(f"{where}: {fault}; check the file's unit, and quantity and scale in [das] of site.toml")


def clipped_line(count: int, channels: int, which: str, end: float, beside: int) -> str | None:
    """Say that `count` samples are at an end of the range, if few are at the number next to it; else None."""
    if count <= THINNER * beside:
        return None
    return (
        f"{count} samples of {channels} channels stand at the same {which} number, {end:g}: either the record is "
        "clipped, and vehicles seem farther away than they are (record with a larger range), or the number fills what "
        "was not measured (write NaN there)"
    )


def same(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_]:
    """Where two arrays hold the same number, NaN included."""
    return np.asarray((one == other) | ((one != one) & (other != other)))


def measured_runs(values: NDArray[Any]) -> list[slice]:
    """Runs of rows of stored numbers [time, channel] in which something was measured.

    Nothing was measured where all channels hold one number (zeros of a dropout, of a tail that was allocated and never
    written, of a source file that is missing; NaN; a fill value), and where a row is repeated on all channels more than
    once. Noise makes neither. Of numbers rounded so coarsely that a quiet minute is all zeros, few channels change at
    the ends of such a run; where measuring ends, more than half do.

    >>> values = np.random.default_rng(0).normal(size=(9, 4))
    >>> values[3:5], values[7:] = 0, np.nan
    >>> measured_runs(values)
    [slice(0, 3, None), slice(5, 7, None)]
    """
    rows = len(values)
    some = values[:: max(1, rows // SAMPLED)]
    live = np.flatnonzero(~same(some, some[:1]).all(0))
    live = live if len(live) else np.arange(values.shape[1])
    if len(live) < 2 or rows < 2:
        return [slice(0, rows)] if rows else []
    few = values[:, live[np.unique(np.linspace(0, len(live) - 1, FIRST).astype(int))]]
    flat = np.asarray(same(few, few[:, :1]).all(1))
    flat[flat] = same(values[flat][:, live], values[flat][:, live[:1]]).all(1)
    held = np.concatenate([[False], same(few[1:], few[:-1]).all(1)])
    (again,) = np.nonzero(held)
    held[again] = same(values[again][:, live], values[again - 1][:, live]).all(1)
    # A slow record that is written at a higher rate repeats most of its rows; one repeat does less harm than a gap.
    often = 2 * np.count_nonzero(np.diff(held.astype(np.int8)) > 0) > np.count_nonzero(~held & ~flat)
    lost = flat | (held & (np.roll(held, 1) | np.roll(held, -1)) & ~often)

    def abrupt(row: int) -> bool:
        return not 0 < row < rows or float(same(values[row, live], values[row - 1, live]).mean()) < 0.5

    cuts = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    gone = [(a, b) for a, b in cuts.tolist() if abrupt(a if flat[a] else a - 1) and abrupt(b)]
    edges = [0, *(edge for pair in gone for edge in pair), rows]
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]


def straight(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Where numbers [time, channel] repeat the one before, or go on the straight line of the two before.

    Of numbers with a fraction: what is interpolated is straight to within their digits, which noise never is.

    >>> straight(np.array([[1.0, 3.0, 3.0, 4.0, 5.0, 9.0]]).T).ravel().tolist()
    [False, False, True, False, True, False]
    """
    found = np.zeros(values.shape, bool)
    found[1:] = values[1:] == values[:-1]
    if values.dtype.kind == "f":
        with np.errstate(invalid="ignore", over="ignore"):
            bend = np.abs(values[2:] - 2 * values[1:-1] + values[:-2])
            size = np.abs(values).max(0, where=np.isfinite(values), initial=0.0)
            found[2:] |= bend <= DIGITS * np.finfo(values.dtype).eps * size
    return found


def not_finite(values: NDArray[Any]) -> Iterator[tuple[int, int, int]]:
    """First and last row, and column, of each run of NaN or infinite numbers [time, channel]."""
    if values.dtype.kind != "f":
        return
    for column in np.flatnonzero(~np.isfinite(values).all(0)).tolist():
        bad = ~np.isfinite(values[:, column])
        edges = np.flatnonzero(np.diff(bad.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        yield from ((first, stop - 1, column) for first, stop in edges.tolist())


def filled_cells(values: NDArray[Any]) -> list[tuple[int, int, NDArray[np.int64]]]:
    """Stretches of stored numbers [time, channel] in which some channels were not measured while others were.

    They hold NaN, or one number, or lie on a straight line, while most change. Rounded numbers repeat, too. A number
    repeats with the chance that makes the longest run of the median channel the longest of its rows, or as often as the
    channel repeats its numbers elsewhere if that is more; a run that such chance makes more rarely than `ALARM` among
    all channels is filled. Of a rounded record, channels that hold one number for half of the rows may be quiet ones.
    Runs that most channels have over the very same rows tell nothing of that chance; it is then no less than the share
    of a channel's other numbers that are not new.

    Returns
    -------
    stretches : first and last row, and the channels that were not measured in between

    >>> values = np.random.default_rng(0).normal(size=(90, 4))
    >>> values[20:60, 2], values[70:80, :2] = 0, np.nan
    >>> filled_cells(values)
    [(70, 79, array([0, 1])), (20, 59, array([2]))]
    """
    found: dict[tuple[int, int], list[int]] = {}
    for first, last, column in not_finite(values):
        found.setdefault((first, last), []).append(column)
    step = max(1, len(values) // SAMPLED)
    some = values[::step]
    held = straight(some)
    if len(some) > 2 and held.any():
        run = np.zeros(some.shape, np.int64)
        for row in range(1, len(some)):
            run[row] = np.where(held[row], run[row - 1] + 1, 0)
        ends = held & ~np.vstack([held[1:], np.zeros(held.shape[1], bool)])
        shared = together(run, ends)
        alone = np.where(shared, 0, run)
        longest = alone.max(0)
        usual = float(np.median(longest)) + 1
        elsewhere = ((alone > 0).sum(0) - longest) / np.maximum(len(some) - 1 - longest, 1)
        for column in np.flatnonzero(shared.any(0)).tolist():
            others = some[~shared[:, column], column]
            elsewhere[column] = max(elsewhere[column], 1 - len(np.unique(others)) / max(len(others), 1))
        chance = np.minimum(np.maximum(len(some) ** (-1 / usual), elsewhere), 1 - 1 / len(some))
        rare = np.log(some.size / ALARM) / -np.log(chance)
        ends &= (run + 1 > rare) & ((usual == 1) | (2 * longest < len(some) - 1))
        for row, column in np.argwhere(ends).tolist():
            first, last = int(row - run[row, column]) * step, row * step
            if straight(values[first : last + 1, column : column + 1])[2:].all():
                rows = max(0, first - step + 1), min(len(values) - 1, last + step - 1)
                found.setdefault(rows, []).append(column)
    return [(*rows, np.array(columns)) for rows, columns in found.items()]


def together(run: NDArray[np.int64], ends: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which cells [row, channel] are of runs that begin and end as those of most channels do.

    Parameters
    ----------
    run : how many cells of the run lie before each [row, channel]
    ends : whether a run ends there
    """
    found = np.zeros(run.shape, bool)
    row, column = np.nonzero(ends)
    first = row - run[row, column]
    spans, which, count = np.unique(np.stack([first, row]), axis=1, return_inverse=True, return_counts=True)
    for number in np.flatnonzero(2 * count > run.shape[1]).tolist():
        begin, end = spans[:, number].tolist()
        found[begin : end + 1, column[which.ravel() == number]] = True
    return found
