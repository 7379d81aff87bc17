"""The control point file: what it may hold, and what is refused."""

import numpy as np
import pytest

from calib.control_points import read_control_points
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


def test_latitudes_go_through_the_frame(tmp_path):
    places = np.array([[10.0, -3.0], [60.0, 4.0]])
    latitude, longitude = FRAME.to_geographic(*places.T)
    rows = "\n".join(f"m{k},{k},9,{latitude[k]:.9f},{longitude[k]:.9f}" for k in range(2))
    path = write(tmp_path, f"name,px,py,latitude,longitude\n{rows}\n")
    np.testing.assert_allclose(read_control_points(path, FRAME).ground, places, atol=1e-3)
    with pytest.raises(InputError, match="need a local frame"):
        read_control_points(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no readable csv"),
        ("name,px,py,x,y\n", "no control points"),
        ("name,px,py,x\na,1,2,3\n", "no column y"),
        ("name,px,py,x,y\na,1,2,3,north\n", "row 1: y is 'north'"),
        ("name,px,py,x,y,sigma\na,1,2,3,4,0\n", "above 0 px"),
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
    with pytest.raises(InputError, match=r"No such file.*give a csv"):
        read_control_points(tmp_path / "absent.csv")
