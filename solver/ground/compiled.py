"""Compiled loops, cached between runs if a cache can be written."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from numba import guvectorize, njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F, *, fastmath: bool | set[str] = False) -> F:
    """Compile a function on its first call; without a cache if none can be written.

    A division by zero gives infinity as in NumPy: a check of every division would keep loops from being vectorized.
    `fastmath` is Numba's: all that may change the last digits, or some of it.

    >>> compiled(lambda x: x + 1)(2)
    3
    """
    made: Any
    try:
        made = njit(nogil=True, fastmath=fastmath, error_model="numpy", cache=True)(function)
    except RuntimeError:  # neither the installation's nor the user's folder is writable
        made = njit(nogil=True, fastmath=fastmath, error_model="numpy")(function)
    else:
        # Numba raises the error of a full disk, except on Windows.
        made._cache._guard_against_spurious_io_errors = lambda: suppress(OSError)
    return made


def elementwise(function: F, inputs: int, outputs: int) -> F:
    """Compile a function of numbers for arrays that broadcast together; without a cache where none can be written.

    Parameters
    ----------
    function : takes `inputs` numbers and `outputs` arrays of one number, which it sets

    >>> import numpy as np
    >>> def double(x, out): out[0] = 2 * x
    >>> elementwise(double, 1, 1)(np.arange(3.0))
    array([0., 2., 4.])
    """
    types = ["void(" + ",".join(["f8"] * inputs + ["f8[:]"] * outputs) + ")"]
    layout = ",".join(["()"] * inputs) + "->" + ",".join(["()"] * outputs)
    made: Any
    try:
        made = guvectorize(types, layout, nopython=True, cache=True)(function)
    except (RuntimeError, OSError):  # no writable folder, or a full disk
        made = guvectorize(types, layout, nopython=True)(function)
    return made
