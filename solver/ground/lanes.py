"""Channels that compiled loops work on together."""

import numpy as np
from numpy.typing import NDArray

from solver.ground.compiled import compiled

Array = NDArray[np.float64]

#: Channels at once; a multiple of 8, and not of 64, so that the parts of an array of so many are not taken for one
#: another in the processor's cache.
LANES = 136


@compiled
def put(values: Array, into: Array, count: int) -> None:
    """Copy the first values."""
    for k in range(count):
        into[k] = values[k]


@compiled
def add(values: Array, to: Array, count: int) -> None:
    """Add the first values."""
    for k in range(count):
        to[k] += values[k]
