"""Numbers that no fiber produces: too large, too small, clipped at the end of a range, or written without measuring."""

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


def filled_cells(values: NDArray[Any]) -> list[tuple[int, int, NDArray[np.int64]]]:
    """Stretches of stored numbers [time, channel] in which some channels hold one number while most change.

    Rounded numbers repeat, too. A number repeats with the chance that makes the longest run of the median channel the
    longest of its rows, or as often as the channel repeats its numbers elsewhere if that is more; a run that such
    chance makes more rarely than `ALARM` among all channels is filled. Of a rounded record, channels that hold one
    number for half of the rows may be quiet ones.

    Returns
    -------
    stretches : first and last row, and the channels that were not measured in between

    >>> values = np.random.default_rng(0).normal(size=(90, 4))
    >>> values[20:60, 2] = 0
    >>> filled_cells(values)
    [(20, 59, array([2]))]
    """
    step = max(1, len(values) // SAMPLED)
    some = values[::step]
    if len(some) < 3:
        return []
    held = np.asarray(some[1:] == some[:-1])
    if not held.any():
        return []
    run = np.zeros(some.shape, np.int64)
    for row, again in enumerate(held, 1):
        run[row] = np.where(again, run[row - 1] + 1, 0)
    longest = run.max(0)
    usual = float(np.median(longest)) + 1
    elsewhere = (held.sum(0) - longest) / np.maximum(len(held) - longest, 1)
    chance = np.minimum(np.maximum(len(some) ** (-1 / usual), elsewhere), 1 - 1 / len(some))
    rare = np.log(some.size / ALARM) / -np.log(chance)
    ends = (run + 1 > rare) & ~np.vstack([held, np.zeros(held.shape[1], bool)])
    ends &= (usual == 1) | (2 * longest < len(held))
    found: dict[tuple[int, int], list[int]] = {}
    for row, column in np.argwhere(ends).tolist():
        first, last = int(row - run[row, column]) * step, row * step
        if (values[first : last + 1, column] == values[first, column]).all():
            rows = max(0, first - step + 1), min(len(values) - 1, last + step - 1)
            found.setdefault(rows, []).append(column)
    return [(*rows, np.array(columns)) for rows, columns in found.items()]
