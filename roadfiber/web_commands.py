"""`roadfiber workbench`: pages that this machine serves to itself."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()

Port = Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 for any that is free.")]
Browser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser.")]


@app.command()
def workbench(
    run: Annotated[Path, typer.Argument(help="A run folder that `roadfiber locate` or `add` wrote.")],
    plugin: Annotated[
        list[Path] | None, typer.Option("--plugin", help="File with effects of your own; may be repeated.")
    ] = None,
    tiles: Annotated[
        str,
        typer.Option(
            help="Draw map tiles beneath the route, such as https://tile.openstreetmap.org/{z}/{x}/{y}.png; their "
            "server then learns where the survey is.  [default: none is asked]",
            show_default=False,
        ),
    ] = "",
    port: Port = 0,
    browser: Browser = True,
) -> None:
    """Question a run by hand in the browser: where it fails, what is missing, and the route when that is added.

    Shows map, depth, measured, model and residual with one zoom, traces and the video's frame; lists where the model
    fails and what may be missing; moves an effect's size by hand, adds it in the background, and undoes it. Every rung
    is a run folder beside RUN (RUN-2, RUN-3 ...). It listens on this machine only.

    Examples: `roadfiber workbench runs/main-street`, `roadfiber workbench run --no-browser --port 5006`
    """
    from roadfiber.web.tiles import host_of
    from roadfiber.web.workbench import serve_workbench

    if tiles:
        host_of(tiles)  # before anything is read
    serve_workbench(run, plugin or [], tiles, port, browser)


@app.command()
def start(
    folder: Annotated[
        Path, typer.Argument(help="Folder with the survey's files; site.toml is written there.")
    ] = Path(),
    port: Port = 0,
    browser: Browser = True,
) -> None:
    """Begin a survey in the browser: name its files, have them checked, and write site.toml.

    Looks at what is in FOLDER, then checks the DAS record (files, units, channels), video and calibration, vehicles,
    anchors, whether they overlap in time, whether the fiber heard the vehicles and how far the clocks are apart, and
    draws all on a map. It listens on this machine only, and writes nothing but site.toml, when you say so.

    Examples: `roadfiber start surveys/main-street`, `roadfiber start --no-browser --port 5006`
    """
    from roadfiber.web.start_page import serve_start

    serve_start(folder, port, browser)
