"""Health of a part of a record, and of all parts together: noise, dead and faulty channels, clipping, rounding."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.reduced import Lost
from solver.survey.das.watch import End, Watch

if TYPE_CHECKING:
    import h5py

Array = NDArray[np.float64]

#: Standard deviation over median absolute deviation of normal noise, and rows from which noise is estimated.
NORMAL, ROWS = 1.4826, 1000


def noise_of(strain_rate: NDArray[Any]) -> Array:
    """Standard deviation of the noise [channel], 1/s, from strain rate [time, channel] with little traffic.

    >>> rate = np.random.default_rng(0).normal(0, 3e-9, (4000, 2))
    >>> [f"{level:.0e}" for level in noise_of(rate)]
    ['3e-09', '3e-09']
    """
    some = strain_rate[:: max(1, len(strain_rate) // ROWS)]
    some = some[np.isfinite(some).any(1)]
    if not len(some):
        return np.full(strain_rate.shape[1], np.nan)
    return np.asarray(NORMAL * np.median(np.abs(np.nan_to_num(some)), 0), np.float64)


@dataclass(frozen=True)
class PartHealth:
    """Health of one part.

    Parameters
    ----------
    noise : standard deviation [channel], 1/s, at the store's rate
    smallest, largest : stored number [column]
    bad : NaN and infinite numbers [column]
    looked_at : a few rows of stored numbers [row, column], from which rounding is estimated
    ends : how often the largest and the smallest number occur, and the numbers next to them
    filled : channels [channel] that were not measured all the time
    faults : what could not be read, a line each
    lost : first and last row of the files of each stretch in which nothing was measured
    """

    noise: Array
    smallest: Array
    largest: Array
    bad: NDArray[np.int64]
    looked_at: NDArray[Any]
    ends: tuple[End, End]
    filled: NDArray[np.bool_]
    faults: tuple[str, ...]
    lost: tuple[tuple[int, int], ...] = ()

    @classmethod
    def of(
        cls, watch: Watch, strain_rate: NDArray[Any], lost: Lost, columns: int, filled: NDArray[np.bool_]
    ) -> "PartHealth":
        """From what was collected while the part was read."""
        gone = filled, tuple(lost.faults), tuple(lost.rows)
        if watch.bad is None or watch.smallest is None or watch.largest is None:
            none = np.full(columns, np.nan)
            empty, zero = np.empty((0, columns)), np.zeros(columns, np.int64)
            return cls(noise_of(strain_rate), none, none, zero, empty, watch.ends, *gone)
        looked = np.concatenate(watch.kept)
        return cls(noise_of(strain_rate), watch.smallest, watch.largest, watch.bad, looked, watch.ends, *gone)

    def write(self, group: "h5py.Group") -> None:
        """Write it into a group of an HDF5 file."""
        for name in ("noise", "smallest", "largest", "bad", "looked_at", "filled"):
            group[name] = getattr(self, name)
        for end, name in zip(self.ends, ("highest", "lowest"), strict=True):
            count = np.zeros(len(self.bad), np.int64) if end.count is None else end.count
            node = group.create_dataset(name, data=count)
            node.attrs.update(number=end.extreme, next=end.next, next_count=end.next_count)
        group["lost"] = np.array(self.lost, np.int64).reshape(-1, 2)
        group.attrs["faults"] = list(self.faults) or np.empty(0, "S1")

    @classmethod
    def read(cls, group: "h5py.Group") -> "PartHealth":
        """Read it back."""
        ends = []
        for sign, name in ((1, "highest"), (-1, "lowest")):
            said = group[name].attrs
            numbers = float(said["number"]), group[name][:], float(said["next"]), int(said["next_count"])
            ends.append(End(sign, *numbers))
        arrays = {name: group[name][:] for name in ("noise", "smallest", "largest", "bad", "looked_at", "filled")}
        faults = tuple(str(one) for one in group.attrs["faults"])
        lost = tuple((int(first), int(last)) for first, last in group["lost"][:])
        return cls(**arrays, ends=(ends[0], ends[1]), faults=faults, lost=lost)


def joined(parts: Sequence[PartHealth]) -> tuple[Watch, Array]:
    """The health of all parts combined, and the noise [channel]: the median over the parts."""
    whole = Watch(1)
    known = [one for one in parts if np.isfinite(one.smallest).any()]
    if not known:
        return whole, np.full(len(parts[0].noise), np.nan)
    whole.smallest = np.min([one.smallest for one in known], 0)
    whole.largest = np.max([one.largest for one in known], 0)
    whole.bad = np.sum([one.bad for one in known], 0)
    whole.kept = [one.looked_at for one in known]
    whole.ends = (together([one.ends[0] for one in known]), together([one.ends[1] for one in known]))
    return whole, np.median([one.noise for one in known], 0)


def together(ends: Sequence[End]) -> End:
    """One end of the range, combined over several parts."""
    best = End(ends[0].sign, max(one.extreme for one in ends), np.zeros_like(ends[0].count))
    for one in ends:
        if one.extreme == best.extreme and one.count is not None and best.count is not None:
            best.count += one.count
    below = [(one.next, one.next_count) for one in ends if np.isfinite(one.next)]
    below += [
        (one.extreme, int(one.count.sum())) for one in ends if one.extreme < best.extreme and one.count is not None
    ]
    if below:
        best.next = max(number for number, _ in below)
        best.next_count = sum(count for number, count in below if number == best.next)
    return best
