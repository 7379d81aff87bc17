"""The state of the page: marks, undo, fit, save."""

import numpy as np
import pytest
from street_marks import CAMERA, SIZE, marks
from typer.testing import CliRunner

import roadfiber.command
from calib.layers import ABOVE, ellipses, from_above, grid_in_picture, rgba
from calib.maps import area
from calib.page_text import typed_mark, with_place
from calib.session import Mark, Session, marks_of
from vision.camera import Calibration
from vision.contract import InputError, LocalFrame


@pytest.fixture
def session():
    return Session(SIZE, marks_of(marks(noise=0.4)))


def moved(session, index, dx):
    first, chosen, rest = session.marks[:index], session.marks[index], session.marks[index + 1 :]
    return (*first, Mark(chosen.name, chosen.px + dx, chosen.py, chosen.x, chosen.y), *rest)


def test_undo_and_redo(session):
    before = session.marks
    assert not session.change(before) and not session.undo()
    assert session.change(moved(session, 2, 5.0)) and session.change(moved(session, 2, 5.0))
    assert session.undo() and session.undo() and session.marks == before and not session.undo()
    assert session.redo() and session.marks[2].px == pytest.approx(before[2].px + 5)
    session.change(moved(session, 0, 1.0))
    assert not session.redo(), "a new change ends what can be redone"


def test_a_mark_without_a_place_waits(session):
    session.change((*session.marks, Mark("", 300.0, 600.0)))
    assert session.marks[-1].name == "p10" or session.marks[-1].name not in [m.name for m in session.marks[:-1]]
    assert not session.marks[-1].placed and len(session.points()) == len(session.marks) - 1
    assert session.fit().used.all()


def test_dragging_a_mark_changes_the_error(session):
    before = session.fit().residuals_px.max()
    session.change(moved(session, 4, 3.0))
    assert session.fit().residuals_px.max() > before + 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m[:3], "3 given"),
        (lambda m: (), "0 given"),
        (lambda m: (*m, Mark("p0", 5.0, 600.0)), "p0: the name is there twice"),
        (lambda m: (*m[:-1], Mark("p9", 5.0, 600.0, 10.0, 3.0, sigma=0.0)), "p9: sigma must be above 0"),
    ],
)
def test_what_cannot_be_fitted_is_one_line_and_not_saved(session, tmp_path, change, message):
    session.change(change(session.marks))
    with pytest.raises(InputError, match=message):
        session.save(tmp_path / "c.json")
    assert not list(tmp_path.iterdir())


def test_it_saves_what_the_command_line_writes(session, tmp_path):
    session.change((*session.marks, Mark("loose", 300.0, 600.0)))
    calibration, points = session.save(tmp_path / "page.json")
    arguments = ["calibrate", "ground", points, "--image-size", "1280x720", "--out", tmp_path / "line.json"]
    assert CliRunner().invoke(roadfiber.command.app, [str(word) for word in arguments]).exit_code == 0
    page, line = (Calibration.read(path) for path in (calibration, tmp_path / "line.json"))
    np.testing.assert_allclose(page.homography, line.homography, rtol=1e-4)
    assert page.model == line.model and [p.name for p in page.control_points] == [p.name for p in line.control_points]


def test_the_view_from_above_shows_the_road_where_it_is(session):
    """A frame whose brightness is its column: from above, every pixel has that of the place's column."""
    view = session.fit().calibration
    frame = np.repeat(np.linspace(0, 255, SIZE[0]).astype(np.uint8)[None, :, None], SIZE[1], axis=0).repeat(3, axis=2)
    low, high = area(view)
    seen = from_above(frame, view, low, high)
    columns, rows = ABOVE
    assert seen.shape == (rows, columns)
    at = (200, 300)
    place = low + (np.array([at[1], at[0]]) + 0.5) * (high - low) / (columns, rows)
    u = view.to_image([place])[0, 0]
    assert (int(seen[at]) & 255) == pytest.approx(u * 255 / SIZE[0], abs=2) and int(seen[at]) >> 24 == 255
    assert (seen >> 24 == 0).any()


def test_the_grid_lies_on_the_road_and_ellipses_around_the_places(session):
    view = session.fit().calibration
    xs, ys = grid_in_picture(view, session.points().ground)
    line = np.column_stack([xs[0], ys[0]])
    line = line[np.isfinite(line).all(axis=1)]
    assert np.ptp(view.to_ground(line)[:, 0]) < 1e-6
    pixels = session.points().pixels
    outlines = np.stack(ellipses(view, pixels, np.ones(len(pixels))), axis=-1)
    np.testing.assert_allclose(outlines[:, :-1].mean(axis=1), view.to_ground(pixels), atol=1e-9)
    far, near = CAMERA.project([[72, 0, 0]]), CAMERA.project([[12, 0, 0]])
    sizes = [np.ptp(np.stack(ellipses(view, pixel, np.ones(1)), axis=-1)[0], axis=0).max() for pixel in (far, near)]
    assert sizes[0] > 3 * sizes[1]


def test_colors_are_packed():
    assert rgba(np.array([[[255, 0, 0]]], np.uint8))[0, 0] == 0xFFFF0000


def test_what_is_typed_becomes_a_mark():
    mark = Mark("p1", 5.0, 6.0)
    texts = {"name": " curb ", "px": "7", "py": "8.5", "x": "1", "y": "-2", "sigma": "0.5", "sigma_xy": "0.02"}
    assert typed_mark(mark, texts) == Mark("curb", 7.0, 8.5, 1.0, -2.0, 0.5, 0.02)
    assert not typed_mark(mark, texts | {"y": " "}).placed


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [("px", "", "px: give a number"), ("x", "far", "x, m: far is no"), ("y", "inf", "y, m")],
)
def test_what_is_not_a_number_is_said(name, text, message):
    with pytest.raises(ValueError, match=message):
        typed_mark(Mark("p1", 5.0, 6.0), {name: text})


def test_latitude_and_longitude_can_be_pasted():
    frame = LocalFrame((32.113, 34.804), 78.0)
    latitude, longitude = frame.to_geographic(40.0, -3.0)
    found = with_place({"x": f"{latitude:.8f}, {longitude:.8f}", "y": ""}, frame)
    assert (float(found["x"]), float(found["y"])) == pytest.approx((40, -3), abs=2e-3)
    assert with_place({"x": "40.5", "y": "1"}, frame) == {"x": "40.5", "y": "1"}
    for text, where, message in (
        (f"{longitude}, {latitude}", frame, "swapped"), ("32.1, 34.8", None, "need a local frame"),
        ("here, there", frame, "give LATITUDE, LONGITUDE"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            with_place({"x": text, "y": ""}, where)
