"""What a notebook must be told so that it shows pictures that are returned, and no warnings that are none."""

import sys
import warnings
from io import BytesIO
from typing import Any


def png(figure: Any) -> bytes:
    """A matplotlib figure as PNG."""
    picture = BytesIO()
    figure.savefig(picture, format="png", bbox_inches="tight")
    return picture.getvalue()


def prepare() -> None:
    """Show matplotlib figures in IPython, which does so by itself only once pyplot has drawn one.

    Nothing is imported, and nothing is done outside IPython.
    """
    if "IPython" not in sys.modules:
        return
    shell = sys.modules["IPython"].get_ipython()
    if shell is None or not hasattr(shell, "display_formatter"):
        return
    formatters = shell.display_formatter.formatters
    if "image/png" in formatters:
        formatters["image/png"].for_type_by_name("matplotlib.figure", "Figure", png)
    # DASCore's progress bar has one for widgets, which need not be there.
    warnings.filterwarnings("ignore", "IProgress not found")
