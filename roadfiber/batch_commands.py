"""`roadfiber batch`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def batch(
    sites: Annotated[list[Path], typer.Argument(help="site.toml files, or their folders.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the run folders.")] = Path("runs"),
    steps: Annotated[
        str, typer.Option(help="Steps to take, by comma; track is for sites with a video and no trajectories.")
    ] = "ingest,track,locate,diagnose",
    corridor: Annotated[
        str, typer.Option(help="full: with what the model may lack; fit: the fit's own, which is faster.")
    ] = "full",
    workers: Annotated[int | None, typer.Option(help="Processes on this machine.", show_default="one per core")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler in their place, as tcp://10.0.0.1:8786.", show_default="none")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what became of every step as JSON.")] = False,
) -> None:
    """Ingest, track, locate and diagnose many surveys, on many cores or machines.

    What was done before and is unchanged is kept. A site that fails is told, stops no other, and makes the exit status
    1; a task whose worker is lost is tried again. Needs Dask: `pip install 'roadfiber[cluster]'`.

    Examples: `roadfiber batch surveys/* --out runs --workers 4`,
    `roadfiber batch surveys/* --scheduler tcp://10.0.0.1:8786 --steps ingest,locate`
    """
    import json

    import roadfiber as rf

    wanted = [name.strip() for name in steps.split(",") if name.strip()]
    done = rf.batch(sites, out, steps=wanted, corridor=corridor, workers=workers, scheduler=scheduler)
    if as_json:
        print(json.dumps(done.facts, allow_nan=False, indent=1))
    else:
        print("\n".join([done.headline, *done.lines(), f"runs: {out}"]))
    if done.failed:
        raise typer.Exit(1)
