"""What all figures of the report share: colors, places, and one scale for maps of strain rate."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm, Colormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vision.contract.figures import DPI, INK
from vision.contract.palette import LINEAR, limit_of


def canvas(width: int, height: int) -> Figure:
    """Empty figure of this size in CSS pixels."""
    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI)


def place(figure: Figure, name: str, left: float, top: float, width: float, height: float) -> Axes:
    """Axes called `name`, placed in CSS pixels from the upper left corner."""
    across, down = figure.get_size_inches() * DPI
    axes = figure.add_axes((left / across, 1 - (top + height) / down, width / across, height / down))
    axes.set_label(name)
    return axes


def color_scale(whitened: NDArray[np.float64]) -> AsinhNorm:
    """One scale for measured, model and residual, in noise sigmas: linear to 3, then logarithmic.

    So the noise, and any residual above it, stays visible beside a signal a hundred times larger.

    Parameters
    ----------
    whitened : measured / noise, any shape
    """
    top = limit_of(whitened)
    return AsinhNorm(linear_width=LINEAR, vmin=-top, vmax=top)


def color_map() -> Colormap:
    """Blue to red through white, gray where there is no measurement."""
    return matplotlib.colormaps["RdBu_r"].with_extremes(bad="#b5bac0")


def beside(axes: Axes, x: float, y: float, text: str) -> None:
    """Write a text right of the end of a bar."""
    axes.annotate(text, (x, y), (5, 0), textcoords="offset points", va="center", color=INK)


def coarse(whitened: NDArray[np.float64], limit: int) -> NDArray[np.float64]:
    """At most `limit` rows and columns: sums over blocks / sqrt(samples), so that noise keeps its standard deviation 1.

    Parameters
    ----------
    whitened : [row, column], in noise sigmas; NaN where there is none

    >>> coarse(np.ones((4, 4)), limit=2).tolist()
    [[2.0, 2.0], [2.0, 2.0]]
    """
    starts = [np.arange(0, size, -(-size // limit)) for size in whitened.shape]
    there = np.isfinite(whitened)
    sums, counts = (
        np.add.reduceat(np.add.reduceat(part, starts[0], axis=0), starts[1], axis=1)
        for part in (np.where(there, whitened, 0.0), there.astype(float))
    )
    return np.divide(sums, np.sqrt(counts), out=np.full_like(sums, np.nan), where=counts > 0)
