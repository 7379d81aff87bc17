"""Read the numbers of a described record: all of them, or filtered and decimated while they are read."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.description import Description
from solver.survey.das.grid import FELT, merged
from solver.survey.das.lowpass import taps_of
from solver.survey.das.record import channel_ranges, filled_line
from solver.survey.das.reduced import DERIVED, Lost, Values, filter_of, gain_of, overlapping, reduce, slabs
from solver.survey.das.rounding import Rounding, rounding_of
from solver.survey.das.setting import logger
from solver.survey.das.size import require_room_for_record
from solver.survey.das.time_windows import Windows
from solver.survey.das.units import Unit, across_gauge, to_strain_rate
from solver.survey.das.values import check_size
from solver.survey.das.watch import Watch
from vision.contract import InputError, progress

Array = NDArray[np.float64]

AT_ONCE = 32  # channels converted together
LOOKED_AT = 4000  # fewest rows from which rounding is estimated


def without_dead(strain_rate: NDArray[Any], still: NDArray[np.bool_], told: Sequence[int], where: Path) -> None:
    """Set channels that never change, `still`, to NaN, in place: they measure nothing."""
    if still.all():
        raise InputError(f"{where}: no channel holds a signal; check channels and exclude in [das] of site.toml")
    # Not numpy.nanmax: of some channels it takes a copy of the record.
    swing = np.fmax.reduce(strain_rate, axis=0) - np.fmin.reduce(strain_rate, axis=0)
    check_size(swing[~still].astype(np.float64), where)
    if len(told):
        logger.warning("%s: left out, since they never change: %s", where, channel_ranges(np.asarray(told)))
    strain_rate[:, still] = np.nan


@dataclass(frozen=True)
class Found:
    """The result: strain rate [row, channel] at windows of every `factor`-th row of the grid.

    `lost` are the first and last row of the grid of each stretch in which nothing was measured.
    """

    values: NDArray[Any]
    windows: Windows
    factor: int
    rounding: Rounding | None
    cautions: tuple[str, ...]
    lost: list[tuple[int, int]]


@dataclass(frozen=True)
class Reading:
    """A reading of some channels and row ranges of a record."""

    known: Description
    channel: NDArray[np.int64]
    columns: slice
    excluded: NDArray[np.bool_]
    spans: list[tuple[int, int]]

    @classmethod
    def all_of(cls, known: Description) -> "Reading":
        """All channels and rows of a record."""
        excluded = np.isin(known.channel, known.exclude)
        return cls(known, known.channel, known.columns(known.channels), excluded, [(0, known.grid.rows)])

    def stored(self) -> Unit:
        """The unit of what is filtered: strain rate if velocity is differenced first."""
        stored = self.known.stored
        return Unit("strain_rate", stored.factor) if self.known.pair else stored

    def narrowed(self, values: NDArray[Any]) -> NDArray[Any]:
        """Velocity [time, column] differenced to strain rate [time, channel]; anything else as it is."""
        if not self.known.pair:
            return values
        velocity = values.astype(np.float64, copy=False)
        return across_gauge(velocity, self.known.channel_spacing, self.known.gauge_length)[0]

    def paired(self, told: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """True for a channel [channel] if it is true for both columns [column] that the channel is made from."""
        n = self.known.pair
        return told[2 * n :] & told[: len(told) - 2 * n] if n else told

    def convert(self, values: NDArray[Any], own: slice, rate: NDArray[np.float32]) -> None:
        """Write strain rate [time, channel], 1/s, at the rows `own` of gapless stored numbers [time, column]."""
        sampling_rate, gauge_length, n = self.known.grid.sampling_rate, self.known.gauge_length, self.known.pair
        # In double precision, and a derivative takes ten times the memory of its input: few channels at once.
        for first in range(0, rate.shape[1], AT_ONCE):
            some = self.narrowed(values[:, first : first + AT_ONCE + 2 * n].astype(np.float64))
            some[~np.isfinite(some)] = 0.0  # `clear` makes a gap of it
            rate[:, first : first + AT_ONCE] = to_strain_rate(some, self.stored(), sampling_rate, gauge_length)[own]

    def empty(self, rows: int, factor: int = 1) -> tuple[NDArray[np.float32], Watch]:
        """Strain rate [row, channel] of NaN, to be filled, and a watch for `factor` times as many rows."""
        require_room_for_record(rows, len(self.channel), self.known.where)
        return np.full((rows, len(self.channel)), np.nan, np.float32), Watch(max(1, rows * factor // LOOKED_AT))

    def whole(self) -> Found:
        """Every sample, in single precision."""
        grid, stored = self.known.grid, self.stored()
        windows = Windows.of(self.spans, grid.sampling_rate)
        grid.check_dense(windows.spans)
        rate, watch, lost = *self.empty(windows.rows), Lost()
        felt = FELT if stored.quantity in DERIVED else 0
        with progress("reading DAS", windows.rows) as advance:
            for low, high in self.spans:
                for row, values, own in overlapping(slabs(grid, self.columns, low, high, lost), felt, watch.look):
                    first, count = windows.place(row + own.start), own.stop - own.start
                    self.convert(values, own, rate[first : first + count])
                    advance(count)
        filled = self.clear(rate, windows.grid_rows, lost, felt, watch)
        rounding, cautions = self.checked(rate, watch, lost, filled)
        return Found(rate, windows, 1, rounding, cautions, merged(lost.rows))

    def reduced(self, factor: int) -> Found:
        """Filtered, every `factor`-th sample, in single precision."""
        known, grid, stored = self.known, self.known.grid, self.stored()
        low = filter_of(grid, factor, stored)
        spans = [(-(-begin // factor), (end - 1) // factor + 1) for begin, end in self.spans]
        windows = Windows.of(spans, grid.sampling_rate / factor)
        grid.check_dense([(begin * factor, end * factor) for begin, end in windows.spans])
        rate, watch, lost = *self.empty(windows.rows, factor), Lost()
        gain = gain_of(stored, grid.sampling_rate, known.gauge_length)
        with progress("reading DAS", windows.rows) as advance:

            def take(row: int, values: Values) -> None:
                first = windows.place(row)
                rate[first : first + len(values)] = gain * self.narrowed(values)
                advance(len(values))

            for span in spans:
                reduce(grid, self.columns, low, span, watch.look, take, lost)
        filled = self.clear(rate, factor * windows.grid_rows, lost, low.half, watch)
        rounding, cautions = self.checked(rate, watch, lost, filled)
        taps = taps_of(factor)
        rounding = rounding and rounding.filtered(taps / taps.sum(), factor)
        return Found(rate, windows, factor, rounding, cautions, merged(lost.rows))

    def clear(
        self, rate: NDArray[np.float32], at: NDArray[np.int64], lost: Lost, reach: int, watch: Watch
    ) -> NDArray[np.bool_]:
        """Set strain rate [row, channel] to NaN, in place, where a channel was not measured; which channels [channel].

        Parameters
        ----------
        at : row of the grid [row]
        lost : what was found while reading
        reach : rows of the grid that influence one on either side
        watch : of the same rows; velocity that never changes is that of a fixed end
        """
        fixed = np.zeros(self.columns.stop - self.columns.start, bool)
        if self.known.pair:
            fixed |= watch.still & (watch.bad == 0)
        gone = np.zeros(len(self.channel), bool)
        for first, last, columns in lost.cells:
            measured = np.ones(len(fixed), bool)
            measured[columns] = fixed[columns]
            here = ~self.paired(measured)
            rate[slice(*np.searchsorted(at, [first - reach, last + reach + 1])), here] = np.nan
            gone |= here
        return gone

    def checked(
        self, rate: NDArray[np.float32], watch: Watch, lost: Lost, filled: NDArray[np.bool_]
    ) -> tuple[Rounding | None, tuple[str, ...]]:
        """Refuse numbers that no fiber makes, and set dead channels of `rate` to NaN; its rounding, and cautions."""
        known, stored = self.known, self.stored()
        if watch.bad is None or not len(watch.kept):
            nothing = "no channel holds a signal in any sample" if lost.rows else "no samples; check the clocks"
            raise InputError([*lost.faults, *known.lines, f"{known.where}: {nothing}"][0])
        if not np.isfinite(rate).any():
            raise InputError(f"{known.where}: too few samples without a gap; give a longer record")
        cut_off = watch.clipped()
        rounding = rounding_of(self.narrowed(watch.looked_at), stored, known.grid.sampling_rate, known.gauge_length)
        still = self.paired(watch.still) | self.excluded
        without_dead(rate, still, self.channel[still & ~self.excluded].tolist(), known.where)
        return rounding, (*([cut_off] if cut_off else []), *lost.faults, *filled_line(self.channel[filled & ~still]))
