"""The workbench in the browser: a run by hand, with what the commands do, on one page."""

import atexit
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import panel as pn

from roadfiber.web.bench import Bench
from roadfiber.web.controls import WIDE
from roadfiber.web.film import film_of
from roadfiber.web.workbench_page import Page
from solver.run.run import Run

#: px, width of the column of controls, and of the video.
LEFT, VIDEO = 390, 340


def laid_out(page: Page) -> Any:
    """All that is on a page."""
    controls, button = page.controls, page.controls.button

    def drawn(one: Any) -> Any:
        return pn.pane.Bokeh(one.plot, **WIDE)

    own = pn.Card(controls.file, controls.code, button["check"], title="An effect of your own", collapsed=True, **WIDE)
    left = pn.Column(
        controls.passes, controls.regions, controls.where, controls.effects, controls.about, controls.size,
        controls.follow, controls.expected, pn.Row(button["add"], button["undo"], button["redo"]), controls.force,
        pn.Row(button["diagnose"], button["cancel"]), controls.work, drawn(page.live), controls.steps,
        drawn(page.ladder), pn.Row(*controls.exports), own, width=LEFT,
    )  # fmt: skip
    right = pn.Column(
        drawn(page.map),
        pn.Row(*(pn.pane.Bokeh(plot, **WIDE) for plot in page.maps.plots), **WIDE),
        drawn(page.depth),
        pn.Row(controls.channel, controls.second, **WIDE),
        pn.Row(drawn(page.traces), pn.Column(controls.picture, width=VIDEO), **WIDE),
        drawn(page.by_channel),
        pn.Row(drawn(page.stack), pn.Column(controls.by, drawn(page.by_property), **WIDE), **WIDE),
        **WIDE,
    )
    return pn.Column(controls.heading, controls.said, pn.Row(left, right, **WIDE), min_width=900, **WIDE)


def workbench(run: Run, *, plugins: Sequence[Path | str] = ()) -> Any:
    """The workbench of a run in a notebook: what `roadfiber workbench` serves.

    Parameters
    ----------
    run : of a folder: every effect that is added becomes a run folder beside it
    plugins : files with effects of your own

    Returns
    -------
    page : a Panel object, which a notebook shows

    Raises
    ------
    InputError
        If the run was not saved.

    Examples
    --------
    >>> rf.workbench(rf.open(folder / "run"))  # doctest: +SKIP
    """
    pn.extension()
    bench = Bench(run, [Path(one) for one in plugins])
    atexit.register(bench.close)
    return laid_out(Page(bench, film_of(run)))


def serve_workbench(run: Run, plugins: Sequence[Path], port: int, browser: bool) -> None:
    """Serve the workbench of a run on this machine until Ctrl-C ends it."""
    from roadfiber.web.server import serve

    pn.extension()
    bench, film = Bench(run, plugins), film_of(run)
    try:
        serve(
            lambda: laid_out(Page(bench, film)), "workbench", port=port, browser=browser, title=f"roadfiber: {run.name}"
        )
    finally:
        bench.close()
