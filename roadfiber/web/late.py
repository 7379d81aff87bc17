"""Figures that are made when there is something to show on them: a page with fewer figures is there sooner."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import panel as pn

Drawn = TypeVar("Drawn")


class Late(Generic[Drawn]):
    """A figure that is made when it is first asked for; until then its place on the page is empty.

    Parameters
    ----------
    make : makes what has a `plot`

    >>> from types import SimpleNamespace
    >>> from bokeh.plotting import figure
    >>> late = Late(lambda: SimpleNamespace(plot=figure()))
    >>> len(late.place), late.figure is late.figure, len(late.place)
    (0, True, 1)
    """

    def __init__(self, make: Callable[[], Drawn]):
        self.make = make
        self.place: Any = pn.Column(sizing_mode="stretch_width", margin=0)
        self._figure: Drawn | None = None

    @property
    def figure(self) -> Drawn:
        """The figure."""
        if self._figure is None:
            made: Any = self.make()
            self._figure = made
            self.place.append(pn.pane.Bokeh(made.plot, sizing_mode="stretch_width"))
        return self._figure
