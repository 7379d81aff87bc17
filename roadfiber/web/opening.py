"""A page that is there at once, while what it shows is read: reading a run takes longer than drawing a page."""

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn


class Opening:
    """What browsers see until a view can be made, and then the view.

    Parameters
    ----------
    words : what the page says until then

    >>> opening = Opening("Reading the run ...")
    >>> page = opening.page()
    >>> page[0].object
    "<p id='reading'>Reading the run ...</p>"
    >>> opening.ready(lambda: pn.pane.HTML("the run"))
    >>> opening.page()[0].object
    'the run'
    """

    def __init__(self, words: str):
        self.words = words
        self.view: Callable[[], Any] | None = None
        self._waiting: list[Callable[[], None]] = []

    def page(self) -> Any:
        """What one browser shows."""
        column = pn.Column(sizing_mode="stretch_width")
        shown: list[Any] = []

        def show() -> None:
            now = [self.view, self.words]
            if now != shown:
                shown[:] = now
                column.objects = [self.view() if self.view is not None else said(self.words)]

        def wait() -> None:
            document = pn.state.curdoc
            if document is not None:
                self._waiting.append(lambda: document.add_next_tick_callback(show))
            show()  # After it waits, so that what is ready in between is never missed.

        show()
        if self.view is None:
            # What changes while a browser loads the page never reaches it: Panel drops it (`panel.io.document.hold`).
            pn.state.onload(wait)
        return column

    def ready(self, view: Callable[[], Any]) -> None:
        """Show a view, made for each browser; may be called from any thread."""
        self.view = view
        self._tell()

    def failed(self, words: str) -> None:
        """Say why there is nothing to show; may be called from any thread."""
        self.words = words
        self._tell()

    def _tell(self) -> None:
        waiting, self._waiting = self._waiting, []
        for show in waiting:
            show()


def said(words: str) -> Any:
    """Words alone on a page."""
    return pn.pane.HTML(f"<p id='reading'>{escape(words)}</p>", styles={"font": "15px system-ui, sans-serif"})
