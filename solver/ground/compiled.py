"""Machine code of loops, kept between runs where there is a place for it."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F, *, fastmath: bool = False) -> F:
    """Compile a function on its first call; without a cache where none can be written.

    >>> compiled(lambda x: x + 1)(2)
    3
    """
    made: Any
    try:
        made = njit(nogil=True, fastmath=fastmath, cache=True)(function)
    except RuntimeError:  # neither the installation nor the user has a folder that can be written
        made = njit(nogil=True, fastmath=fastmath)(function)
    else:
        # Numba lets errors of a full disk through, except on Windows.
        made._cache._guard_against_spurious_io_errors = lambda: suppress(OSError)
    return made
