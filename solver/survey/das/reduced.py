"""Samples of a record in slabs of rows: unchanged, or filtered and decimated in a single pass."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.grid import FELT, Grid, Placed
from solver.survey.das.lowpass import Lowpass, taps_of
from solver.survey.das.units import Unit, to_strain_rate
from solver.survey.das.values import filled_cells, measured_runs
from vision.contract import InputError

#: Size of a slab in single precision, bytes: larger ones are not faster.
SLAB = 1 << 25
#: Quantities whose derivative in time is strain rate.
DERIVED = ("strain", "phase")

Values = NDArray[Any]
Take = Callable[[int, Values], None]
Rows = tuple[int, int]


@dataclass
class Lost:
    """What is not there although files should hold it.

    Parameters
    ----------
    faults : what could not be read, a line each
    rows : first and last row of the grid of each stretch in which nothing was measured
    cells : the same of single columns, with these columns
    """

    faults: list[str] = field(default_factory=list)
    rows: list[Rows] = field(default_factory=list)
    cells: list[tuple[int, int, NDArray[np.int64]]] = field(default_factory=list)


def slabs(grid: Grid, columns: slice, begin: int, end: int, lost: Lost) -> Iterator[tuple[int, Values]]:
    """Slabs of stored numbers [row, column] of the grid's rows `begin` to `end`, each with its first row; no gaps.

    What cannot be read, and rows in which nothing was measured, are left out and noted in `lost`; stretches in which
    some columns were not measured are noted alone.
    """
    rows = max(1, SLAB // (4 * max(1, columns.stop - columns.start)))
    for one in grid.placed:
        for first in range(max(one.row, begin), min(one.stop, end), rows):
            try:
                values = one.values(first, min(first + rows, one.stop, end), columns)
            except InputError as error:
                lost.faults.append(str(error))
                break
            done = 0
            for run in [*measured_runs(values), slice(len(values), None)]:
                if run.start > done:
                    lost.rows.append((first + done, first + run.start - 1))
                if run.stop is not None:
                    begin = first + run.start
                    lost.cells += [(begin + a, begin + b, which) for a, b, which in filled_cells(values[run])]
                    yield first + run.start, values[run]
                    done = run.stop


def overlapping(parts: Iterable[tuple[int, Values]], felt: int, look: Take) -> Iterator[tuple[int, Values, slice]]:
    """Slabs joined with their neighbors: each with up to `felt` rows more of its run on either side.

    Parameters
    ----------
    parts : first row of the grid, and values [row, column], of slabs in order; a run ends where rows are missing
    felt : rows that influence one
    look : called with each slab of `parts`

    Yields
    ------
    first row, values [row, column], and which of these rows are the slab's own: every row is in one slab's own

    >>> parts = [(0, np.zeros((3, 1))), (3, np.ones((2, 1))), (9, np.ones((1, 1)))]
    >>> [(row, len(values), own) for row, values, own in overlapping(parts, 1, lambda row, values: None)]
    [(0, 3, slice(0, 2, None)), (1, 4, slice(1, 3, None)), (3, 2, slice(1, 2, None)), (9, 1, slice(0, 1, None))]
    """
    held, start, done = np.empty((0, 0)), 0, 0
    for row, values in parts:
        look(row, values)
        if len(held) and row == start + len(held):
            held = np.concatenate([held, values])
        else:
            if done < start + len(held):
                yield start, held, slice(done - start, len(held))
            held, start, done = values, row, row
        stop = start + len(held) - felt
        if stop > done:
            yield start, held, slice(done - start, stop - start)
            cut = max(0, stop - felt - start)
            held, start, done = held[cut:].copy(), start + cut, stop
    if done < start + len(held):
        yield start, held, slice(done - start, len(held))


def filter_of(grid: Grid, factor: int, unit: Unit) -> Lowpass:
    """The low-pass filter before decimation; it also differentiates strain and phase."""
    taps = taps_of(factor)
    if unit.quantity not in DERIVED:
        return Lowpass(taps, factor, np.float32)
    impulse = np.zeros((2 * FELT + 1, 1))
    impulse[FELT] = 1.0
    # Phase reaches thousands of radians while neighbors differ by thousandths: double precision.
    rate = to_strain_rate(impulse, Unit("strain"), grid.sampling_rate, 1.0)[:, 0]
    return Lowpass(np.convolve(taps, rate), factor, np.float64)


def gain_of(unit: Unit, sampling_rate: float, gauge_length: float) -> float:
    """Strain rate, 1/s, per unit of a stored number, or of its time derivative."""
    rate = {"strain": "strain_rate", "phase": "phase_rate"}.get(unit.quantity, unit.quantity)
    rated = Unit(rate, unit.factor, unit.per_length)
    return float(to_strain_rate(np.ones((1, 1)), rated, sampling_rate, gauge_length)[0, 0])


def reduce(grid: Grid, columns: slice, low: Lowpass, span: tuple[int, int], look: Take, take: Take, lost: Lost) -> None:
    """Filter and decimate.

    Parameters
    ----------
    grid, columns : what is read
    low : the filter; output row k lies on row k q of the grid
    span : first output row, and one after the last
    look : called with each slab of stored numbers and its first row of the grid
    take : called with output [row, column] and its first row, but never with rows whose filter touches a gap
    lost : to which what is not there is added
    """
    half, q = low.half, low.factor
    held, start = np.empty((0, columns.stop - columns.start), low.dtype), 0
    for row, values in slabs(grid, columns, span[0] * q - half, (span[1] - 1) * q + half + 1, lost):
        look(row, values)
        values = values.astype(low.dtype, copy=False)
        if not (there := np.isfinite(values)).all():
            values = np.where(there, values, 0)  # `Reading.clear` makes gaps of what they reach.
        if row == start + len(held) and len(held):
            held = np.concatenate([held, values])
        else:
            held, start = values, row
        first = max(span[0], -(-(start + half) // q))
        stop = min(span[1], (start + len(held) - 1 - half) // q + 1)
        if stop > first:
            take(first, low(held, first * q - half - start, stop - first))
            done = stop * q - half - start
            held, start = held[done:].copy(), start + done


def touched(grid: Grid, spans: Sequence[tuple[int, int]]) -> list[Placed]:
    """The placed samples of files that lie in any of the row ranges of the grid."""
    return [one for one in grid.placed if any(one.row < end and one.stop > begin for begin, end in spans)]
