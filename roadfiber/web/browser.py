"""The browser, or notebook, that a page is shown in: what can be done on the page from another thread, and when."""

from collections.abc import Callable
from typing import Any

import panel as pn


class Browser:
    """The browser that asks for a page just now, or the notebook.

    >>> browser, told = Browser(), []
    >>> browser.later(lambda: told.append("done"))
    >>> told, browser.served, browser.loading
    ([], False, False)
    >>> browser.catch_up()
    >>> told
    ['done']
    """

    def __init__(self) -> None:
        self.document: Any = pn.state.curdoc
        #: Whether it has yet to draw the page; no change would reach it, see `roadfiber.web.opening`.
        self.loading = False
        self._due: list[Callable[[], Any]] = []

    @property
    def served(self) -> bool:
        """Whether a server, rather than a notebook, shows the page."""
        return self.document is not None and self.document.session_context is not None

    def in_order(self, called: Callable[[], Any]) -> None:
        """Do something whose changes reach the browser in the order in which they are made.

        Panel sends some changes at once and some later: what is drawn on a new figure may come before the figure.
        """
        with pn.io.hold(self.document, policy="collect"):
            called()

    def later(self, called: Callable[[], Any]) -> None:
        """Have something done on the page, from any thread; in a notebook when it catches up."""
        if self.served:
            self.document.add_next_tick_callback(lambda: self.in_order(called))
        else:
            self._due.append(called)

    def catch_up(self) -> None:
        """Do what is due in a notebook."""
        due, self._due = self._due, []
        for called in due:
            called()

    def once_loaded(self, called: Callable[[], Any]) -> None:
        """Have something done once the page is drawn."""

        def loaded() -> None:
            self.loading = False
            self.later(called)

        self.loading = True
        pn.state.onload(loaded)
