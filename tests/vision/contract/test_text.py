"""TOML and JSON are read as editors save them; what is not UTF-8 is named as what it is."""

import json
import os
from functools import partial

import pytest

from calib.clock import read_clock
from calib.options import local_frame
from solver.simulator import read_scenario
from solver.survey.das.array_files import read_side_file
from vision.contract import InputError, read_text
from vision.contract.csv_table import read_csv
from vision.contract.geometry import read_features

SIDE = 'start = 2025-08-11T06:00:00Z\nsampling_rate = 10.0\nunit = "1/s"\n'
FRAME = "[frame]\norigin = [32.1, 34.8]\nx_azimuth = 78.0\n"


def side_file(path):
    return read_side_file(path.with_suffix(".npy"))


READERS = {
    "a side file": (side_file, SIDE),
    "a frame": (lambda path: local_frame(path, None, None), FRAME),
    "a scenario": (lambda path: read_scenario(str(path)), "passes = 3\n"),
}


@pytest.mark.parametrize("which", READERS)
def test_a_byte_order_mark_is_passed_over(tmp_path, which):
    read, text = READERS[which]
    path = tmp_path / "a.toml"
    path.write_text(text, encoding="utf-8")
    plain = read(path)
    path.write_text(text, encoding="utf-8-sig")
    assert read(path) == plain


@pytest.mark.parametrize("which", READERS)
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_named(tmp_path, which, encoding):
    read, text = READERS[which]
    path = tmp_path / "a.toml"
    path.write_text(text, encoding=encoding)
    with pytest.raises(InputError, match=r"a\.toml: is in UTF-16; save it as UTF-8$"):
        read(path)


def test_another_encoding_is_reported_with_its_line(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes("[frame]\nname = 'Straße'\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"a\.toml: line 2 is not UTF-8; save it as UTF-8, or give a site\.toml"):
        read_text(path, "a site.toml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a = " + "[" * 3000, "invalid TOML"),
        ("a = " + "9" * 5000, "invalid TOML"),
        ("[camera]\nstart = 0001-01-01T00:00:00+14:00\nvideo = 'a.mp4'", "start 0001-01-01.*is of no year from 1970"),
        ("[camera]\nstart = 9999-12-31T23:59:59-12:00\nvideo = 'a.mp4'", "start 9999-12-31.*is of no year from 1970"),
    ],
)
def test_toml_that_python_cannot_hold_is_one_line(tmp_path, text, says):
    (tmp_path / "site.toml").write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        read_clock(tmp_path / "site.toml")
    assert "\n" not in str(caught.value)


def test_json_nested_without_end_is_one_line(tmp_path):
    (tmp_path / "a.geojson").write_text('{"features":' * 3000)
    with pytest.raises(InputError, match="not JSON"):
        read_features(tmp_path / "a.geojson")


def test_what_has_no_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "a.csv")
    for path, read in ((tmp_path / "a.csv", read_csv), (tmp_path / "a.csv", partial(read_text, wanted="text"))):
        with pytest.raises(InputError, match=r"no such file|not a file of at most"):
            read(path)
    with (tmp_path / "b.toml").open("w") as sparse:
        sparse.truncate(1 << 40)
    with pytest.raises(InputError, match=r"b\.toml: not a file of at most 256 MiB; give text"):
        read_text(tmp_path / "b.toml", "text")


def test_geometries_without_a_position_are_left_out(tmp_path):
    """Programs write them for what has no place; `locate` ended in a traceback."""
    path, line = tmp_path / "a.geojson", {"type": "LineString", "coordinates": [[34.8, 32.1], [34.9, 32.1]]}
    empty = [{"type": kind, "coordinates": []} for kind in ("Point", "LineString", "MultiLineString")]
    empty.append({"type": "MultiLineString", "coordinates": [[]]})
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": [*empty, line]}))
    assert [one.kind for one in read_features(path)] == ["LineString"]
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": empty}))
    with pytest.raises(InputError, match="holds neither a point nor a line"):
        read_features(path)
