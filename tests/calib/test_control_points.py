"""The control point file: what it may hold, and what is refused."""

import json

import numpy as np
import pytest
from pyproj import Transformer

from calib.control_points import read_control_points, write_control_points
from calib.proposed_frame import frame_for, propose_frame
from vision.contract import InputError, LocalFrame

FRAME = LocalFrame((32.113, 34.804), 78.0)


def write(tmp_path, text):
    path = tmp_path / "points.csv"
    path.write_text(text)
    return path


def test_meters_and_sigma(tmp_path):
    points = read_control_points(write(tmp_path, "name,px,py,x,y,sigma,note\na,1,2,3,4,0.5,curb\nb,5,6,7,-8,2,\n"))
    assert points.names == ("a", "b")
    np.testing.assert_array_equal(points.ground, [[3, 4], [7, -8]])
    np.testing.assert_array_equal(points.sigma, [0.5, 2])


def test_what_a_file_does_not_say_is_assumed_aloud(tmp_path, caplog):
    """Places on the globe are known less well than those measured on the road; columns of no use are named."""
    for places, frame, usual in (("x,y", None, 0.05), ("latitude,longitude", FRAME, 0.3)):
        caplog.clear()
        points = read_control_points(write(tmp_path, f"name,px,py,{places},height\na,1,2,32.1131,34.8041,9\n"), frame)
        assert points.sigma_xy.tolist() == [usual]
        assert f"assumed: sigma = 1 px of the marks, sigma_xy = {usual} m of the places" in caplog.text
        assert "not used: column height" in caplog.text
    caplog.clear()
    read_control_points(write(tmp_path, "name,px,py,x,y,sigma,sigma_xy\na,1,2,3,4,1,0\n"))
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("axes", "place"),
    [("ahead,right", (3, 20)), ("ahead,left", (3, -20)), ("right,ahead", (20, 3)), ("east,north", (7.0929, -18.9388))],
)
def test_places_may_be_given_along_other_axes(tmp_path, axes, place):
    """The last as LocalFrame itself has it, for an azimuth of 78 degrees."""
    path = write(tmp_path, "name,px,py,x,y\na,1,2,3,20\n")
    np.testing.assert_allclose(read_control_points(path, FRAME, axes=axes).ground, [place], atol=1e-3)
    for wrong, message in ((f"{axes},up", "give one of ahead,right"), ("east,north", "needs the local frame")):
        with pytest.raises(InputError, match=message):
            read_control_points(path, axes=wrong)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_what_a_spreadsheet_writes_is_read(tmp_path, encoding):
    """Semicolons, decimal commas, names in capitals; a mark that was commented out."""
    path = tmp_path / "points.csv"
    path.write_text("# 2025\nName;PX;PY;X;Y\n01;1,5;2;3;4\n#02;5;6;7;8\n03;5;6;7;-8,25\n", encoding=encoding)
    points = read_control_points(path)
    assert points.names == ("01", "03")
    np.testing.assert_array_equal(points.pixels, [[1.5, 2], [5, 6]])
    np.testing.assert_array_equal(points.ground, [[3, 4], [7, -8.25]])


def test_latitudes_go_through_the_frame(tmp_path):
    places = np.array([[10.0, -3.0], [60.0, 4.0]])
    latitude, longitude = FRAME.to_geographic(*places.T)
    rows = "\n".join(f"m{k},{k},9,{latitude[k]:.9f},{longitude[k]:.9f}" for k in range(2))
    path = write(tmp_path, f"name,px,py,latitude,longitude\n{rows}\n")
    np.testing.assert_allclose(read_control_points(path, FRAME).ground, places, atol=1e-3)
    with pytest.raises(InputError, match="need a local frame"):
        read_control_points(path)
    path = write(tmp_path, f"name,px,py,lat,lon\n{rows}\n")
    np.testing.assert_allclose(read_control_points(path, FRAME).ground, places, atol=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty file"),
        ("name,px,py,x,y\n", "no control points"),
        ("name,px,py,x\na,1,2,3\n", "no column y"),
        ("name,px,x,y\na,1,2,3\n", "no column py"),
        ("name,px,py,x,y,sigma_xy\na,1,2,3,4,-1\n", "row 1: sigma_xy is -1"),
        ("name,px,py,x,y\na,1,2,3,north\n", "row 1: y is 'north'"),
        ("name,px,py,x,y,sigma\na,1,2,3,4,0\n", "above 0 px"),
        ("name,px,py,x,y\na,1,2,670032,3541851\n", "row 1: x and y are 670032 and 3541851, which are no meters"),
        ("name,px,py,x,y,z\na,1,2,3,4,0\nb,5,6,7,8,0.15\n", "row 2: z is 0.15, below the road; z points down"),
        ("name,px,py,x,y\na,1,2,3,4\na,5,6,7,8\n", "row 2: its name is there twice"),
        ("name,px,py,x,y\na,1,2,3,4\nb,1,2,7,8\n", "row 2: its pixel is there twice"),
        ("name,px,py,x,y\na,1,2,3,4\nb,5,6,3,4\n", "row 2: its place is there twice"),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_control_points(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file; give the path"):
        read_control_points(tmp_path / "absent.csv")


PLACES = np.array([[10.0, -3.0], [60.0, 4.0], [35.0, 0.5]])


def utm(code="EPSG:32636"):
    latitude, longitude = FRAME.to_geographic(*PLACES.T)
    east, north = Transformer.from_crs("EPSG:4326", code, always_xy=True).transform(longitude, latitude)
    return east, north


def projected(tmp_path, zone=",36N", swap=False):
    east, north = utm()[::-1] if swap else utm()
    rows = "\n".join(f"m{k},{k},9,{east[k]:.4f},{north[k]:.4f}{zone}" for k in range(3))
    return write(tmp_path, f"name,px,py,easting,northing{',zone' if zone else ''}\n{rows}\n")


def test_utm_goes_through_the_frame(tmp_path):
    np.testing.assert_allclose(read_control_points(projected(tmp_path), FRAME).ground, PLACES, atol=2e-3)
    plain = projected(tmp_path, zone="")
    np.testing.assert_allclose(read_control_points(plain, FRAME, "EPSG:32636").ground, PLACES, atol=2e-3)


@pytest.mark.parametrize(
    ("zone", "crs", "message"),
    [
        ("", None, "need a column zone"),
        ("", "EPSG:nowhere", "--crs EPSG:nowhere: not a coordinate reference system"),
        (",67N", None, "row 1: zone is '67N'"),
        (",12N", None, "km from the frame's origin"),
    ],
)
def test_a_wrong_zone_is_one_line(tmp_path, zone, crs, message):
    with pytest.raises(InputError, match=message):
        read_control_points(projected(tmp_path, zone), FRAME, crs)


def test_swapped_coordinates_are_noticed(tmp_path):
    with pytest.raises(InputError, match="easting and northing look swapped"):
        read_control_points(projected(tmp_path, swap=True), FRAME)
    path = write(tmp_path, "name,px,py,latitude,longitude\na,1,2,34.8041,32.1131\nb,3,4,34.8043,32.1132\n")
    with pytest.raises(InputError, match="latitude and longitude look swapped"):
        read_control_points(path, FRAME)


def reference_points(path, places=PLACES, zones=(36, 36, 36), frame=FRAME):
    """Write what OTVision's picker of reference points does."""
    content = {}
    for k, (zone, latitude, longitude) in enumerate(zip(zones, *frame.to_geographic(*places.T), strict=True)):
        east, north = Transformer.from_crs("EPSG:4326", f"EPSG:326{zone}", always_xy=True).transform(
            longitude, latitude
        )
        pixel = {"x_px": 10 * k, "y_px": 5}
        content[str(k + 1)] = pixel | {"hemisphere": "N", "zone_utm": zone, "lon_utm": east, "lat_utm": north}
    path.write_text(json.dumps(content, indent=4))
    return path


@pytest.mark.parametrize("zones", [(36, 36, 36), (37, 36, 36)])
def test_reference_points_of_otvision(tmp_path, zones):
    """Beside the border of two zones some people take the one and some the other."""
    border = LocalFrame((32.113, 36.0), 78.0)
    points = read_control_points(reference_points(tmp_path / "street.otrfpts", zones=zones, frame=border), border)
    assert points.names == ("1", "2", "3") and points.pixels[2].tolist() == [20, 5]
    np.testing.assert_allclose(points.ground, PLACES, atol=1e-3)


def test_reference_points_without_places(tmp_path):
    path = tmp_path / "street.otrfpts"
    path.write_text(json.dumps({"1": {"x": 292, "y": 272}}))
    with pytest.raises(InputError, match="point 1 has no x_px, y_px"):
        read_control_points(path, FRAME)


def test_a_frame_is_proposed_for_points_on_the_globe(tmp_path):
    road = np.array([[-40.0, 3.0], [0.0, -3.0], [0.0, 3.0], [10.0, 3.1], [40.0, -3.0]])
    path = reference_points(tmp_path / "street.otrfpts", road, [36] * 5)
    frame = propose_frame(path)
    assert frame.x_azimuth == pytest.approx(FRAME.x_azimuth, abs=6)
    x, y = frame.to_local(*FRAME.origin)
    assert np.hypot(x, y) < 5
    apart = np.linalg.norm(np.diff(read_control_points(path, frame).ground, axis=0), axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(np.diff(road, axis=0), axis=1), atol=1e-3)
    assert propose_frame(write(tmp_path, "name,px,py,x,y\na,1,2,3,4\n")) is None
    with pytest.raises(InputError, match="latitude is 320"):
        propose_frame(write(tmp_path, "name,px,py,latitude,longitude\na,1,2,320,34\n"))


def test_a_frame_that_is_given_is_taken(tmp_path, caplog):
    path = reference_points(tmp_path / "street.otrfpts")
    site = tmp_path / "site.toml"
    site.write_text("[frame]\norigin = [32.113, 34.804]\nx_azimuth = 78.0\n")
    assert frame_for(path, site, None, None, None) == frame_for(path, None, "32.113,34.804", 78.0, None) == FRAME
    assert frame_for(None, None, None, None, None) is None and not caplog.records
    site.write_text("[das]\n")
    assert frame_for(path, site, None, None, None) == propose_frame(path)
    assert "taken [frame] origin = [32.11" in caplog.text
    with pytest.raises(InputError, match=r"no \[frame\]"):
        frame_for(None, site, None, None, None)


def test_json_and_a_calibrations_points(tmp_path):
    path = tmp_path / "points.json"
    path.write_text(json.dumps([{"name": "a", "px": 1, "py": 2, "x": 3, "y": 4, "sigma": 0.5}]))
    assert read_control_points(path).sigma.tolist() == [0.5]
    path.write_text(json.dumps({"control_points": [{"name": "a", "u": 1, "v": 2, "x": 3, "y": 4}]}))
    assert read_control_points(path).pixels.tolist() == [[1, 2]]
    for text, message in (("{", "not JSON"), ("3", "no list of control points"), ("[]", "no control points")):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_control_points(path)


def test_what_is_written_is_read_back(tmp_path):
    rows = "a,1.25,2,3,4,0.5,0.1\nb,5,6,7,-8,2,0\n"
    points = read_control_points(write(tmp_path, f"name,px,py,x,y,sigma,sigma_xy\n{rows}"))
    write_control_points(points, tmp_path / "again.csv")
    again = read_control_points(tmp_path / "again.csv")
    assert again.names == points.names
    for name in ("pixels", "ground", "sigma", "sigma_xy"):
        np.testing.assert_array_equal(getattr(again, name), getattr(points, name))
