"""`roadfiber study`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def study(
    out: Annotated[Path, typer.Option("--out", help="Folder; what was located in it before is taken from there.")],
    axes: Annotated[str, typer.Option(help="What to vary, by comma.")] = "snr,noise,offset,anchors,poisson",
    methods: Annotated[
        str, typer.Option(help="spline, network (the paper's), network-whitened, geometric; by comma.")
    ] = "spline,network,network-whitened,geometric",
    surveys: Annotated[int, typer.Option(min=1, help="Simulated surveys per point.")] = 50,
    passes: Annotated[int, typer.Option(min=1, help="Vehicles of a survey.")] = 8,
    snr: Annotated[float, typer.Option(help="dB, where SNR is not varied.")] = 15.0,
    loads: Annotated[str, typer.Option(help="point, as in the paper, or wheels.")] = "point",
    jobs: Annotated[int, typer.Option(min=1, help="Surveys at once.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="Two small surveys without the paper's network.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print tables and claims as JSON.")] = False,
) -> None:
    """Repeat the paper's study on simulated surveys, and say which of its claims hold.

    Error, Hausdorff distance and seconds of every method against SNR, track noise, anchors and Poisson ratio, with the
    Cramer-Rao expectation on the same axis. Writes study.html, claims.csv, a figure and a table of each axis, and
    results.json, from which a study that was stopped goes on. The whole takes days of one core; fewer axes, methods and
    surveys take less. The authors' field data were not at hand: nothing of the field is checked.

    Examples: `roadfiber study --quick --out runs/study`, `roadfiber study --axes snr --methods spline,network-whitened
    --surveys 10 --out runs/study`
    """
    import json

    import roadfiber as rf

    done = rf.study(
        out,
        axes=[one.strip() for one in axes.split(",")],
        methods=[one.strip() for one in methods.split(",")],
        surveys=surveys,
        passes=passes,
        snr_db=snr,
        loads=loads,
        jobs=jobs,
        quick=quick,
    )
    done.save(out)
    if as_json:
        print(json.dumps(done.facts, allow_nan=False, indent=1))
        return
    for name, axis in done.axes.items():
        print(f"\n{axis.label} ({axis.said})\n{done.table(name).round(3).to_string(index=False)}")
    print(f"\n{done.claims.to_string(index=False)}\npage: {out / 'study.html'}")
