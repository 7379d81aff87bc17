"""A route in the files of surveyors: written, read back by other readers, classified, refused in one line."""

import builtins
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import dascore
import ezdxf
import geopandas
import numpy as np
import pandas as pd
import pyogrio
import pytest
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar
from pyproj import Transformer
from shapely import Point
from typer.testing import CliRunner

import roadfiber.command
from solver.fit.result import Placed
from solver.run.gis.accuracy import accuracy_of
from solver.run.gis.export import WRITERS, export
from solver.run.gis.layers import UNRELIABLE, Subject, stretches
from solver.run.gis.sheet import sheet
from solver.run.gis.target import Target
from solver.run.run import run_of
from solver.survey.anchors import Anchor, read_anchors
from vision.contract import InputError, LocalFrame
from vision.contract.geometry import read_features

FRAME = LocalFrame((32.113, 34.804), 78.0)
UTM = "EPSG:32636"


DO_NOT_RELY = f"FIBER_{UNRELIABLE.upper()}"


@pytest.fixture(scope="module")
def subject() -> Subject:
    """Sixty channels: sure in the middle, wide at one end, not measured at the other."""
    channel = np.arange(100, 160)
    x = np.arange(60.0)
    route = np.column_stack([x, 4 + np.sin(x / 15), 0.9 + 0.001 * x])
    sigma = np.interp(x, [0, 10, 45, 59], [0.2, 0.04, 0.06, 0.6])
    covariance = np.einsum("c,ab->cab", sigma**2, np.diag([1.0, 1.0, 0.5]))
    place = Placed(channel, channel * 1.0, route, covariance, channel < 150, None, "good", "No check failed.")
    anchors = [Anchor("pit <1>", 110.25, *route[10], 0.05, 0.04), Anchor("tap", 130.0, *route[30], 0.1, 0.1)]
    return Subject(place, FRAME, anchors, "Elm & 2nd")


def places(subject: Subject, crs: str) -> np.ndarray:
    """Route by pyproj alone, [channel, 2]."""
    latitude, longitude = FRAME.to_geographic(*subject.place.route[:, :2].T)
    return np.column_stack(Transformer.from_crs(4326, crs, always_xy=True).transform(longitude, latitude))


@pytest.mark.parametrize("crs", ["EPSG:4326", UTM, "EPSG:2039"])
def test_a_geopackage_comes_back_as_it_went(subject: Subject, tmp_path: Path, crs: str) -> None:
    path = tmp_path / "route.gpkg"
    export(subject, path, crs)
    layers = {name: geopandas.read_file(path, layer=name) for name, _ in pyogrio.list_layers(path)}
    assert set(layers) == {"route", UNRELIABLE, "corridor", "channels", "anchors"}
    assert all(table.crs.equals(geopandas.GeoSeries([], crs=crs).crs) for table in layers.values())
    points = np.array([[one.x, one.y, one.z] for one in layers["channels"].geometry])
    assert points[:, :2] == pytest.approx(places(subject, crs), abs=1e-6)
    assert points[:, 2] == pytest.approx(-subject.place.route[:, 2])
    table = layers["channels"].set_index("channel")
    assert table["sigma_y_m"].to_numpy() == pytest.approx(subject.place.sigma[:, 1], abs=1e-4)
    lines = [*layers["route"].geometry, *layers[UNRELIABLE].geometry]
    line = np.concatenate([np.array(one.coords) for one in lines])
    assert {tuple(row) for row in line.round(9)} == {tuple(row) for row in points.round(9)}
    for shape, outline in zip(lines, layers["corridor"].geometry, strict=True):
        assert outline.buffer(1e-9).contains(Point(shape.interpolate(0.5, normalized=True).coords[0][:2]))
    if crs == UTM:
        width = layers["corridor"].area.sum() / sum(one.length for one in lines)
        assert width == pytest.approx(2 * 1.96 * subject.place.sigma[:, 1].mean(), rel=0.05)


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".kml"])
def test_anchors_come_back_from_a_map(subject: Subject, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"anchors{suffix}"
    export(subject, path, UTM if suffix == ".gpkg" else "EPSG:4326")
    for one, was in zip(read_anchors(path, FRAME), subject.anchors, strict=True):
        assert (one.name, one.channel) == (was.name, was.channel)
        both = [[getattr(a, name) for name in ("x", "y", "z", "sigma_xy", "sigma_z")] for a in (one, was)]
        assert both[0] == pytest.approx(both[1], abs=1e-6)


def test_heights_are_those_of_the_road_less_the_depth(subject: Subject, tmp_path: Path) -> None:
    export(subject, tmp_path / "a.csv", "EPSG:2039+5773", 31.4)
    table = pd.read_csv(tmp_path / "a.csv")
    assert table["height_m"].to_numpy() == pytest.approx(31.4 - subject.place.route[:, 2], abs=1e-4)
    assert table[["easting_m", "northing_m"]].to_numpy() == pytest.approx(places(subject, "EPSG:2039"), abs=1e-3)
    export(subject, tmp_path / "a.gpkg", "EPSG:2039+5773", 31.4)
    shape = geopandas.read_file(tmp_path / "a.gpkg", layer="channels")
    assert shape.geometry.iloc[0].z == pytest.approx(31.4 - 0.9) and "height_m" in shape
    assert geopandas.read_file(tmp_path / "a.gpkg", layer="route").crs.is_compound


def test_lengths_are_in_the_units_of_the_axes_and_their_columns_say_so(subject: Subject, tmp_path: Path) -> None:
    foot, depth = 1200 / 3937, subject.place.route[:, 2]
    files = [tmp_path / name for name in ("a.gpkg", "a.csv", "a.dxf")]
    export(subject, files, "EPSG:2263+6360", 20.0)
    points = geopandas.read_file(files[0], layer="channels").geometry
    assert [one.z for one in points] == pytest.approx((20 - depth) / foot)
    table = pd.read_csv(files[1])
    assert table["height_ftUS"].to_numpy() == pytest.approx((20 - depth) / foot, abs=1e-4)
    assert {"easting_ftUS", "northing_ftUS", "depth_m", "sigma_z_m"} <= set(table)
    drawing = ezdxf.readfile(files[2])
    assert drawing.units == 21 and dict(drawing.header.custom_vars)["THIRD"].startswith("height, ftUS")
    ends = [v.dxf.location.z for v in drawing.modelspace().query("POLYLINE").first.vertices]
    assert ends[0] == pytest.approx((20 - depth[0]) / foot)
    assert drawing.modelspace().query("TEXT").first.dxf.height == pytest.approx(0.5 / foot)
    below = Target.of("EPSG:2263").points(FRAME, subject.place.route)[:, 2]  # no heights: depths in the same feet
    assert below == pytest.approx(-depth / foot)
    assert all(
        one.z_m == was.z
        for one, was in zip(geopandas.read_file(files[0], layer="anchors").itertuples(), subject.anchors, strict=True)
    )


def test_files_say_how_exactly_a_datum_can_be_known(subject: Subject, tmp_path: Path) -> None:
    export(subject, [tmp_path / "a.gpkg", tmp_path / "a.dxf"], "EPSG:2039")
    export(subject, [tmp_path / "a.geojson", tmp_path / "a.kml"])
    layers = [pyogrio.read_info(tmp_path / "a.gpkg", layer=name) for name in ("route", "channels")]
    drawing = dict(ezdxf.readfile(tmp_path / "a.dxf").header.custom_vars)
    for said in (*(one["layer_metadata"]["DATUM"] for one in layers), drawing["DATUM"]):
        assert said.endswith("Grid: the step from WGS 84 to its datum is good to 0.5 m; no sigma includes that.")
    here = json.loads((tmp_path / "a.geojson").read_text())["datum"]
    assert "its realizations agree to 2 m" in here and f"<description>{here}<" in (tmp_path / "a.kml").read_text()


def test_all_files_are_written_or_none(subject: Subject, tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("older")
    with pytest.raises(InputError, match=r"b\.geojson: \.geojson files are WGS 84"):
        export(subject, [tmp_path / "b.csv", tmp_path / "b.geojson"], UTM)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["older"]


def test_a_drawing_has_lines_outlines_and_names(subject: Subject, tmp_path: Path) -> None:
    export(subject, tmp_path / "a.dxf", UTM)
    drawing = ezdxf.readfile(tmp_path / "a.dxf")
    assert not drawing.audit().has_errors and drawing.units == 6
    space = drawing.modelspace()
    lines = [*space.query('POLYLINE[layer=="FIBER_ROUTE"]'), *space.query(f'POLYLINE[layer=="{DO_NOT_RELY}"]')]
    assert drawing.layers.get(DO_NOT_RELY).dxf.linetype == "DASHED"
    points = np.concatenate([[tuple(v.dxf.location) for v in line.vertices] for line in lines])
    assert points[:, :2].min(0) == pytest.approx(places(subject, UTM).min(0), abs=1e-6)
    assert len(lines) == len(stretches(subject)) == len(space.query('LWPOLYLINE[layer=="FIBER_CORRIDOR"]'))
    assert "QL-B2" in lines[1].get_xdata("ROADFIBER")[0].value
    assert [text.dxf.text for text in space.query("TEXT")] == ["pit <1>", "tap"]


def test_a_route_that_may_not_be_relied_on_looks_different_in_every_format(subject: Subject, tmp_path: Path) -> None:
    weak = replace(subject, place=replace(subject.place, grade="weak", trust="Do not rely on this route: misfit 3."))
    export(weak, [tmp_path / name for name in ("a.gpkg", "a.csv")], UTM)
    export(weak, [tmp_path / name for name in ("a.geojson", "a.kml")])
    assert "route" not in {name for name, _ in pyogrio.list_layers(tmp_path / "a.gpkg")}
    lines = geopandas.read_file(tmp_path / "a.gpkg", layer=UNRELIABLE)
    table = pd.read_csv(tmp_path / "a.csv")
    for told in (lines, table):
        assert set(told["trust"]) == {"weak"} and told["reason"].str.startswith("Do not rely on this route").all()
        assert told["reason"].str.contains("neither data nor anchors decide").equals(~told["constrained"])
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    drawn = [one["properties"] for one in features if one["geometry"]["type"] == "LineString"]
    assert all(one["stroke"] == "#808080" and one["trust"] == "weak" and "misfit 3" in one["reason"] for one in drawn)
    assert "ff808080" in (tmp_path / "a.kml").read_text() and "ffb27200" not in (tmp_path / "a.kml").read_text()
    drawn = [{one.get_label(): one for one in sheet(s, Target.of(UTM)).axes[0].lines} for s in (subject, weak)]
    solid = [np.isfinite(one["fiber"].get_xdata()).sum() for one in drawn]
    assert solid == [50, 0] and "fiber, not to be relied on" in drawn[1]


def test_what_the_corridor_leaves_out_is_said_in_every_format(subject: Subject, tmp_path: Path) -> None:
    left_out = "What it may lack is not looked at."
    bare = replace(subject, place=replace(subject.place, left_out=left_out))
    export(bare, [tmp_path / name for name in ("a.gpkg", "a.csv", "a.dxf")], UTM)
    export(bare, [tmp_path / name for name in ("a.geojson", "a.kml")])
    for layer in ("route", "corridor", "channels"):
        told = geopandas.read_file(tmp_path / "a.gpkg", layer=layer)
        assert told["reason"][told["constrained"]].str.endswith(left_out).all()
    table = pd.read_csv(tmp_path / "a.csv")
    assert (table["reason"] == left_out).equals(table["constrained"])
    assert dict(ezdxf.readfile(tmp_path / "a.dxf").header.custom_vars)["TRUST"].endswith(left_out)
    assert all(left_out in (tmp_path / name).read_text() for name in ("a.geojson", "a.kml"))
    assert any(left_out in " ".join(text.get_text().split()) for text in sheet(bare, Target.of(UTM)).texts)


def test_geojson_is_what_the_standard_says(subject: Subject, tmp_path: Path) -> None:
    export(subject, tmp_path / "a.geojson")
    whole = json.loads((tmp_path / "a.geojson").read_text())
    assert "crs" not in whole and "QLA needs exposure" in whole["claim"]
    assert geopandas.read_file(tmp_path / "a.geojson").crs.to_epsg() == 4326
    lines = [one for one in read_features(tmp_path / "a.geojson") if one.kind == "LineString"]
    assert len(lines) == len(stretches(subject)) and np.isfinite(lines[0].coordinates).all()


def test_classes_follow_from_widths_and_never_claim_exposure(subject: Subject) -> None:
    found = accuracy_of(subject.place)
    assert set(found.pas128) == {"QL-B2", "QL-B3", "QL-B4"}
    assert (found.within[found.pas128 == "QL-B2"] == "QL-B1").any()
    assert (found.across[found.within == "QL-B1"] <= 0.15).all()
    assert (found.pas128[~subject.place.constrained] == "QL-B4").all()
    assert (found.asce38[~subject.place.constrained] == "none").all()
    assert set(accuracy_of(replace(subject.place, grade="weak")).pas128) == {"none"}
    deep = subject.place.covariance.copy()
    deep[:, 2, 2] = 1.0  # a depth that is not known leaves the class that has none
    wide = Placed(subject.place.channel, subject.place.distance, subject.place.route, deep, subject.place.constrained)
    assert "QL-B2" not in accuracy_of(wide).pas128 and "QL-B3" in accuracy_of(wide).pas128


def test_the_sheet_is_one_page(subject: Subject, tmp_path: Path) -> None:
    export(subject, tmp_path / "a.pdf", UTM)
    assert (tmp_path / "a.pdf").read_bytes().count(b"/Type /Page ") == 1
    figure = sheet(subject, Target.of(UTM))
    assert {axes.get_label() for axes in figure.axes} == {"map", "side", "depth", "table"}


@pytest.mark.parametrize("words", [10, 150])
def test_what_the_sheet_says_stands_above_its_map(subject: Subject, words: int) -> None:
    figure = sheet(replace(subject, place=replace(subject.place, trust="misfit " * words)), Target.of(UTM))
    figure.draw_without_rendering()
    (drawn,) = (axes for axes in figure.axes if axes.get_label() == "map")
    dig = next(text for text in figure.texts if text.get_text().startswith("Before anyone digs"))
    titles = [drawn._left_title, drawn.get_legend()]
    assert dig.get_window_extent().y0 >= max(one.get_window_extent().y1 for one in titles)
    assert drawn.get_position().height > 0.05


@pytest.mark.parametrize("azimuth", [78.0, 213.0])
def test_the_sheet_points_north(subject: Subject, azimuth: float) -> None:
    turned = replace(subject, frame=LocalFrame(FRAME.origin, azimuth))
    figure = sheet(turned, Target.of(UTM))
    figure.draw_without_rendering()
    drawn = next(axes for axes in figure.axes if axes.get_label() == "map")
    (arrow,) = (text for text in drawn.texts if getattr(text, "arrow_patch", None))
    start, end = drawn.transData.transform(
        np.column_stack(turned.frame.to_local(FRAME.origin[0] + np.array([0, 1e-4]), FRAME.origin[1] + np.zeros(2)))
    )
    tail, tip = drawn.transAxes.transform([arrow.xyann, arrow.xy])
    north, drawn_north = end - start, tip - tail
    assert north @ drawn_north / np.linalg.norm(north) / np.linalg.norm(drawn_north) > np.cos(np.deg2rad(0.1))


def test_the_sheet_tells_its_signs_its_scale_its_day_and_how_to_dig(subject: Subject) -> None:
    figure = sheet(replace(subject, recorded="2025-08-11"), Target.of(UTM))
    drawn = next(axes for axes in figure.axes if axes.get_label() == "map")
    signs = {text.get_text() for text in drawn.get_legend().get_texts()}
    assert signs == {
        "95 % corridor",
        "survey line, y = 0",
        "fiber",
        "fiber, not to be relied on",
        "anchor, known place",
    }
    (bar,) = (one for one in drawn.artists if isinstance(one, AnchoredSizeBar))
    assert bar.txt_label.get_text() == "20 m"
    words = " ".join(" ".join(text.get_text().split()) for text in figure.texts)
    assert "not a utility locate" in words and "one-call service" in words and "dig by hand" in words
    assert "of a record of 2025-08-11" in words


@pytest.mark.parametrize(
    ("name", "crs", "height", "said"),
    [
        ("a.shp", UTM, None, "unknown kind of file; give one of .gpkg"),
        ("a.gpkg", "EPSG:99", None, "--crs EPSG:99: not known to pyproj"),
        ("a.gpkg", "EPSG:4978", None, "--crs EPSG:4978: no coordinates on a map"),
        ("a.gpkg", "EPSG:2039+5773", None, "give the road's height in it with --ground-height"),
        ("a.gpkg", UTM, 3.0, "--ground-height: --crs EPSG:32636 has no heights"),
        ("a.gpkg", "EPSG:32636+5773", float("nan"), "--ground-height: give a number"),
        ("a.geojson", UTM, None, ".geojson files are WGS 84 by their standard"),
        ("a.kml", UTM, None, ".kml files are WGS 84 by their standard"),
        ("a.dxf", "EPSG:2263+5703", 3.0, "a drawing has one unit, meters or feet; --crs"),
        ("a.gpkg", "EPSG:2263+6358", 3.0, "--crs EPSG:2263+6358: its third axis points down"),
        ("a.dxf", "EPSG:4326", None, "a drawing holds lengths, not degrees; give a projected --crs"),
    ],
)
def test_what_cannot_be_written_is_one_line(
    subject: Subject, tmp_path: Path, name: str, crs: str, height: float | None, said: str
) -> None:
    with pytest.raises(InputError) as error:
        export(subject, tmp_path / name, crs, height)
    assert said in str(error.value) and "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("crs", "said"),
    [
        (UTM, []),
        ("EPSG:4326", []),
        ("EPSG:2039", ["the step from WGS 84 to its datum is good to 0.5 m"]),
        ("EPSG:32736", ["is for longitudes 30 to 36, latitudes -80 to 0, and the survey is at longitude 34.804"]),
        ("EPSG:27700", ["is for longitudes -9.01 to 2.01", "the step from WGS 84 to its datum is of unknown accuracy"]),
    ],
)
def test_what_a_crs_lacks_at_the_survey_is_told(
    subject: Subject, tmp_path: Path, caplog: Any, crs: str, said: list[str]
) -> None:
    export(subject, tmp_path / "a.csv", crs)
    lines = [record.getMessage() for record in caplog.records if record.name == "roadfiber"]
    assert len(lines) == len(said) and all(part in line for part, line in zip(said, lines, strict=True)), lines


def test_a_package_that_is_missing_is_named(subject: Subject, tmp_path: Path, monkeypatch: Any) -> None:
    real = builtins.__import__

    def without(name: str, *given: Any, **more: Any) -> Any:
        if name.split(".")[0] in ("geopandas", "ezdxf"):
            raise ImportError(name)
        return real(name, *given, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    for name in ("a.gpkg", "a.dxf"):
        with pytest.raises(InputError, match=r"pip install roadfiber\[gis\]"):
            export(subject, tmp_path / name, UTM)
    export(subject, tmp_path / "a.csv", UTM)  # and what needs none is written
    assert set(WRITERS) == {".gpkg", ".geojson", ".kml", ".dxf", ".csv", ".pdf"}


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.txt", "", "points and lines are read from"),
        ("a.geojson", "{", "not JSON"),
        ("a.geojson", '{"type": "Polygon"}', "neither a point nor a line"),
        ("a.geojson", '{"type": "Point", "coordinates": ["a", 3]}', "not longitude, latitude"),
        ("a.geojson", '{"type": "Point", "coordinates": [180000, 660000]}', "in degrees"),
        ("a.kml", "<kml>", "not a readable KML file"),
        ("a.kml", '<!DOCTYPE a [<!ENTITY b "c">]><kml/>', "with a document type"),
        ("a.gpkg", "no database", "not a readable GeoPackage"),
    ],
)
def test_maps_that_cannot_be_read_are_one_line(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        read_features(tmp_path / name)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_geopackage_is_no_other_format_and_computes_nothing(subject: Subject, tmp_path: Path) -> None:
    export(subject, tmp_path / "a.gpkg", UTM)
    layer = f'<OGRVRTLayer name="route"><SrcDataSource>{tmp_path / "a.gpkg"}</SrcDataSource></OGRVRTLayer>'
    (tmp_path / "b.gpkg").write_text(f"<OGRVRTDataSource>{layer}</OGRVRTDataSource>")
    assert len(geopandas.read_file(tmp_path / "b.gpkg"))  # GDAL reads what it names
    with pytest.raises(InputError, match="not a readable GeoPackage"):
        read_features(tmp_path / "b.gpkg")
    with closing(sqlite3.connect(tmp_path / "a.gpkg")) as file:
        file.executescript(
            """DROP TABLE channels; DROP TABLE route;
            CREATE VIEW channels AS WITH RECURSIVE n(geom) AS (VALUES(1) UNION ALL SELECT 2 FROM n) SELECT * FROM n;
            CREATE TABLE route(geom, huge AS (zeroblob(1000000000)));
            INSERT INTO route VALUES (NULL)"""
        )
    with pytest.raises(InputError, match="too big"):
        read_features(tmp_path / "a.gpkg")
    deep = bytes([1, 7, 0, 0, 0, 1, 0, 0, 0]) * 100_000  # a recursive reader ends the process
    with closing(sqlite3.connect(tmp_path / "a.gpkg", isolation_level=None)) as file:
        file.execute("DROP TABLE route")
        file.execute("CREATE TABLE route(geom)")
        file.execute("INSERT INTO route VALUES (?)", [b"GP\0\1" + bytes(4) + deep])
        file.execute("UPDATE gpkg_spatial_ref_sys SET organization = 'mine', definition = printf('%.*c', 9000, '(')")
    with pytest.raises(InputError, match="not a readable GeoPackage") as error:
        read_features(tmp_path / "a.gpkg")
    assert len(str(error.value)) < 600
    with closing(sqlite3.connect(tmp_path / "a.gpkg", isolation_level=None)) as file:
        file.execute("UPDATE gpkg_spatial_ref_sys SET organization = 'EPSG'")
    assert {one.kind for one in read_features(tmp_path / "a.gpkg")} == {"LineString", "Point"}


def test_a_route_whose_channels_lie_at_one_place_is_exported(subject: Subject, tmp_path: Path) -> None:
    here = replace(subject, place=replace(subject.place, route=np.zeros_like(subject.place.route)))
    export(here, [tmp_path / "a.kml", tmp_path / "a.gpkg"])
    assert {name for name, _ in pyogrio.list_layers(tmp_path / "a.gpkg")} >= {"channels", "anchors"}


def test_points_without_attributes_are_no_anchors(tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text('{"type": "Point", "coordinates": [34.8, 32.1]}')
    with pytest.raises(InputError, match="no point with the attributes channel and sigma_xy"):
        read_anchors(tmp_path / "a.geojson", FRAME)


def test_a_run_is_exported_and_laid_on_its_record(survey: Any, tmp_path: Path) -> None:
    run = run_of(survey.result, **survey.arguments)
    run.save(tmp_path / "run")
    words = ["export", str(tmp_path / "run"), "--to", str(tmp_path / "a.gpkg"), "--to", str(tmp_path / "a.pdf")]
    done = CliRunner().invoke(roadfiber.command.app, [*words, "--crs", UTM])
    assert done.exit_code == 0 and "a.pdf" in done.output
    route = run.route
    patch = dascore.Patch(
        data=np.zeros((3, 200)),
        coords={"time": np.arange(3) * np.timedelta64(1, "s"), "distance": np.arange(200.0)},
        dims=("time", "distance"),
    )
    laid = run.to_patch(patch)
    assert laid.attrs.route_trust == run.facts["trust"]["grade"] and laid.attrs.route_reason in set(route["reason"])
    y = np.asarray(laid.get_coord("y").data)
    at = route["channel"].to_numpy()[route["constrained"]]
    assert np.flatnonzero(np.isfinite(y)).tolist() == at.tolist()
    assert y[at] == pytest.approx(route["y"][route["constrained"]].to_numpy())
    assert np.isfinite(np.asarray(laid.get_coord("sigma_z").data)[at]).all()
    with pytest.raises(InputError, match="are not on the route"):
        run.to_patch(patch.update_coords(distance=np.arange(200.0) + 5000))
