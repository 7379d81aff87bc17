"""`roadfiber plan`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def plan(
    site: Annotated[Path, typer.Argument(help="A site.toml with a table [plan], or its folder.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to write.")] = Path("plan"),
    wanted: Annotated[float | None, typer.Option(help="Standard deviation wanted across, m.")] = None,
    wanted_depth: Annotated[float | None, typer.Option(help="Standard deviation wanted in depth, m.")] = None,
    effects: Annotated[
        bool, typer.Option("--effects/--no-effects", help="Test which missing effects would show; half a minute.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print plan.json instead of words.")] = False,
) -> None:
    """Plan a survey before anyone drives: expected sigmas, effects that it could see, what to add.

    Writes plan.html, plan.json and plan.csv. This is all that site.toml must hold (y to the right of +x, m):

        [das]
        gauge_length = 10.0

        [plan]
        length = 100       # m of road that the camera sees, from x = 0
        offset = 4.5       # y at which the fiber is expected
        snr_db = 15        # over the passes' maps; or noise, of a sample, 1/s
        anchors = [12]     # x of fiber points that are known; may be left out
        lanes = [
            { y = 0.0, toward = "+x", vehicles = { car = 4, truck = 1 } },
            { y = -3.5, toward = "-x", vehicles = { car = 3, bus = 1 } },
        ]

    With [frame], lanes = "lanes.gpkg" (or GeoJSON, KML) takes them from a map: lines drawn the way that vehicles go,
    with how many of each class as attributes car, van, truck, bus; anchors = "manholes.gpkg" takes its points.

    Further keys: speeds = [30, 60] (km/h), fix_sigma, frame_rate, anchor_sigma, sampling_rate, shear_modulus; the
    expected depth is that of [ground]. Other sections of a site.toml may be there.

    Example: `roadfiber plan surveys/elm-street --wanted 0.05 --out plans/elm-street`
    """
    import json

    import roadfiber as rf
    from solver.run.titles import lower
    from vision.contract import require_writable

    require_writable(out / "plan.html")
    planned = rf.plan(site, wanted=wanted, wanted_depth=wanted_depth, effects=None if effects else ())
    planned.save(out)
    if as_json:
        print(json.dumps(planned.facts, allow_nan=False, indent=1))
        return
    print("\n".join([planned.headline, *(f"  {line}" for line in planned.advice), *planned.warnings]))
    if planned.effects:
        seen = [lower(one.title) for one in planned.effects if one.visible != "yes"]
        print(f"of {len(planned.effects)} effects it could not be sure to see: {', '.join(seen) or 'none'}")
    print(f"page: {out / 'plan.html'}")
