"""Rows between which columns act, and which columns act together."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad

from solver.ground.compiled import compiled

#: Columns are kept together where the rows between which they act are at most this many times as many as each's own.
TOGETHER = 1.3
#: Samples of nothing that are kept where a column acts before and after them: parts of few samples take their own time.
BRIDGED = 16


def acting_rows(maps: Tensor) -> Tensor:
    """Where maps [column, sample, channel] are not all zero, [column, sample] bool.

    >>> acting_rows(torch.tensor([[[0.0, 1.0], [0.0, 0.0]]]).double()).tolist()
    [[True, False]]
    """
    out = torch.zeros(maps.shape[:2], dtype=torch.bool)
    find_acting(maps.contiguous().numpy(), out.numpy())
    return out


@compiled
def find_acting(maps: NDArray[np.float64], out: NDArray[np.bool_]) -> None:
    """Say of each row [column, sample] of maps [column, sample, channel] whether it is not all zero."""
    columns, samples, channels = maps.shape
    for column in range(columns):
        for s in range(samples):
            c = 0
            while c < channels and maps[column, s, c] == 0:
                c += 1
            out[column, s] = c < channels


def runs(acts: Tensor) -> list[tuple[int, int]]:
    """First sample and that after the last of each run of those at which something acts [sample] bool.

    >>> runs(torch.tensor([False, True, True, False, True, *[False] * 20, True]))
    [(1, 5), (25, 26)]
    """
    at = acts.nonzero()[:, 0]
    if not len(at):
        return []
    ends = (at.diff() > BRIDGED).nonzero()[:, 0]
    first = torch.cat([at[:1], at[ends + 1]])
    last = torch.cat([at[ends], at[-1:]]) + 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def remembered(acts: Tensor, memory: int) -> Tensor:
    """Where a filter that remembers so many samples makes something of what acts [column, sample] bool.

    >>> remembered(torch.tensor([[False, True, False, False, False]]), 2).tolist()
    [[False, True, True, True, False]]
    """
    total = pad(acts.int().cumsum(1), (memory + 1, 0))
    return total[:, memory + 1 :] > total[:, : -memory - 1]


def acting(acts: Tensor) -> Tensor:
    """First row at which each column acts and that after the last [column, 2], of acts [column, row].

    >>> acting(torch.tensor([[False, True, False, True, False], [False] * 5])).tolist()
    [[1, 4], [0, 0]]
    """
    first = acts.int().argmax(1)
    last = (acts.shape[1] - acts.flip(1).int().argmax(1)) * acts.any(1)
    return torch.stack([first, last], 1)


def spanned(windows: Tensor) -> Tensor:
    """The window that spans all of some windows [window, 2]."""
    return torch.stack([windows[:, 0].min(), windows[:, 1].max()])


def alike(windows: Tensor) -> list[Tensor]:
    """Groups of windows [window, 2] that nearly coincide, by their numbers; empty windows are left out.

    >>> [group.tolist() for group in alike(torch.tensor([[0, 10], [20, 30], [1, 11], [0, 30], [5, 5]]))]
    [[0, 2], [3], [1]]
    """
    length = windows[:, 1] - windows[:, 0]
    middles = windows.sum(1).tolist()
    some = sorted(length.nonzero()[:, 0].tolist(), key=lambda one: middles[one])
    groups: list[list[int]] = []
    spans: list[tuple[int, int, int]] = []
    for one in some:
        first, last = windows[one].tolist()
        for number, (lowest, highest, shortest) in enumerate(spans):
            together = min(first, lowest), max(last, highest), min(last - first, shortest)
            if together[1] - together[0] <= TOGETHER * together[2]:
                groups[number].append(one)
                spans[number] = together
                break
        else:
            groups.append([one])
            spans.append((first, last, last - first))
    return [torch.tensor(group) for group in groups]
