"""Colors that all figures and pages share, and where their scale of strain rate ends."""

import numpy as np
from numpy.typing import NDArray

# Okabe and Ito's colors, told apart with every kind of color vision and by their lightness in gray.
ROUTE = "#d55e00"
FORWARD = "#0072b2"
BACKWARD = "#56b4e9"
#: Lines and dots that must be told apart, in turn.
SERIES = (FORWARD, ROUTE, "#009e73", "#cc79a7", "#e69f00", BACKWARD)

LINEAR = 3.0  # noise sigmas up to which the color scale of the maps is linear
LEAST = 10.0  # noise sigmas that the scale reaches at least


def limit_of(whitened: NDArray[np.float64]) -> float:
    """Where the color scale of some maps ends, in noise sigmas.

    Parameters
    ----------
    whitened : measured / noise, any shape

    >>> limit_of(np.array([np.nan, 1.0])), limit_of(np.full(9, -40.0))
    (10.0, 40.0)
    """
    there = np.abs(whitened[np.isfinite(whitened)])
    return max(LEAST, float(np.percentile(there, 99.9))) if there.size else LEAST
