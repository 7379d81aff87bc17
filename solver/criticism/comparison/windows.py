"""Scan statistics: the window that stands out most, and how surely, whatever windows were looked at.

Statistics of all windows are standard normal where only noise is left, so by Bonferroni's inequality none of `n`
exceeds the upper 1/n quantile times the level with a greater probability than that level, however they overlap
(Glaz, Naus & Wallenstein 2001, Scan Statistics).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Array = NDArray[np.float64]

#: Fewest samples' worth of numbers that a power needs to be called one.
FEWEST = 8.0


@dataclass(frozen=True)
class Window:
    """A stretch [first, last] of positions in one group of passes, and its statistic, standard deviations."""

    group: int
    first: int
    last: int
    z: float


def ladder(size: int) -> list[int]:
    """Lengths that are tried, each about 1.4 times the one before.

    >>> ladder(20)
    [1, 2, 3, 4, 6, 8, 11, 16, 20]
    """
    steps = np.round(2 ** np.arange(0, np.log2(max(size, 1)) + 1, 0.5)).astype(int)
    return sorted({*steps[steps < size].tolist(), size})


def looked_at(groups: int, size: int) -> int:
    """Number of windows that `widest` compares."""
    return groups * sum(size - length + 1 for length in ladder(size))


def gain_statistic(score: Array, information: Array) -> Array:
    """Standard deviations [...] by which an estimate score / information differs from 0."""
    return np.divide(score, np.sqrt(information), out=np.zeros_like(score), where=information > 0)


def power_statistic(energy: Array, number: Array) -> Array:
    """Standard deviations [...] by which chi2 with `number` degrees of freedom is too large (Wilson & Hilferty 1931).

    >>> power_statistic(np.array([10.0, 31.26]), np.array([10.0, 10.0])).round(1).tolist()
    [0.1, 3.2]
    """
    enough = np.maximum(number, 1e-9)
    scatter = 2 / (9 * enough)
    return np.where(number >= FEWEST, (np.cbrt(energy / enough) - 1 + scatter) / np.sqrt(scatter), 0.0)


def summed(values: Array, groups: Sequence[NDArray[np.int64]]) -> Array:
    """Running sums [group, position + 1] of values [pass, position] over the passes of each group."""
    total = np.array([values[group].sum(0) for group in groups])
    return np.concatenate([np.zeros((len(groups), 1)), np.cumsum(total, axis=1)], axis=1)


def statistic(sums: tuple[Array, Array], power: bool, first: NDArray[np.int64], stop: NDArray[np.int64]) -> Array:
    """Statistic [group, window] of the windows first to stop - 1; a power counts on its upper side only."""
    parts = [part[:, stop] - part[:, first] for part in sums]
    return power_statistic(parts[0], parts[1]) if power else np.abs(gain_statistic(parts[0], parts[1]))


def widest(sums: tuple[Array, Array], power: bool) -> Window:
    """The window of the largest statistic among those of all lengths of `ladder` at all places.

    Parameters
    ----------
    sums : running sums of score and information, or of energy and its degrees of freedom, each [group, position + 1]
    power : whether they are the latter
    """
    size = sums[0].shape[1] - 1
    best = Window(0, 0, 0, 0.0)
    for length in ladder(size):
        first = np.arange(size - length + 1)
        z = statistic(sums, power, first, first + length)
        group, at = np.unravel_index(int(z.argmax()), z.shape)
        if z[group, at] > best.z:
            best = Window(int(group), int(at), int(at) + length - 1, float(z[group, at]))
    return best


def fitted(window: Window, sums: tuple[Array, Array], power: bool) -> Window:
    """The same window with its ends moved to where the statistic is largest."""
    size = sums[0].shape[1] - 1
    rows = tuple(part[window.group : window.group + 1] for part in sums)
    while True:
        ends = [(a, b) for a, b in _neighbors(window) if 0 <= a <= b < size]
        if not ends:
            return window
        first, last = np.array(ends).T
        z = statistic((rows[0], rows[1]), power, first, last + 1)[0]
        if z.max() <= window.z:
            return window
        at = int(z.argmax())
        window = Window(window.group, int(first[at]), int(last[at]), float(z[at]))


def _neighbors(window: Window) -> Iterator[tuple[int, int]]:
    for step in (-2, -1, 1, 2):
        yield window.first + step, window.last
        yield window.first, window.last + step


def threshold(windows: int, false_alarm: float) -> float:
    """Standard deviations that noise exceeds in any of so many windows with at most this probability.

    >>> round(threshold(10_000, 0.05), 2)
    4.42
    """
    return -float(ndtri(false_alarm / windows))
