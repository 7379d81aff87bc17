"""How the misfit divides among channels, passes, a common kernel, noise, and the rest."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from solver.criticism.comparison.cells import Cells, lanes, strength
from solver.noise.sample_runs import blocks_of
from solver.noise.whitening import LONGEST
from solver.run.run import Run

Array = NDArray[np.float64]

#: Places where the kernel is free, m ahead of the vehicle; it is straight between them.
SPACING = 1.25
KNOTS = np.arange(-25.0, 25.1, SPACING)
CELLS = 400_000  # that are whitened at once, which keeps the columns below 300 MB
SOURCES = ("channel gain", "channel shift", "pass gain", "pass shift", "kernel")


@dataclass(frozen=True)
class Split:
    """Shares of chi2, each with the degrees of freedom that it spends discounted.

    Parameters
    ----------
    chi2 : sum of the squared whitened residuals
    samples : how many
    explained : source of `SOURCES` -> chi2 that it explains beyond what it would explain of noise
    freedom : source -> numbers that it spends
    noise : chi2 that noise alone leaves
    unexplained : the rest
    """

    chi2: float
    samples: int
    explained: dict[str, float]
    freedom: dict[str, int]
    noise: float
    unexplained: float

    def share(self, *sources: str) -> float:
        """Share of chi2 of some sources together."""
        return sum(self.explained[source] for source in sources) / max(self.chi2, 1e-300)


@dataclass(frozen=True)
class Columns:
    """Columns that are one field cut up by labels: cell i is in column labels[i] only, none where that is negative."""

    field: Array
    labels: NDArray[np.int64]
    count: int


def crossed(one: Columns, other: Columns) -> Array:
    """Products [column of one, column of other] without making the columns.

    >>> gain = Columns(np.array([1.0, 2.0, 3.0]), np.array([0, 1, 1]), 2)
    >>> crossed(gain, gain).tolist()
    [[1.0, 0.0], [0.0, 13.0]]
    """
    both = (one.labels >= 0) & (other.labels >= 0)
    joint = one.labels[both] * other.count + other.labels[both]
    flat = np.bincount(joint, one.field[both] * other.field[both], one.count * other.count)
    return np.asarray(flat.reshape(one.count, other.count))


def kernel_columns(drive: Array, cells: Cells, block: slice, skip: int) -> Array:
    """Whitened columns [lane and knot, sample, channel] of a block but its first `skip` samples.

    A column is the strength of the lane's vehicles times a hat of the distance ahead.

    One lane leaves another shape in the fiber than the other, so each lane has a kernel of its own.
    """
    lane, names = lanes(cells.approach)
    owner, strong = cells.approach.owner[block], drive[block]
    ahead = np.nan_to_num(cells.approach.ahead[block], nan=np.inf)
    columns = []
    for number in range(len(names)):
        own = np.where((owner >= 0) & (lane[owner] == number), strong, 0.0)
        hats = (np.clip(1 - np.abs(ahead - knot) / SPACING, 0, None) for knot in KNOTS)
        columns += [cells.whiten(own * hat, block)[skip:] for hat in hats]
    return np.array(columns)


def chunks(blocks: list[slice], rows: int) -> Iterator[tuple[slice, int]]:
    """Pieces of blocks of about so many rows, and how many rows at the start only serve as the noise's memory.

    >>> [(piece.start, piece.stop, skip) for piece, skip in chunks([slice(0, 150)], 100)]
    [(0, 100, 0), (60, 150, 40)]
    """
    for block in blocks:
        for first in range(block.start, block.stop, rows):
            skip = min(LONGEST, first - block.start)
            yield slice(first - skip, min(first + rows, block.stop)), skip


def normal_equations(run: Run, cells: Cells) -> tuple[Array, Array, list[slice]]:
    """Normal matrix and right-hand side of all sources, and where each is in them."""
    owner, drive = cells.approach.owner, strength(run, cells)
    channel = np.broadcast_to(np.arange(owner.shape[1]), owner.shape)
    plans = [
        (cells.gain, channel, owner.shape[1]),
        (cells.place, channel, owner.shape[1]),
        (cells.gain, owner, len(run.passes)),
        (cells.late, owner, len(run.passes)),
    ]
    counts = [*(count for *_, count in plans), len(KNOTS) * len(lanes(cells.approach)[1])]
    ends = np.cumsum([0, *counts])
    matrix, right = np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1])
    for block, skip in chunks(blocks_of(run.result.samples), max(4 * LONGEST, CELLS // owner.shape[1])):
        kernel = kernel_columns(drive, cells, block, skip).reshape(counts[-1], -1)
        block = slice(block.start + skip, block.stop)
        residual = cells.residual[block].ravel()
        parts = [Columns(field[block].ravel(), labels[block].ravel(), count) for field, labels, count in plans]
        alone = [Columns(row, np.zeros(len(residual), int), 1) for row in (*kernel, residual)]
        rows = [[*(crossed(a, b) for b in parts), np.hstack([crossed(a, k) for k in alone])] for a in parts]
        upper = np.vstack([np.hstack(row) for row in rows])
        matrix[: ends[-2], :] += upper[:, :-1]
        right[: ends[-2]] += upper[:, -1]
        matrix[ends[-2] :, ends[-2] :] += kernel @ kernel.T
        right[ends[-2] :] += kernel @ residual
    matrix[ends[-2] :, : ends[-2]] = matrix[: ends[-2], ends[-2] :].T
    return matrix, right, [slice(a, b) for a, b in pairwise(ends)]


def explained_by(matrix: Array, right: Array, use: NDArray[np.int64]) -> float:
    """Chi2 that least squares on the columns `use` explains."""
    scale = np.sqrt(matrix.diagonal()[use])
    normal = matrix[np.ix_(use, use)] / scale[:, None] / scale
    # A slight ridge separates sources that explain the same, as gains of all channels and of all passes do.
    factor = cho_factor(normal + 1e-7 * np.eye(len(use)))
    half = right[use] / scale
    return float(half @ cho_solve(factor, half)) if len(use) else 0.0


def fair_shares(worth: dict[frozenset[int], float], count: int) -> Array:
    """What each of `count` sources adds, averaged over all orders of taking them in.

    Shapley 1953, A value for n-person games; Lindeman, Merenda & Gold 1980, for variance.

    >>> fair_shares({frozenset(): 0.0, frozenset({0}): 3.0, frozenset({1}): 3.0, frozenset({0, 1}): 4.0}, 2).tolist()
    [2.0, 2.0]
    """
    shares = np.zeros(count)
    for source in range(count):
        others = [other for other in range(count) if other != source]
        for size in range(count):
            for chosen in combinations(others, size):
                without = frozenset(chosen)
                gain = worth[without | {source}] - worth[without]
                shares[source] += gain / (count * comb(count - 1, size))
    return shares


def split_of(run: Run, cells: Cells) -> Split:
    """Share the misfit out by successive least squares, averaged over the orders of the sources.

    Sources are a gain and a shift per channel, a gain and a delay per pass, and a kernel: any function of the distance
    ahead of the vehicle, the same for all passes of a lane. From what each explains, the chi2 that as many columns
    would explain of what is left is subtracted, so that of noise nothing is explained.
    """
    matrix, right, where = normal_equations(run, cells)
    # A column of no strength, such as that of a channel no vehicle came near, cannot be fitted.
    usable = matrix.diagonal() > 1e-9 * max(float(matrix.diagonal().max()), 1e-300)
    columns = [np.flatnonzero(usable[part]) + part.start for part in where]
    every = range(len(SOURCES))
    subsets = [frozenset(s) for size in range(len(SOURCES) + 1) for s in combinations(every, size)]
    raw = {s: explained_by(matrix, right, _joined(columns, s)) for s in subsets}
    chi2, samples = float((cells.residual**2).sum()), int(cells.there.sum())
    spent = sum(map(len, columns))
    left = (chi2 - raw[frozenset(every)]) / max(samples - spent, 1)
    shares = fair_shares(raw, len(SOURCES)) - left * np.array([len(c) for c in columns])
    explained = {name: max(0.0, float(share)) for name, share in zip(SOURCES, shares, strict=True)}
    noise = min(chi2, cells.floor * samples)
    total = sum(explained.values())
    # The sources cannot explain more than the misfit above the noise.
    scale = min(1.0, (chi2 - noise) / total) if total > 0 else 0.0
    explained = {name: scale * value for name, value in explained.items()}
    freedom = {name: len(c) for name, c in zip(SOURCES, columns, strict=True)}
    return Split(chi2, samples, explained, freedom, noise, chi2 - noise - sum(explained.values()))


def _joined(columns: Sequence[NDArray[np.int64]], chosen: frozenset[int]) -> NDArray[np.int64]:
    return np.concatenate([np.empty(0, int), *(columns[source] for source in sorted(chosen))]).astype(int)
