import json

import pytest

from solver.survey.anchors import Anchor, read_anchors, stated_anchors
from vision.contract import InputError, LocalFrame

FRAME = LocalFrame((32.113, 34.804), 78.0)
HEADER = "name,channel,x,y,z,sigma_xy,sigma_z"
EAST = "east,158,87.974,4.6,1.0,0.05,0.1"
WEST = "west,84.5,12.5,4.75,0.96,0.05,0.05"


def written(folder, *lines):
    path = folder / "anchors.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_anchors_come_sorted_by_channel(tmp_path):
    anchors = read_anchors(written(tmp_path, HEADER, EAST, WEST), FRAME)
    assert anchors == [
        Anchor("west", 84.5, 12.5, 4.75, 0.96, 0.05, 0.05),
        Anchor("east", 158.0, 87.974, 4.6, 1.0, 0.05, 0.1),
    ]


@pytest.mark.parametrize(
    ("names", "place", "error"),
    [("x,y", "12.5,4.8", 0.029), ("lat,lon", "32.11301,34.80412", 0.3), ("x,y", "1.25,4", 0)],
)
def test_a_sigma_below_what_digits_carry_is_raised_and_told(tmp_path, names, place, error):
    row = f"west,84,{place},1,0.01,0.05"
    (anchor,), told = stated_anchors(written(tmp_path, HEADER.replace("x,y", names), row), FRAME)
    assert anchor.sigma_xy == pytest.approx((0.01**2 + error**2) ** 0.5, rel=0.03)
    assert anchor.sigma_z == pytest.approx((0.05**2 + 1 / 12) ** 0.5)
    said = [
        f"sigma: of 1 anchors it is below the {one:.2g} m by which rounding alone is off; this is added"
        for one in (error, 0.29)
        if one
    ]
    assert told[0].cautions == said


@pytest.mark.parametrize("names", ["latitude,longitude", "lat,lon"])
def test_latitude_and_longitude_are_projected(tmp_path, names):
    latitude, longitude = FRAME.to_geographic([12.5], [4.75])
    row = f"west,84,{latitude[0]:.9f},{longitude[0]:.9f},0.96,0.05,0.05"
    (anchor,) = read_anchors(written(tmp_path, HEADER.replace("x,y", names), row), FRAME)
    assert (anchor.x, anchor.y, anchor.z) == pytest.approx((12.5, 4.75, 0.96), abs=1e-3)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([""], "empty file"),
        ([HEADER], "no anchors"),
        ([HEADER, WEST.replace("west", '"manhole\nwest"')], r"row 1: name is 'manhole\nwest'; give at most 200"),
        ([HEADER.replace(",z", ",depth"), WEST], "no column z"),
        ([HEADER, WEST, WEST.replace("84.5", "90")], "row 2: name west is there twice"),
        ([HEADER, WEST, WEST.replace("west", "east")], "row 2: channel 84.5 is there twice"),
        ([HEADER, WEST.replace("84.5", "manhole")], "row 1: channel is 'manhole'"),
        ([HEADER, EAST, WEST.replace("0.05,0.05", "0,0.05")], "row 2: sigma_xy is 0"),
        ([HEADER, EAST.replace("0.1", "-1")], "row 1: sigma_z is -1"),
        (
            [HEADER, EAST, WEST.replace("0.96", "-0.96")],
            "row 2: z is -0.96; z points down: give the depth below the road",
        ),
        ([HEADER, WEST.replace("0.96", "0")], "row 1: z is 0; z points down"),
        (
            [HEADER, WEST.replace("0.96", "96")],
            "row 1: z is 96; z points down: give the depth below the road, m, above 0",
        ),
        (
            [HEADER, "w,84,32.1131,34.8041,1,.1,.1", "e,99,32.1132,34.8042,1,.1,.1"],
            "x and y hold latitude and longitude",
        ),
        ([HEADER, "w,84,670032,3541851,1,.1,.1"], "row 1: x and y are 670032 and 3541851, which are no meters"),
        (
            [HEADER.replace("x,y", "latitude,longitude"), "w,84,34.804,32.113,1,.1,.1"],
            "there or in the frame's origin",
        ),
        ([HEADER, WEST, WEST + ",1,2"], "cannot be read (Error tokenizing"),
    ],
)
def test_bad_anchors_are_one_clear_line(tmp_path, lines, says):
    with pytest.raises(InputError) as caught:
        read_anchors(written(tmp_path, *lines), FRAME)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_is_one_clear_line(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_anchors(tmp_path / "none.csv", FRAME)


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:EPSG::2039", "EPSG:32636"])
def test_coordinates_that_geojson_names_are_honored(tmp_path, name):
    from pyproj import Transformer

    east, north = Transformer.from_crs(4326, name, always_xy=True).transform(34.8045, 32.1131)
    point = {"type": "Point", "coordinates": [east, north]}
    properties = {"name": "west", "channel": 84, "z": 0.9, "sigma_xy": 0.05, "sigma_z": 0.05}
    whole = {"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": name}}}
    whole["features"] = [{"type": "Feature", "geometry": point, "properties": properties}]
    path = tmp_path / "anchors.geojson"
    path.write_text(json.dumps(whole))
    frame = LocalFrame((32.113, 34.804), 78.0)
    x, y = frame.to_local(32.1131, 34.8045)
    (anchor,) = read_anchors(path, frame)
    assert (anchor.x, anchor.y) == pytest.approx((float(x), float(y)), abs=1e-3)
    path.write_text(json.dumps(whole | {"crs": {"type": "name", "properties": {"name": "site grid"}}}))
    with pytest.raises(InputError, match="its crs, 'site grid', is not known; export it again in WGS 84"):
        read_anchors(path, frame)
