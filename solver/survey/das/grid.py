"""Samples of many DAS files -> one regular grid of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.survey.das.das_files import Block
from vision.contract import InputError

Array = NDArray[np.float64]

# A vehicle at 30 m/s moves 6 cm in this time, ns: files that are off the common grid by less are not shifted.
ALIGNED = 2_000_000
SPARSEST = 20  # a record of more than so many times the samples there are is no record of one survey


@dataclass(frozen=True)
class Segment:
    """Consecutive samples of one file: values [time, channel], and the time of the first, ns since 1970, UTC."""

    path: Path
    values: Array
    start: int


def file_interval(block: Block) -> float:
    """Return the sampling interval of a file, ns."""
    steps = np.diff(block.time)
    if not len(steps):
        raise InputError(f"{block.path}: a single sample has no rate; leave this file out")
    if steps.min() <= 0:
        sample = int((steps <= 0).argmax()) + 1
        what = "repeat" if steps[sample - 1] == 0 else "run backwards"
        at = np.datetime64(int(block.time[sample]), "ns").astype("datetime64[ms]")
        raise InputError(f"{block.path}: its times {what} at sample {sample} ({at}Z); export the recording again")
    usual = float(np.median(steps))
    return float(steps.mean()) if steps.max() < 1.5 * usual else usual


def sampling_interval(blocks: Sequence[Block]) -> float:
    """Return the sampling interval of a record, ns, from blocks sorted by time.

    The starts of adjoining files say it better than the nominal rate in one file: with a clock that is off by 1e-5,
    500 Hz are a sample off after 200 s.

    Raises
    ------
    InputError
        If the sampling rates of the files differ by over 0.1 %.
    """
    nominal = np.array([file_interval(block) for block in blocks])
    odd = int(np.abs(nominal - nominal[0]).argmax())
    if abs(nominal[odd] / nominal[0] - 1) > 1e-3:
        raise InputError(
            f"{blocks[odd].path}: {1e9 / nominal[odd]:g} samples/s, but {1e9 / nominal[0]:g} in {blocks[0].path.name}; "
            "give files of one recording"
        )
    interval = float(np.median(nominal))
    lengths = np.array([len(block.time) for block in blocks[:-1]])
    steps = np.diff([block.time[0] for block in blocks])
    adjoining = np.abs(steps - lengths * interval) < interval / 2
    return float(steps[adjoining].sum() / lengths[adjoining].sum()) if adjoining.any() else interval


def segments_of(block: Block, values: Array, interval: float) -> list[Segment]:
    """Split `values` [time, channel] of a block where its times jump."""
    cuts = np.flatnonzero(np.diff(block.time) > 1.5 * interval) + 1
    starts = block.time[[0, *cuts]]
    parts = np.split(values, cuts)
    return [Segment(block.path, part, int(start)) for start, part in zip(starts, parts, strict=True)]


def on_grid(segment: Segment, origin: int, interval: float) -> tuple[int, Array]:
    """Return the first row of a segment on the grid, and its values there [time, channel].

    Values that are off the grid by more than `ALIGNED` are moved onto it along a cubic spline.
    """
    from scipy.interpolate import CubicSpline

    position = (segment.start - origin) / interval
    row, count = round(position), len(segment.values)
    if abs(position - row) * interval <= ALIGNED or count < 2:
        return row, segment.values
    rows = np.arange(int(np.ceil(position)), int(np.floor(position + count - 1)) + 1)
    return int(rows[0]), np.asarray(CubicSpline(np.arange(count), segment.values, axis=0)(rows - position))


def assemble(segments: Sequence[Segment], interval: float) -> tuple[Array, tuple[tuple[float, float], ...]]:
    """Put segments, sorted by time, on one grid.

    Returns
    -------
    values [time, channel], NaN in the gaps, and (first, last) time of the missing samples of each gap, s

    Raises
    ------
    InputError
        If two segments overlap, or nearly all of the record would be gap.

    >>> one = Segment(Path("1"), np.ones((3, 1)), 0)
    >>> values, gaps = assemble([one, Segment(Path("2"), np.ones((2, 1)), 5 * 10**9)], 1e9)
    >>> values[:, 0].tolist(), gaps
    ([1.0, 1.0, 1.0, nan, nan, 1.0, 1.0], ((3.0, 4.0),))
    """
    placed = [on_grid(segment, segments[0].start, interval) for segment in segments]
    spans = [(row, row + len(values)) for row, values in placed]
    for (before, after), (files_before, files_after) in zip(pairwise(spans), pairwise(segments), strict=True):
        if after[0] < before[1]:
            raise InputError(f"{files_after.path}: overlaps {files_before.path.name} in time; give each recording once")
    total, measured = spans[-1][1], sum(end - begin for begin, end in spans)
    if total > SPARSEST * measured:
        raise InputError(
            f"{segments[-1].path}: {measured * interval * 1e-9:.0f} s of samples spread over "
            f"{total * interval * 1e-9 / 3600:.1f} h; locate each part on its own"
        )
    if len(placed) == 1:
        return placed[0][1], ()
    whole = np.full((total, placed[0][1].shape[1]), np.nan)
    for (begin, end), (_, values) in zip(spans, placed, strict=True):
        whole[begin:end] = values
    holes = [(before[1], after[0] - 1) for before, after in pairwise(spans) if after[0] > before[1]]
    return whole, tuple((float(first * interval * 1e-9), float(last * interval * 1e-9)) for first, last in holes)
