"""What all figures of the report share: size in pixels, style, colors that follow the page's light or dark theme."""

import base64
import re
from io import BytesIO, StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm, Colormap
from matplotlib.figure import Figure
from matplotlib.image import imsave
from numpy.typing import NDArray

# Okabe and Ito's colors, told apart with every kind of color vision and by their lightness in gray.
ROUTE = "#d55e00"
FORWARD = "#0072b2"
BACKWARD = "#56b4e9"

# Text and lines; in the page these become variables of the theme (see `svg`).
INK, MUTED, RULE, PAPER = "#1f2933", "#66707a", "#d5dae0", "#fefefe"
THEME = {INK: "var(--ink)", MUTED: "var(--muted)", RULE: "var(--rule)", PAPER: "var(--paper)"}

DPI = 96  # figures are laid out in CSS pixels
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": RULE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "text.color": INK,
    "svg.fonttype": "none",
    "svg.hashsalt": "roadfiber",
}

LINEAR = 3.0  # noise sigmas up to which the color scale of the maps is linear

styled = matplotlib.rc_context(STYLE)


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

    So the noise, and what the model leaves above it, stays visible beside a signal a hundred times larger.

    Parameters
    ----------
    whitened : measured / noise, any shape
    """
    there = np.abs(whitened[np.isfinite(whitened)])
    top = max(10.0, float(np.percentile(there, 99.9))) if there.size else 10.0
    return AsinhNorm(linear_width=LINEAR, vmin=-top, vmax=top)


def color_map() -> Colormap:
    """Blue to red through white, gray where there is no measurement."""
    return matplotlib.colormaps["RdBu_r"].with_extremes(bad="#b5bac0")


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


@styled
def svg(figure: Figure) -> str:
    """SVG element to stand in a page: no size of its own, the page's font, and colors of the page's theme."""
    buffer = StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(buffer, format="svg", transparent=True, metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    head, rest = text.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', head)
    # Names of groups repeat from figure to figure, and the page needs none.
    rest = re.sub(r'<g id="[^"]*"', "<g", rest)
    rest = re.sub(r"'DejaVu Sans'[^;\"]*", "system-ui, sans-serif", rest)
    for color, variable in THEME.items():
        rest = rest.replace(color, variable)
    return f"<svg {view.group(0) if view else ''} role='img'>{rest}"


def data_uri(rgba: NDArray[np.float64]) -> str:
    """PNG of an image [row, column, 4] as a data URI."""
    buffer = BytesIO()
    imsave(buffer, np.ascontiguousarray(rgba), format="png")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
