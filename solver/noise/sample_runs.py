"""Runs of consecutive samples."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray


def blocks_of(samples: NDArray[np.int64]) -> list[slice]:
    """Runs of consecutive rows.

    >>> blocks_of(np.array([3, 4, 5, 9, 10]))
    [slice(0, 3, None), slice(3, 5, None)]
    """
    cuts = [0, *(np.flatnonzero(np.diff(samples) != 1) + 1).tolist(), len(samples)]
    return [slice(a, b) for a, b in pairwise(cuts)]
