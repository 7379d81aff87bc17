"""How figures of all reports look: size, style, colors that follow the page's light or dark theme."""

import base64
import re
from io import BytesIO, StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imsave
from numpy.typing import NDArray

# Text and lines; in the page these become variables of the theme (see `svg`).
INK, MUTED, RULE, PAPER = "#1f2933", "#66707a", "#d5dae0", "#fefefe"
THEME = {INK: "var(--ink)", MUTED: "var(--muted)", RULE: "var(--rule)", PAPER: "var(--paper)"}

DPI = 96  # figures are laid out in CSS pixels
PLACE = ("x", "y", "width", "height")
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
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "text.parse_math": False,  # names are text, whatever stands between two dollars
    "svg.fonttype": "none",
    "svg.hashsalt": "roadfiber",
}

styled = matplotlib.rc_context(STYLE)


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


def with_picture(drawn: str, png: bytes, left: float, top: float, width: float, height: float) -> str:
    """An SVG element with a picture beneath what `svg` drew, placed in CSS pixels from the upper left corner.

    >>> with_picture("<svg viewBox='0 0 75 75'></svg>", b"abc", 4, 0, 40, 20)[25:65]
    '<image x="3" y="0" width="30" height="15'
    """
    box = (f'{name}="{pixels * 72 / DPI:g}"' for name, pixels in zip(PLACE, (left, top, width, height), strict=True))
    sharp = "image-rendering:crisp-edges;image-rendering:pixelated"
    image = f'<image {" ".join(box)} preserveAspectRatio="none" style="{sharp}" href="{data_uri(png)}"/>'
    head, rest = drawn.split(">", 1)
    return f"{head}>{image}{rest}"


def png_bytes(image: NDArray[Any]) -> bytes:
    """PNG of an image [row, column, 3 or 4]: red, green, blue and opacity, bytes or shares."""
    buffer = BytesIO()
    imsave(buffer, np.ascontiguousarray(image), format="png")
    return buffer.getvalue()


def data_uri(png: bytes) -> str:
    """PNG as a data URI.

    >>> data_uri(b"abc")
    'data:image/png;base64,YWJj'
    """
    return "data:image/png;base64," + base64.b64encode(png).decode()
