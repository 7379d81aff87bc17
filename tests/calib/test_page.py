"""The calibration page in a real browser: drag, type, undo, save, and nothing from the web."""

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest
from bokeh.document import Document
from street_marks import CAMERA, SIZE, marks

from calib.control_points import write_control_points
from calib.page import Page
from calib.session import Session, marks_of
from tests.web_requests import is_shut
from vision.camera import Calibration

PATIENCE = 90_000  # ms; tests share the machine
READY = "window.Bokeh && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"
# Where a pixel of the frame is on the screen.
PLACE = """([u, v]) => {
    const plot = Bokeh.documents[0].get_model_by_name('picture')
    const view = Bokeh.index.find_one(plot)
    const box = view.el.getBoundingClientRect()
    return [box.x + view.frame.x_scale.compute(u), box.y + view.frame.y_scale.compute(v)]
}"""
ROWS = "() => Array.from(Bokeh.documents[0].get_model_by_name('rows').get('leave_one_out_m'))"
COLUMN = "name => Array.from(Bokeh.documents[0].get_model_by_name('marks').get(name))"


@dataclass
class Street:
    page: Any
    address: str
    out: Any
    asked: list

    def column(self, name):
        return self.page.evaluate(COLUMN, name)

    def status(self):
        return self.page.evaluate("() => Bokeh.documents[0].get_model_by_name('status').text")

    def rms(self):
        return float(re.search(r"id='rms'>([\d.]+)<", self.status())[1])

    def at(self, pixel):
        return self.page.evaluate(PLACE, [float(value) for value in pixel])

    def select(self, index):
        name = self.column("name")[index]
        self.page.locator(".slick-row", has=self.page.get_by_text(name, exact=True)).locator(
            ".slick-cell"
        ).first.click()
        self.wait("name => Bokeh.documents[0].get_model_by_name('field_name').value == name", name)

    def wait(self, condition, argument=None):
        self.page.wait_for_function(condition, arg=argument, timeout=PATIENCE)


@pytest.fixture(scope="module")
def street(chromium, tmp_path_factory):
    """The page of a street with ten marks, and what it asked the network for."""
    tmp_path = tmp_path_factory.mktemp("street")
    cv2.imwrite(str(tmp_path / "street.png"), np.full((SIZE[1], SIZE[0], 3), 120, np.uint8))
    write_control_points(marks(noise=0.4), tmp_path / "points.csv")
    out = tmp_path / "calibration.json"
    words = ["street.png", "--points", "points.csv", "--out", out.name, "--no-browser", "--port", "0"]
    with subprocess.Popen(
        [sys.executable, "-m", "roadfiber", "calibrate", "page", *words],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as server:  # fmt: skip
        try:
            address = re.search(r"http://\S+", server.stdout.readline())[0]
            page = chromium.new_page(viewport={"width": 1280, "height": 950})
            asked: list[str] = []
            page.on("request", lambda request: asked.append(request.url))
            page.goto(address)
            page.wait_for_function(READY, timeout=PATIENCE)
            yield Street(page, address, out, asked)
            page.close()
        finally:
            server.terminate()


@pytest.fixture
def page(tmp_path):
    """The page as the server holds it, without a browser."""
    picture = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
    return Page(Document(), Session(SIZE, marks_of(marks())), picture, tmp_path / "calibration.json")


def dragged(page, **columns):
    """What a browser sends when marks were dragged or added."""
    page.marks.data = {name: [*values] for name, values in page.marks.data.items()} | columns


def test_an_added_mark_that_is_undone_is_no_longer_selected(page):
    """Its index made Bokeh write a later drag into the columns of pixels alone, which the server could not read."""
    added = {"name": "", "color": ""}
    dragged(page, **{name: [*values, added.get(name, 5.0)] for name, values in page.marks.data.items()})
    page.take_over()
    assert page.marks.selected.indices == [10]
    page.undo()
    assert page.marks.selected.indices == [] and len(page.session.marks) == 10
    page.redo()
    assert len(page.session.marks) == 11


def test_what_was_just_dragged_is_kept_by_whatever_is_done_next(page):
    page.marks.selected.indices = [4]
    moved = [px + 3 * (at == 4) for at, px in enumerate(page.marks.data["px"])]
    dragged(page, px=moved)
    page.fields["x"].value = "30.5"
    assert page.session.marks[4].px == pytest.approx(moved[4]) and page.session.marks[4].x == 30.5
    dragged(page, py=[5.0] * 10)
    page.undo()
    assert page.session.marks[4].x == 30.5 and page.session.redo()


def test_nobody_else_drives_the_page(street):
    assert is_shut(street.address)


def test_drag_undo_type_add_save_and_delete(street):
    rms, pixels = street.rms(), np.column_stack([street.column("px"), street.column("py")])
    assert rms < 1 and all(url.startswith("http://localhost:") for url in street.asked)

    assert street.page.evaluate("() => document.documentElement.scrollWidth") <= 1280
    errors = street.page.evaluate(ROWS)
    assert errors == sorted(street.column("leave_one_out_m"), reverse=True), "the worst mark is listed first"
    assert "What to add next" in street.status()
    labels = "() => Bokeh.documents[0].get_model_by_name('labels').get('name').length"
    assert street.page.evaluate(labels) == 0, "only a selected mark has its name beside it"

    start, end = street.at(pixels[4]), street.at(pixels[4] + (60, 0))
    street.page.mouse.move(*start)
    street.page.mouse.down()
    street.page.mouse.move(*end, steps=6)
    street.page.mouse.up()
    street.wait(
        "before => !Bokeh.documents[0].get_model_by_name('status').text.includes(before)", f"id='rms'>{rms:.3f}<"
    )
    assert street.column("px")[4] == pytest.approx(pixels[4, 0] + 60, abs=3)
    assert "left out as outliers: p4" in street.status() and max(street.column("residual_px")) > 30

    street.page.get_by_role("button", name="Undo").click()
    street.wait(
        "before => Bokeh.documents[0].get_model_by_name('status').text.includes(before)", f"id='rms'>{rms:.3f}<"
    )
    assert street.column("px")[4] == pytest.approx(pixels[4, 0])

    street.select(0)
    street.wait("() => Bokeh.documents[0].get_model_by_name('labels').get('name')[0] == 'p0'")
    street.page.get_by_label("x, m").fill(f"{street.column('x')[0] + 8:.2f}")
    street.page.get_by_label("x, m").press("Enter")
    street.wait("() => Bokeh.documents[0].get_model_by_name('status').text.includes('left out as outliers: p0')")
    row = street.page.locator(".slick-row", has=street.page.get_by_text("p0", exact=True))
    assert f"{street.column('x')[0]:.3f}" in row.inner_text(), "the table shows what was typed"
    street.page.get_by_role("button", name="Undo").click()
    street.wait(
        "before => Bokeh.documents[0].get_model_by_name('status').text.includes(before)", f"id='rms'>{rms:.3f}<"
    )

    place = np.array([[18.0, 1.0]])
    street.page.mouse.click(*street.at(CAMERA.project([[*place[0], 0.0]])[0]))
    street.wait("() => Bokeh.documents[0].get_model_by_name('field_name').value == 'p10'")
    for label, value in zip(("x, m", "y, m"), place[0], strict=True):
        street.page.get_by_label(label).fill(f"{value:g}")
        street.page.get_by_label(label).press("Enter")
    street.wait("() => Bokeh.documents[0].get_model_by_name('marks').get('residual_px')[10] < 3")
    assert not street.out.exists()
    street.page.get_by_role("button", name="Save").click()
    street.wait("() => Bokeh.documents[0].get_model_by_name('saved').text != ''")
    assert street.page.evaluate("() => Bokeh.documents[0].get_model_by_name('saved').text").startswith("saved")
    calibration = Calibration.read(street.out)
    assert len(calibration.control_points) == 11 and calibration.covariance is not None
    assert json.loads(street.out.read_text())["image_size"] == list(SIZE)
    assert (street.out.parent / "calibration_points.csv").exists()

    street.page.evaluate(
        "() => {Bokeh.documents[0].get_model_by_name('marks').selected.indices = [0, 1, 2, 3, 4, 5, 6, 7]}"
    )
    street.page.get_by_role("button", name="Delete selected").click()
    street.wait("() => Bokeh.documents[0].get_model_by_name('status').text.includes('3 given')")
    street.page.get_by_role("button", name="Save").click()
    street.wait("() => Bokeh.documents[0].get_model_by_name('saved').text.includes('not saved')")
    assert len(Calibration.read(street.out).control_points) == 11, "the file of before stands"
