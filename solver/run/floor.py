"""What noise alone would leave of the misfit, and by how much that scatters."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.fit.problem import Problem
from solver.fit.robust import HUBER
from solver.noise.quiet_windows import quiet, whitened_noise
from solver.noise.whitening import Whitener, measured_rows

CHANNELS = 400  # whose quiet samples are whitened at once
ENOUGH_QUIET = 200  # samples; the mean square of fewer is uncertain by more than 10 %
BLOCKS = 32  # that the scatter is estimated from at least

Rows = slice | NDArray[np.int64]


@dataclass(frozen=True)
class Floor:
    """Chi2 per degree of freedom that noise alone would leave.

    Parameters
    ----------
    value : mean square of the whitened quiet samples, above 1 where the noise has heavy tails or is not stationary
    samples : how many there are
    spread : variance of a mean of n such squares, times n: 2 for white Gaussian noise, more where samples depend on
        each other or the noise changes
    bound : whether noise leaves `value` at most: how much of the error of rounding shows beside vehicles is not known
    """

    value: float
    samples: int
    spread: float
    bound: bool = False

    def scatter(self, freedom: float) -> float:
        """Standard deviation of the chi2 per degree of freedom of so many samples about this estimate of the floor."""
        return float(np.sqrt(self.spread * (1 / self.samples + 1 / freedom)))


def noise_floor(problem: Problem) -> Floor | None:
    """Measure the noise floor on samples with no vehicle near, with the fit's own Huber weights; None if too few."""
    rows = measured_rows(problem.record, len(problem.law.own))
    square, count = np.zeros(len(problem.record))[rows], np.zeros(len(problem.record))[rows]
    for first in range(0, len(problem.channel), CHANNELS):
        white, alone = quiet_whitened(problem, slice(first, first + CHANNELS), rows)
        size = np.where(alone, np.abs(white), 0.0)
        square += (size * np.minimum(size, HUBER)).sum(1)
        count += alone.sum(1)
    total = float(count.sum())
    if total < ENOUGH_QUIET:
        return None
    value = float(square.sum()) / total
    spread = block_variance(square - value * count) / total
    return Floor(value, int(total), spread, bound=bool(problem.law.hidden[0] > 0))


def block_variance(row: NDArray[np.float64]) -> float:
    """Variance of the sum of a series [row] of mean 0 whose rows may depend on each other.

    Blocks of rows are made longer until few are left; their sums' squares grow until blocks are as long as the rows
    remember (Flyvbjerg and Petersen 1989, J. Chem. Phys. 91, 461).

    >>> white = np.random.default_rng(0).normal(size=4096)
    >>> slow = np.repeat(white, 8)
    >>> 1 < block_variance(white) / 4096 < 1.5, 60 < block_variance(slow) / 4096 < 90
    (True, True)
    """
    largest, length = 0.0, 1
    while -(-len(row) // length) >= BLOCKS:
        sums = np.add.reduceat(row, np.arange(0, len(row), length))
        largest, length = max(largest, float((sums**2).sum())), 2 * length
    return largest


def quiet_whitened(problem: Problem, part: slice, rows: Rows) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The whitened record of some channels and rows, and where it is noise alone, [sample, channel]."""
    still = quiet(len(problem.record), problem.start[part], problem.passes, problem.gauge_length)[rows]
    record = with_hidden(problem, part, rows)
    whiten = Whitener(problem.noise[part], np.arange(len(record)), problem.channel[part], problem.law)
    return whitened_noise(record, still, whiten)


def with_hidden(problem: Problem, part: slice, rows: Rows) -> NDArray[np.float64]:
    """The record [sample, channel] of some channels and rows with errors as large as rounding leaves beside vehicles.

    Quiet that was rounded to zero lacks them, and the misfit of the fitted samples does not.
    """
    record, hidden = problem.record[:, part][rows], problem.law.hidden
    if not hidden[0] > 0:
        return record
    law = np.zeros(len(record))
    law[: len(hidden)] = hidden
    law[len(record) - len(hidden) + 1 :] += hidden[:0:-1]
    gain = np.sqrt(np.maximum(np.fft.rfft(law).real, 0.0))[:, None]
    even = np.random.default_rng(part.start).uniform(-(3**0.5), 3**0.5, record.shape)
    return record + problem.noise[part].numpy() * np.fft.irfft(gain * np.fft.rfft(even, axis=0), len(record), axis=0)
