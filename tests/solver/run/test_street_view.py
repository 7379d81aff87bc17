"""The route in the camera's picture."""

import re
from dataclasses import replace

import numpy as np
import pytest

from solver.run.folder import read_run
from solver.run.report.report_page import render
from solver.run.report.street_view import path_of, street_section
from solver.run.run import run_of


class FromAbove:
    """A camera that looks straight down: 4 px a meter, (0, 0) in the middle; it sees nothing beyond x = 60 m."""

    jpeg = b"\xff\xd8\xff street"
    size = (640, 360)
    text = '{"a": "<b>"}'

    def to_image(self, ground: np.ndarray) -> np.ndarray:
        there = np.asarray(ground) * 4 + [320.0, 180.0]
        return np.where(ground[:, :1] < 60, there, np.nan)


@pytest.fixture
def run(survey):
    return replace(run_of(survey.result, **survey.arguments), scene=FromAbove())


def test_the_route_lies_where_the_camera_puts_it_and_ends_where_it_does_not_look(run) -> None:
    section = street_section(run)
    line = re.search(r'<path d="(M[^"]*)" fill="none" stroke="#d55e00"', section)
    assert line is not None
    places = np.array([part.split() for part in line[1][1:].split(" L")], dtype=float)
    x, y = run.result.route[:, 0], run.result.route[:, 1]
    seen = (4 * x + 320 > -160) & (4 * x + 320 < 800) & (x < 60)
    np.testing.assert_allclose(places, np.column_stack([4 * x + 320, 4 * y + 180])[seen], atol=0.06)
    assert section.count("<rect") == sum(a.x < 60 for a in run.anchors) > 0


def test_what_a_camera_does_not_see_is_not_a_section(run) -> None:
    far = replace(run.result, route=run.result.route + np.array([1000.0, 0, 0]))
    assert street_section(replace(run, result=far)) == "" == street_section(replace(run, scene=None))


def test_a_path_is_broken_where_places_are_not_known() -> None:
    gap = np.array([[0, 0], [1, 0], [np.nan, 0], [9, 9], [np.nan, 0], [5, 5], [6, 6.5]])
    assert path_of(gap) == "M0.0 0.0 L1.0 0.0 M5.0 5.0 L6.0 6.5"
    assert path_of(gap, np.arange(7) > 2) == "M5.0 5.0 L6.0 6.5"


def test_it_is_on_the_page_and_kept_in_the_folder(run, tmp_path) -> None:
    assert "The fiber on the street" in render(run) and "data:image/jpeg;base64," in render(run)
    run.save(tmp_path / "run")
    assert (tmp_path / "run" / "street.jpg").read_bytes() == FromAbove.jpeg
    assert (tmp_path / "run" / "calibration.json").read_text() == FromAbove.text
    assert read_run(tmp_path / "run").scene is None, "who knows cameras reads it"
