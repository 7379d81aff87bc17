"""Points and lines of GeoJSON, KML and GeoPackage files, in WGS 84."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from vision.contract.errors import InputError
from vision.contract.gpx import local_name, text_of
from vision.contract.text import LONGEST, read_json, read_text

Array = NDArray[np.float64]

SUFFIXES = (".geojson", ".json", ".kml", ".gpkg")
#: Tables of a GeoPackage that hold geometries. Views are left out: what they compute need not end.
LAYERS = """SELECT table_name, column_name, organization, organization_coordsys_id, definition
FROM gpkg_geometry_columns NATURAL JOIN gpkg_spatial_ref_sys
JOIN sqlite_master ON name = table_name AND type = 'table'"""
#: Bytes of a geometry's header in a GeoPackage, by the code of its envelope (OGC 12-128, 2.1.3).
HEADER = {0: 8, 1: 40, 2: 56, 3: 56, 4: 72}
#: Bytes of a text or a geometry of a GeoPackage, also where columns are computed; a line of 700,000 vertices.
LARGEST = 1 << 24


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
    path : GeoJSON in WGS 84 or what its member `crs` names, KML, or GeoPackage in any coordinates that it names

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
        found = list(geopackage(path))
    elif suffix == ".kml":
        found = list(kml(read_text(path, "a KML file"), path))
    else:
        found = list(parts_of(read_json(path, "a GeoJSON file"), {}, path))
    found = [one for one in found if len(one.coordinates)]
    if not found:
        raise InputError(f"{path}: holds neither a point nor a line; export the layer again")
    return found


def to_degrees(value: dict[str, Any], path: Path) -> Any:
    """What brings positions of a GeoJSON object to WGS 84, by its member `crs`; None where it has none, or is there.

    RFC 7946 knows no `crs`; programs write that of GeoJSON 2008 where coordinates are others.
    """
    said = value.get("crs")
    if said is None:
        return None
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    properties = said.get("properties") if isinstance(said, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    try:
        if not isinstance(name, str):
            raise ValueError("it names none")
        return Transformer.from_crs(CRS.from_user_input(name), CRS.from_epsg(4326), always_xy=True)
    except (ProjError, ValueError) as error:
        raise InputError(f"{path}: its crs, {name!r}, is not known; export it again in WGS 84") from error


def parts_of(value: Any, properties: dict[str, Any], path: Path, move: Any = None) -> Iterator[Feature]:
    """Points and lines of a GeoJSON object of any type; `move` is what its positions go through, as of `to_degrees`."""
    if not isinstance(value, dict):
        return
    move = to_degrees(value, path) or move
    kind, inside = value.get("type"), value.get("coordinates")
    if kind == "Feature":
        own = value.get("properties")
        yield from parts_of(value.get("geometry"), own if isinstance(own, dict) else {}, path, move)
    for many in ("features", "geometries"):
        for one in value.get(many) or ():
            yield from parts_of(one, properties, path, move)
    if kind in ("Point", "LineString") and inside != []:
        yield Feature(kind, numbers([inside] if kind == "Point" else inside, path, move), properties)
    elif kind in ("MultiPoint", "MultiLineString"):
        for one in inside or ():
            positions = numbers([one] if kind == "MultiPoint" else one, path, move)
            yield Feature(kind.removeprefix("Multi"), positions, properties)


def numbers(positions: Any, path: Path, move: Any = None) -> Array:
    """Positions as an array [vertex, 3], in degrees after `move`."""
    try:
        rows = [[float(number) for number in one[:3]] for one in positions]
        found = np.array([[*row, np.nan][:3] for row in rows]).reshape(-1, 3)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: a position is not longitude, latitude[, height]; export it again") from error
    if move is not None:
        found[:, :2] = np.column_stack(move.transform(found[:, 0], found[:, 1]))
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


def geopackage(path: Path) -> Iterator[Feature]:
    """Features of all layers of a GeoPackage, read as the SQLite tables that it is.

    GDAL opens a file as what its content asks for, whatever its name: one that refers to other files and addresses.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a GeoPackage")
    # Without a log of changes beside it nobody is writing it, and none need be made to read it.
    how = "" if path.with_name(f"{path.name}-wal").exists() else "&immutable=1"
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro{how}", uri=True)) as file:
            file.row_factory = sqlite3.Row
            file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
            for layer in file.execute(LAYERS).fetchall():
                project = to_wgs84(layer, path)
                table = layer["table_name"].replace('"', '""')
                for row in map(dict, file.execute(f'SELECT * FROM "{table}"')):
                    if blob := row.pop(layer["column_name"]):
                        for kind, vertices in wkb_parts(blob[HEADER[blob[3] >> 1 & 7] :]):
                            yield Feature(kind, numbers(project(vertices), path), row)
    except InputError:
        raise
    except Exception as error:  # on damaged bytes a parser can raise anything
        raise InputError(f"{path}: not a readable GeoPackage ({str(error)[:LONGEST]}); export it again") from error


def wkb_parts(wkb: bytes) -> Iterator[tuple[str, Array]]:
    """Kind and vertices [vertex, 2 or 3] of the points and lines of a geometry in well-known binary (ISO 13249-3).

    The members of a multiple geometry or a collection follow its own header, so that one within another, however deep,
    is read without recursion.

    >>> line = bytes([1, 2, 0, 0, 0, 2, 0, 0, 0]) + np.array([[34.8, 32.1], [34.9, 32.1]]).tobytes()
    >>> [(kind, vertices.tolist()) for kind, vertices in wkb_parts(bytes([1, 7, 0, 0, 0, 1, 0, 0, 0]) + line)]
    [('LineString', [[34.8, 32.1], [34.9, 32.1]])]
    """
    at = 0

    def read(kind: str, count: int) -> NDArray[Any]:
        nonlocal at
        found = np.frombuffer(wkb, order + kind, count, at)
        at += found.nbytes
        return found

    while at < len(wkb):
        order = "<" if wkb[at] else ">"
        at += 1
        extra, kind = divmod(int(read("u4", 1)[0]), 1000)
        numbers_each = (2, 3, 3, 4)[extra]
        if not 1 <= kind <= 7:
            raise ValueError(f"a geometry of type {kind}")
        parts = int(read("u4", 1)[0]) if kind > 1 else 1
        if kind <= 2:
            vertices = read("f8", parts * numbers_each).reshape(-1, numbers_each).astype(float)
            if not np.isnan(vertices).all():  # an empty point
                yield ("Point", "LineString")[kind - 1], vertices[:, : 3 if extra in (1, 3) else 2]
        elif kind == 3:
            for _ in range(parts):
                read("f8", int(read("u4", 1)[0]) * numbers_each)


def to_wgs84(layer: sqlite3.Row, path: Path) -> Callable[[Array], Array]:
    """Function from coordinates [vertex, 2 or 3] of a layer of `LAYERS` to longitude, latitude and height."""
    from pyproj import CRS, Transformer

    if layer["organization_coordsys_id"] <= 0:
        raise InputError(f"{path}: layer {layer['table_name']} does not name its coordinates; export it with a CRS")
    epsg = layer["organization"].upper() == "EPSG"
    crs = CRS.from_epsg(layer["organization_coordsys_id"]) if epsg else CRS.from_wkt(layer["definition"])
    project = Transformer.from_crs(crs, 4326, always_xy=True).transform
    return lambda places: np.column_stack(project(*places.T))
