"""The clock command: what site.toml sets and what the video's frames then have."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import roadfiber.command
from tests.vision.videos import numbered_images, set_creation_time, set_frame_durations, write_video
from vision.contract import InputError

SITE = """[camera]
video = "street.mp4"
calibration = "calibration.json"
start = 2025-08-11T06:00:02.5Z
clock_offset = 0.25
"""


@pytest.fixture
def site(tmp_path):
    video = write_video(tmp_path / "street.mp4", numbered_images(20), rate=10.0)
    set_creation_time(video, np.datetime64("2025-08-11T06:00:00"))
    (tmp_path / "site.toml").write_text(SITE)
    return tmp_path / "site.toml"


def run(*arguments):
    return CliRunner().invoke(roadfiber.command.app, ["calibrate", "clock", *map(str, arguments)])


def test_frames_are_on_utc_less_the_offset(site):
    found = json.loads(run(site, "--json").stdout)
    assert found["first"] == "2025-08-11T06:00:02.250000+00:00"
    assert found["last"] == "2025-08-11T06:00:04.150000+00:00"
    assert found["start_after_header"] == 2.5 and found["frames"] == 20
    assert found["interval"] == pytest.approx(0.1) and found["gaps"] == 0


def test_an_offset_can_be_tried_and_a_folder_given(site):
    result = run(site.parent, "--offset", "-1")
    assert result.exit_code == 0 and "06:00:03.500 UTC" in result.output and "-1.000 s" in result.output


def test_gaps_are_counted(site):
    path = site.parent / "street.mp4"
    set_frame_durations(path, [1024] * 9 + [4096] + [1024] * 10)
    found = json.loads(run(site, "--json").stdout)
    assert found["gaps"] == 1 and found["longest"] == pytest.approx(4 * found["interval"], rel=0.01)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[camera]", "[film]", "no [camera] video"),
        ("02.5Z", "02.5", "start 2025-08-11 06:00:02.500000: has no time zone"),
        ("0.25", '"soon"', "clock_offset is soon; give seconds"),
        ("street.mp4", "absent.mp4", "absent.mp4: no such file"),
        ("start =", "start ?", "invalid TOML"),
    ],
)
def test_bad_files_are_one_line(site, old, new, message):
    site.write_text(SITE.replace(old, new))
    result = run(site)
    assert isinstance(result.exception, InputError) and message in str(result.exception)
    assert "\n" not in str(result.exception)
