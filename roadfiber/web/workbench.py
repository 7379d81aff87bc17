"""The workbench in the browser: a run by hand, with what the commands do, on one page."""

import atexit
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import panel as pn

from vision.contract.errors import InputError

if TYPE_CHECKING:
    from solver.run.run import Run


def in_notebook(run: "Run", plugins: Sequence[Path | str], tiles: str) -> Any:
    """What a notebook shows of a run; see `solver.run.run.Run.workbench`."""
    from roadfiber.web.bench import Bench
    from roadfiber.web.film import film_of
    from roadfiber.web.layout import laid_out
    from roadfiber.web.tiles import around
    from roadfiber.web.workbench_page import Page

    pn.extension()
    bench = Bench(run, [Path(one) for one in plugins])
    atexit.register(bench.close)
    return laid_out(Page(bench, film_of(run)), around(run, tiles) if tiles else None)


def serve_workbench(folder: Path, plugins: Sequence[Path], tiles: str, port: int, browser: bool) -> None:
    """Serve the workbench of a run on this machine until Ctrl-C ends it; the page is there while the run is read.

    Tiles that cannot be had are told on the page, which goes without.

    Raises
    ------
    InputError
        If it is no run folder of a street, or cannot be read; the page says so, too.
    """
    from roadfiber.web.opening import Opening
    from roadfiber.web.server import serve

    pn.extension()
    opening, benches = Opening(f"Reading {folder} ..."), []

    def read() -> None:
        # These take longer to import than the first page to draw.
        from roadfiber.locating import require_street
        from roadfiber.web.bench import Bench
        from roadfiber.web.film import film_of
        from roadfiber.web.layout import laid_out
        from roadfiber.web.tiles import around
        from roadfiber.web.workbench_page import Page
        from solver.run.read_seen import read_seen

        ground, untiled = None, ""
        try:
            require_street(folder)
            run = read_seen(folder)
            film = film_of(run)
        except InputError as error:
            opening.failed(f"This run cannot be shown: {error}")
            raise
        try:
            ground = around(run, tiles) if tiles else None
        except InputError as error:
            untiled = str(error)
        benches.append(bench := Bench(run, plugins, asleep=True))
        bench.changed(untiled)
        opening.ready(lambda: laid_out(Page(bench, film), ground))

    try:
        serve(opening.page, "workbench", port=port, browser=browser, title=f"roadfiber: {folder.name}", work=read)
    finally:
        for bench in benches:
            bench.close()
