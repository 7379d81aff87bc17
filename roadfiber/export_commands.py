"""`roadfiber export`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="A run folder that `roadfiber locate` or `add` wrote.")],
    to: Annotated[list[Path], typer.Option("--to", help=".gpkg, .geojson, .kml, .dxf, .csv or .pdf; may be repeated.")],
    crs: Annotated[
        str, typer.Option(help="As pyproj reads it: EPSG:2039, or EPSG:2039+5773 with heights.")
    ] = "EPSG:4326",
    ground_height: Annotated[
        float | None, typer.Option(help="Height of the road in the vertical CRS, m; it is written in the CRS's unit.")
    ] = None,
) -> None:
    """Write the route for a GIS or CAD, or as a page for the file, with accuracy classes.

    A GeoPackage has the layers route, corridor (95 %), channels and anchors; a drawing (.dxf) lines, outlines and
    anchors; csv a row per channel; a pdf one page. Lines are cut where the class changes: PAS 128 quality levels by the
    95 % half-widths, QL-B2 at best since DAS is one technique, and the kind of evidence in the words of ASCE 38-22.
    Neither standard is claimed: QL-A and QLA need exposure. Coordinates are in the units of the CRS, depths and sigmas
    in the unit that their column names. All files are written, or none.

    Examples: `roadfiber export runs/elm --to elm.gpkg --crs EPSG:2039`, `roadfiber export runs/elm --to elm.dxf
    --crs EPSG:2039+5773 --ground-height 31.4`
    """
    import roadfiber as rf
    from solver.run.gis.target import Target

    rf.open(run).to_gis(*to, crs=crs, ground_height=ground_height)
    print(f"wrote {', '.join(map(str, to))}; third coordinate: {Target.of(crs, ground_height).third}")
