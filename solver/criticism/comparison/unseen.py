"""Power far from every known vehicle: patches of channels and time that the trajectories do not explain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.criticism.comparison.cells import Cells
from solver.criticism.comparison.windows import ladder, power_statistic, threshold
from solver.noise.sample_runs import blocks_of
from solver.run.run import Run

Array = NDArray[np.float64]

#: Patches that are looked for before they are joined.
MOST = 24
#: Patches closer than this belong together, s and channels.
APART = (3.0, 20)

#: Speeds that are tried, m/s along the fiber, and the width of the lines that are summed, m.
SPEEDS = np.concatenate([-np.geomspace(45, 2, 60), np.geomspace(2, 45, 60)])
LINE = 2.0
SHORTEST = 1.5  # seconds over which something must be seen to move


@dataclass(frozen=True)
class Patch:
    """Cells [sample, channel] bool, columns from first to last, statistic (sigmas), and speed along the fiber, m/s."""

    where: NDArray[np.bool_]
    columns: tuple[int, int]
    z: float
    speed: float | None


@dataclass(frozen=True)
class Box:
    """Samples rows[0] to rows[1] - 1 and channels columns[0] to columns[1] - 1, and the statistic."""

    rows: tuple[int, int]
    columns: tuple[int, int]
    z: float


def corner_sums(values: Array) -> Array:
    """Sums [sample + 1, channel + 1] over all cells above and left."""
    return np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)


def starts(size: int, length: int) -> NDArray[np.int64]:
    """First positions of windows of a length, a quarter of the length apart.

    >>> starts(10, 8).tolist()
    [0, 2]
    """
    return np.arange(0, size - length + 1, max(1, length // 4))


def best_box(energy: Array, number: Array, blocks: list[slice]) -> tuple[Box, int]:
    """The box of the largest power statistic, and how many boxes were looked at.

    Parameters
    ----------
    energy, number : [sample, channel], of each cell
    blocks : of consecutive samples, which no box leaves
    """
    best, count = Box((0, 0), (0, 0), 0.0), 0
    for block in blocks:
        sums = [corner_sums(part[block]) for part in (energy, number)]
        height, width = energy[block].shape
        for tall in ladder(height)[1:]:
            for wide in ladder(width)[1:]:
                top, left = np.ix_(starts(height, tall), starts(width, wide))
                parts = [
                    s[top + tall, left + wide] - s[top, left + wide] - s[top + tall, left] + s[top, left] for s in sums
                ]
                z = power_statistic(parts[0], parts[1])
                count += z.size
                if z.max(initial=0.0) > best.z:
                    i, j = np.unravel_index(int(z.argmax()), z.shape)
                    row, column = block.start + int(top[i, 0]), int(left[0, j])
                    best = Box((row, row + tall), (column, column + wide), float(z[i, j]))
    return best, count


def boxes_of(
    residual: Array, use: NDArray[np.bool_], cells: Cells, blocks: list[slice], false_alarm: float
) -> list[Box]:
    """Boxes with too much power, the strongest first, none overlapping in what it counts."""
    use, found = use.copy(), list[Box]()
    while len(found) < MOST:
        energy = np.where(use, residual**2, 0.0) / cells.level / cells.spread
        box, count = best_box(energy, use / cells.spread, blocks)
        if box.z <= threshold(max(count, 1), false_alarm):
            return found
        found.append(box)
        use[slice(*box.rows), slice(*box.columns)] = False
    return found


def joined(boxes: list[Box], margin: tuple[int, int]) -> list[list[Box]]:
    """Boxes in groups of neighbors, closer than `margin` samples and channels."""

    def close(one: Box, other: Box) -> bool:
        return all(
            max(a[0], b[0]) - min(a[1], b[1]) < limit
            for a, b, limit in ((one.rows, other.rows, margin[0]), (one.columns, other.columns, margin[1]))
        )

    groups: list[list[Box]] = []
    for box in boxes:
        near = [group for group in groups if any(close(box, other) for other in group)]
        groups = [group for group in groups if group not in near] + [[box, *(b for group in near for b in group)]]
    return groups


def speed_of(where: NDArray[np.bool_], residual: Array, time: Array, distance: Array, level: float) -> float | None:
    """Speed along the fiber, m/s, of what moves there; None where nothing moves.

    Slant stack: samples on lines of one speed are summed, as signals of what moves at it add up and noise does not.

    Parameters
    ----------
    where : [sample, channel] bool, the patch
    residual : [sample, channel], whitened
    time : [sample], s
    distance : [channel], m along the fiber
    level : mean square of the residual's noise
    """
    rows, columns = np.nonzero(where)
    if not len(rows) or time[rows[-1]] - time[rows[0]] < SHORTEST:
        return None
    t, s, values = time[rows] - time[rows].mean(), distance[columns], residual[where] / np.sqrt(level)
    coherence = []
    for speed in SPEEDS:
        line = np.floor((s - speed * t) / LINE).astype(int)
        line -= line.min()
        number = np.bincount(line)
        energy = np.bincount(line, values) ** 2 / np.maximum(number, 1)
        coherence.append(float(power_statistic(energy.sum(), np.array(float((number > 0).sum())))))
    best = int(np.argmax(coherence))
    return float(SPEEDS[best]) if coherence[best] > threshold(len(SPEEDS), 1e-3) else None


def unseen_windows(
    residual: Array, open_cells: NDArray[np.bool_], cells: Cells, run: Run, false_alarm: float
) -> list[Patch]:
    """Patches with too much power far from every known vehicle.

    Parameters
    ----------
    residual : [sample, channel], whitened
    open_cells : [sample, channel] bool, those to look at
    false_alarm : probability that noise makes a patch
    """
    result, use = run.result, open_cells & ~cells.approach.near
    boxes = boxes_of(residual, use, cells, blocks_of(result.samples), false_alarm)
    rate = run.facts["settings"]["sampling_rate"]
    distance = result.distance[np.searchsorted(result.channel, result.fitted_channel)]
    patches = []
    for group in joined(boxes, (round(APART[0] * rate), APART[1])):
        where = np.zeros_like(use)
        for box in group:
            where[slice(*box.rows), slice(*box.columns)] = True
        where &= use
        columns = (min(b.columns[0] for b in group), max(b.columns[1] for b in group) - 1)
        speed = speed_of(where, residual, run.time, distance, cells.floor)
        patches.append(Patch(where, columns, max(b.z for b in group), speed))
    return patches
