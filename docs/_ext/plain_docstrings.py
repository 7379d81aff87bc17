"""Docstrings of the rooms, in which formulas stand as text, are shown as they are; the door's are marked up."""

from inspect import getdoc
from typing import Any

from sphinx.application import Sphinx

ROOMS = ("solver.", "vision.", "calib.")
#: What the door shows as its own.
DOOR = {
    "solver.effect.effect",
    "solver.effect.parameter",
    "solver.run.run",
    "solver.survey.survey",
    "vision.tracked",
    "vision.contract.frame",
}


def literal(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Turn a room's docstring into a block of text."""
    if name.startswith(ROOMS) and getattr(thing, "__module__", "") not in DOOR:
        lines[:] = [".. code-block:: text", "", *(f"   {line}" for line in (getdoc(thing) or "").splitlines()), ""]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx, after numpydoc."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", literal, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
