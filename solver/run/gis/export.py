"""Writes a route for surveyors: GeoPackage, GeoJSON, KML, DXF, csv and a sheet in PDF."""

import json
import logging
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from solver.run.geojson import line_style
from solver.run.gis.accuracy import CLAIM
from solver.run.gis.layers import LAYERS, UNRELIABLE, Subject, channel_table
from solver.run.gis.target import DEGREES, Target
from vision.contract import InputError, require_writable, writing

logger = logging.getLogger("roadfiber")

#: Color (alpha, blue, green, red) and width, px, of lines in KML, by layer.
LINES = {"route": ("ffb27200", "3"), UNRELIABLE: ("ff808080", "1.5")}
#: Layers that a KML viewer can bear.
DRAWN = ("route", UNRELIABLE, "corridor", "anchors", "corners")
#: Units of a drawing, by the header $INSUNITS.
DRAWING_UNITS = {"m": 6, "ft": 2, "ftUS": 21}


def export(
    subject: Subject,
    paths: Path | str | Sequence[Path | str],
    crs: str | int = DEGREES,
    ground_height: float | None = None,
) -> None:
    """Write a route as one file or several, all or none; their suffixes say how.

    Parameters
    ----------
    subject : the route
    paths : `.gpkg` (layers route, corridor, channels, anchors), `.geojson`, `.kml`, `.dxf`, `.csv` (a row per channel)
        or `.pdf` (one page for the file)
    crs : as pyproj reads it, with a vertical part or without
    ground_height : height of the road in the vertical part, m

    Raises
    ------
    InputError
        If the suffix is not known, the CRS cannot be used or not in such a file, a package is missing, or the file
        cannot be written.
    """
    wanted = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    for path in wanted:
        if path.suffix.lower() not in WRITERS:
            raise InputError(f"{path}: unknown kind of file; give one of {', '.join(WRITERS)}")
    target = Target.of(crs, ground_height)
    require_writable(*wanted)
    for line in target.cautions(subject.frame):
        logger.warning("%s", line)
    with ExitStack() as whole:  # nothing takes its place before all are written
        for path in wanted:
            WRITERS[path.suffix.lower()](subject, target, whole.enter_context(writing(path)))


def tables(subject: Subject, target: Target, path: Path) -> dict[str, Any]:
    """GeoDataFrames by layer, those without a row left out."""
    try:
        import geopandas as gis
        import pyogrio  # noqa: F401
    except ImportError as error:
        raise InputError(f"{path}: {path.suffix} files need geopandas: pip install roadfiber[gis]") from error
    made = {name: layer(subject, target) for name, layer in LAYERS.items()}
    return {
        name: gis.GeoDataFrame([row for _, row in rows], geometry=[shape for shape, _ in rows], crs=target.crs)
        for name, rows in made.items()
        if rows
    }


def write_geopackage(subject: Subject, target: Target, path: Path) -> None:
    """One file with all layers in any CRS, and the claim as its description."""
    said = {"CLAIM": CLAIM, "THIRD": target.third, "DATUM": target.datum(subject.frame)}
    for name, table in tables(subject, target, path).items():
        table.to_file(path, layer=name, driver="GPKG", engine="pyogrio", layer_metadata=said)


def write_geojson(subject: Subject, target: Target, path: Path) -> None:
    """All layers as one collection, WGS 84: the standard (RFC 7946) has no other."""
    require_wgs84(target, path)
    features = []
    for name, table in tables(subject, target, path).items():
        for one in json.loads(table.to_json(drop_id=True))["features"]:
            style = line_style(name == "route") if name in ("route", UNRELIABLE) else {}
            one["properties"] = {"layer": name} | one["properties"] | style
            features.append(one)
    said = {"altitude": target.third, "datum": target.datum(subject.frame), "claim": CLAIM}
    whole = {"type": "FeatureCollection", **said, "features": features}
    path.write_text(json.dumps(whole, allow_nan=False), encoding="utf-8")


def write_kml(subject: Subject, target: Target, path: Path) -> None:
    """Folders route, corridor and anchors, WGS 84: KML has no other."""
    require_wgs84(target, path)
    every = tables(subject, target, path)
    for name in DRAWN:
        if name in every:
            every[name].to_file(path, layer=name, driver="LIBKML", engine="pyogrio")
    finish_kml(path, target.datum(subject.frame))


def finish_kml(path: Path, words: str) -> None:
    """Describe a KML file; color what may be relied on blue, what may not gray: viewers draw all alike."""
    space = "http://www.opengis.net/kml/2.2"
    ElementTree.register_namespace("", space)
    tree = ElementTree.parse(path)
    document = tree.find(f"{{{space}}}Document")
    if document is not None:
        about = ElementTree.Element(f"{{{space}}}description")
        about.text = words
        document.insert(0, about)
    for name, (color, width) in LINES.items():
        for mark in tree.iterfind(f".//{{{space}}}Document[@id='{name}']/{{{space}}}Placemark"):
            style = ElementTree.Element(f"{{{space}}}Style")
            line = ElementTree.SubElement(style, f"{{{space}}}LineStyle")
            ElementTree.SubElement(line, f"{{{space}}}color").text = color
            ElementTree.SubElement(line, f"{{{space}}}width").text = width
            mark.insert(1, style)
    tree.write(path, encoding="utf-8", xml_declaration=True)


def require_wgs84(target: Target, path: Path) -> None:
    """Refuse another CRS than longitude and latitude."""
    if not target.is_wgs84:
        raise InputError(f"{path}: {path.suffix} files are WGS 84 by their standard; leave --crs out, or write .gpkg")


def write_csv(subject: Subject, target: Target, path: Path) -> None:
    """A row per channel; the file of least surprise."""
    digits = 9 if target.degrees else 4
    table = channel_table(subject, target)
    table = table.round(dict.fromkeys(target.names, digits))
    table.to_csv(path, index=False, lineterminator="\n")


def write_dxf(subject: Subject, target: Target, path: Path) -> None:
    """Layers of a drawing: 3-D polylines of the route, outlines of the corridor, anchors with names."""
    if target.degrees:
        raise InputError(f"{path}: a drawing holds lengths, not degrees; give a projected --crs, as EPSG:32636")
    if target.unit not in DRAWING_UNITS or target.third_unit != target.unit:
        raise InputError(
            f"{path}: a drawing has one unit, meters or feet; --crs {target.crs.to_string()} counts in {target.unit}, "
            f"heights in {target.third_unit}; give one that counts all in one of these"
        )
    try:
        import ezdxf
    except ImportError as error:
        raise InputError(f"{path}: .dxf files need ezdxf: pip install roadfiber[gis]") from error
    drawing = ezdxf.new("R2018", setup=["linetypes"], units=DRAWING_UNITS[target.unit])
    drawing.header.custom_vars.append("CRS", target.crs.to_string())
    drawing.header.custom_vars.append("THIRD", target.third)
    drawing.header.custom_vars.append("DATUM", target.datum(subject.frame))
    space = drawing.modelspace()
    drawing.header.custom_vars.append("TRUST", f"{subject.place.grade}: {subject.place.told}")
    for name, color in (("route", 1), (UNRELIABLE, 8), ("corridor", 30), ("anchors", 5), ("corners", 6)):
        dashes = "DASHED" if name == UNRELIABLE else "CONTINUOUS"
        drawing.layers.add(f"FIBER_{name.upper()}", color=color, linetype=dashes)
    for name in ("route", UNRELIABLE):
        for shape, row in LAYERS[name](subject, target):
            line = space.add_polyline3d(list(shape.coords), dxfattribs={"layer": f"FIBER_{name.upper()}"})
            said = f"trust {row['trust']}; PAS 128 {row['pas128']}; ASCE 38-22 {row['asce38']}"
            line.set_xdata("ROADFIBER", [(1000, said)])
    drawing.appids.add("ROADFIBER")
    height = 0.5 / target.horizontal.axis_info[0].unit_conversion_factor
    for shape, _ in LAYERS["corridor"](subject, target):
        space.add_lwpolyline(list(shape.exterior.coords), close=True, dxfattribs={"layer": "FIBER_CORRIDOR"})
    for kind, label in (("anchors", "name"), ("corners", "words")):
        for shape, row in LAYERS[kind](subject, target):
            at, layer = tuple(shape.coords[0]), {"layer": f"FIBER_{kind.upper()}"}
            space.add_point(at, dxfattribs=layer)
            space.add_text(str(row[label]), height=height, dxfattribs=layer).set_placement(at)
    drawing.saveas(path)


def write_pdf(subject: Subject, target: Target, path: Path) -> None:
    """One page for the file."""
    from solver.run.gis.sheet import sheet

    sheet(subject, target).savefig(path, format="pdf", metadata={"Title": f"{subject.name}: fiber route"})


Writer = Callable[[Subject, Target, Path], None]

WRITERS: dict[str, Writer] = {
    ".gpkg": write_geopackage,
    ".geojson": write_geojson,
    ".kml": write_kml,
    ".dxf": write_dxf,
    ".csv": write_csv,
    ".pdf": write_pdf,
}
