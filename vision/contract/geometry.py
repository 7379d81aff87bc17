"""Points and lines of GeoJSON, KML and GeoPackage files, in WGS 84."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError, machine_words
from vision.contract.gpx import local_name, text_of
from vision.contract.text import read_text

Array = NDArray[np.float64]

SUFFIXES = (".geojson", ".json", ".kml", ".gpkg")


@dataclass(frozen=True)
class Feature:
    """A point or a line of a file.

    Parameters
    ----------
    kind : "Point" or "LineString"; the parts of a multiple geometry are features of their own
    coordinates : [vertex, 3], longitude, latitude (degrees), and the third number of the file, NaN where it has none
    properties : of the feature; the name of a KML placemark is `name`
    """

    kind: str
    coordinates: Array
    properties: dict[str, Any] = field(default_factory=dict)


def read_features(path: Path) -> list[Feature]:
    r"""Read all points and lines of a file, polygons left out.

    Parameters
    ----------
    path : GeoJSON (RFC 7946, so WGS 84), KML, or GeoPackage in any coordinates that it names (needs roadfiber[gis])

    Raises
    ------
    InputError
        If the file is of another kind, cannot be read, holds neither a point nor a line, or a coordinate is no number.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.geojson"
    >>> _ = path.write_text('{"type": "Point", "coordinates": [34.8, 32.1]}')
    >>> read_features(path)[0].coordinates.tolist()
    [[34.8, 32.1, nan]]
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: points and lines are read from {', '.join(SUFFIXES)}; export it as one of them")
    if suffix == ".gpkg":
        found = [one for table in geopackage(path) for one in geojson(table, path)]
    elif suffix == ".kml":
        found = list(kml(read_text(path, "a KML file"), path))
    else:
        found = list(geojson(read_text(path, "a GeoJSON file"), path))
    if not found:
        raise InputError(f"{path}: holds neither a point nor a line; export the layer again")
    return found


def geojson(text: str, path: Path) -> Iterator[Feature]:
    """Features of a GeoJSON text."""
    try:
        whole = json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: not GeoJSON ({error}); export it again") from error
    yield from parts_of(whole, {}, path)


def parts_of(value: Any, properties: dict[str, Any], path: Path) -> Iterator[Feature]:
    """Points and lines of a GeoJSON object of any type."""
    if not isinstance(value, dict):
        return
    kind, inside = value.get("type"), value.get("coordinates")
    if kind == "Feature":
        own = value.get("properties")
        yield from parts_of(value.get("geometry"), own if isinstance(own, dict) else {}, path)
    for many in ("features", "geometries"):
        for one in value.get(many) or ():
            yield from parts_of(one, properties, path)
    if kind in ("Point", "LineString"):
        yield Feature(kind, numbers([inside] if kind == "Point" else inside, path), properties)
    elif kind in ("MultiPoint", "MultiLineString"):
        for one in inside or ():
            yield Feature(kind.removeprefix("Multi"), numbers([one] if kind == "MultiPoint" else one, path), properties)


def numbers(positions: Any, path: Path) -> Array:
    """Positions as an array [vertex, 3]."""
    try:
        rows = [[float(number) for number in one[:3]] for one in positions]
        found = np.array([[*row, np.nan][:3] for row in rows]).reshape(-1, 3)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: a position is not longitude, latitude[, height]; export it again") from error
    if not np.isfinite(found[:, :2]).all() or (np.abs(found[:, 1]) > 90).any() or (np.abs(found[:, 0]) > 360).any():
        raise InputError(f"{path}: a position is not longitude and latitude in degrees; export it again in WGS 84")
    return found


def kml(text: str, path: Path) -> Iterator[Feature]:
    """Features of a KML text: placemarks with their names, extended data and geometries."""
    if "<!DOCTYPE" in text[:4096].upper():
        raise InputError(f"{path}: KML with a document type of its own is not read; export it again")
    try:
        root = ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not a readable KML file ({error}); export it again") from error
    for mark in (one for one in root.iter() if local_name(one) == "Placemark"):
        properties = {"name": text_of(mark, "name")} if text_of(mark, "name") else {}
        for one in mark.iter():
            if local_name(one) == "SimpleData":
                properties[one.get("name", "")] = (one.text or "").strip()
            elif local_name(one) == "Data":
                properties[one.get("name", "")] = text_of(one, "value")
        for one in mark.iter():
            if (kind := local_name(one)) in ("Point", "LineString"):
                positions = [position.split(",") for position in text_of(one, "coordinates").split()]
                yield Feature(kind, numbers(positions, path), properties)


def geopackage(path: Path) -> Iterator[str]:
    """Each layer of a GeoPackage as GeoJSON in WGS 84."""
    gis = with_geopandas(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a GeoPackage")
    try:
        for name in gis.list_layers(path)["name"]:
            table = gis.read_file(path, layer=name)
            if "geometry" not in table:
                continue
            if table.crs is None:
                raise InputError(f"{path}: layer {name} does not name its coordinates; export it with a CRS")
            yield table.to_crs(4326).to_json()
    except InputError:
        raise
    except Exception as error:  # whatever its drivers raise
        raise InputError(f"{path}: not a readable GeoPackage ({machine_words(error)}); export it again") from error


def with_geopandas(path: Path) -> Any:
    """geopandas, where it is installed."""
    try:
        import geopandas
        import pyogrio  # noqa: F401
    except ImportError as error:
        raise InputError(f"{path}: {path.suffix} files need geopandas: pip install roadfiber[gis]") from error
    return geopandas
