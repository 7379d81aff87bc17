"""TOML and JSON are read as editors save them; what is not UTF-8 is named as what it is."""

import pytest

from calib.options import local_frame
from solver.simulator import read_scenario
from solver.survey.das.array_files import read_side_file
from vision.contract import InputError, read_text

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
