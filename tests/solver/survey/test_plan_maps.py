"""Lanes and anchors of a plan from the files of a surveyor's map."""

from pathlib import Path
from typing import Any

import geopandas
import jsonschema
import pytest
from shapely import LineString, Point

import roadfiber as rf
from solver.criticism.planning.planned_site import read_planned
from solver.survey.plan_maps import anchors_of, lanes_of
from vision.contract import InputError, LocalFrame

FRAME = LocalFrame((32.113, 34.804), 78.0)
LANES = [
    ([(-20.0, 0.1), (50.0, -0.1), (120.0, 0.1)], {"car": 4, "truck": 1}),
    ([(110.0, -3.5), (-10.0, -3.5)], {"car": 3, "bus": 1}),
]
SITE = """
[frame]
origin = [32.113, 34.804]
x_azimuth = 78.0
[das]
gauge_length = 10.0
[plan]
length = 100.0
offset = 4.5
snr_db = 15.0
lanes = "{lanes}"
anchors = "{anchors}"
"""


def drawn(path: Path, shapes: list[Any], rows: list[dict[str, Any]], crs: str = "EPSG:4326") -> Path:
    """A file of shapes given in the local frame."""
    around = [type(one)([FRAME.to_geographic(*xy)[::-1] for xy in one.coords]) for one in shapes]
    geopandas.GeoDataFrame(rows, geometry=around, crs=4326).to_crs(crs).to_file(
        path, driver={".kml": "KML"}.get(path.suffix)
    )
    return path


def lines(path: Path, lanes: list[Any] = LANES, crs: str = "EPSG:4326") -> Path:
    return drawn(path, [LineString(way) for way, _ in lanes], [{"name": "lane", **told} for _, told in lanes], crs)


@pytest.mark.parametrize(("suffix", "crs"), [(".gpkg", "EPSG:2039"), (".geojson", "EPSG:4326"), (".kml", "EPSG:4326")])
def test_a_plan_takes_lanes_and_anchors_from_a_map(tmp_path: Path, suffix: str, crs: str) -> None:
    lines(tmp_path / f"lanes{suffix}", crs=crs)
    holes = [Point(88.0, 4.5), Point(12.0, 4.4), Point(300.0, 4.0)]
    drawn(tmp_path / f"holes{suffix}", holes, [{"name": "manhole"}] * 3, crs)
    text = SITE.format(lanes=f"lanes{suffix}", anchors=f"holes{suffix}")
    (tmp_path / "site.toml").write_text(text, encoding="utf-8")
    plan = read_planned(tmp_path).plan
    assert [(one.y, one.toward, one.vehicles) for one in plan.lanes] == [
        (pytest.approx(-0.029, abs=0.002), "+x", {"car": 4, "truck": 1}),
        (pytest.approx(-3.5, abs=0.01), "-x", {"car": 3, "bus": 1}),
    ]
    assert plan.anchors == pytest.approx([12.0, 88.0], abs=0.01)


def test_the_schema_of_site_toml_has_tables_or_a_file() -> None:
    schema = rf.schema("site.toml")
    plan = {"length": 60.0, "offset": 4.0, "snr_db": 15.0}
    tables = [{"y": 0.0, "toward": "+x", "vehicles": {"car": 4}}]
    only_plan = {"$defs": schema["$defs"], "$ref": "#/$defs/PlanSection"}
    for lanes in (tables, "lanes.gpkg"):
        jsonschema.validate(plan | {"lanes": lanes}, only_plan)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(plan | {"lanes": 3}, only_plan)


@pytest.mark.parametrize(
    ("way", "told", "message"),
    [
        ([(0.0, 0.0), (90.0, 0.0)], {"width": 3.5}, "no line that says how many vehicles go along it"),
        ([(0.0, 0.0), (90.0, 0.0)], {"car": 1.5}, "lane 1: car is 1.5; give a whole number"),
        ([(0.0, 0.0), (50.0, 0.0), (40.0, 3.0)], {"car": 1}, "lane 1 does not run along the road"),
        ([(0.0, 0.0), (90.0, 9.0)], {"car": 1}, r"lane 1 leaves y = 4.5 m by 4.5 m; plan a stretch"),
        ([(120.0, 0.0), (190.0, 0.0)], {"car": 1}, "lane 1 lies from x 120 to 190 m, beside no road of the plan"),
    ],
)
def test_lanes_that_cannot_be_planned_are_named(tmp_path: Path, way: Any, told: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        lanes_of(lines(tmp_path / "a.geojson", [(way, told)]), FRAME, 100.0)


def test_a_map_needs_a_frame_a_length_and_points_beside_the_road(tmp_path: Path) -> None:
    path = drawn(tmp_path / "a.geojson", [Point(300.0, 4.0)], [{"name": "far"}])
    with pytest.raises(InputError, match=r"no point lies beside the planned road \(x from 0 to 100 m\)"):
        anchors_of(path, FRAME, 100.0)
    plan = {"lanes": str(path), "offset": 4.5, "snr_db": 15.0}
    with pytest.raises(InputError, match="the plan has no length"):
        read_planned({"das": {"gauge_length": 10.0}, "plan": plan})
    with pytest.raises(InputError, match=r"a map needs \[frame\] in site.toml"):
        read_planned({"das": {"gauge_length": 10.0}, "plan": plan | {"length": 100.0}})
