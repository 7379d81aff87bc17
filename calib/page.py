"""The calibration page: drag marks on a frame, type their places, see the errors at once. Bokeh, served locally."""

import html
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import Button, CheckboxGroup, ColumnDataSource, Div, Select, TextInput
from numpy.typing import NDArray

from calib.ground import MODELS, GroundFit
from calib.layers import ellipses, from_above, grid_in_picture
from calib.maps import area, sigma_image
from calib.next_mark import advice_lines, odd_marks
from calib.page_parts import BESIDE, CARD, WIDTH, above_plot, mark_table, picture_plot, style_sheet, worst_table
from calib.page_text import EDITED, FIELDS, FOUND, describe, read_marks, table_data, typed_mark, with_place
from calib.session import Mark, Session
from vision.contract import InputError

Image = NDArray[np.uint8]
NO_LINES: dict[str, list[Any]] = {"xs": [], "ys": []}
NO_IMAGE: dict[str, list[Any]] = {"image": [], "x": [], "y": [], "dw": [], "dh": []}
NO_POINTS: dict[str, list[Any]] = {"x": [], "y": [], "name": []}
LAYERS = ("ground grid", "residuals x20", "error map")
NO_WORST: dict[str, list[Any]] = {"name": [], "off": [], "expected": [], "times": []}
NO_CHOSEN: dict[str, list[Any]] = {"px": [], "py": [], "name": []}
WAIT = 80  # ms, in which changes are gathered before the fit
MAGNIFY = 20.0


class Page:
    """The models of one open page, and what keeps them in step with its session."""

    def __init__(self, document: Document, session: Session, image: Image, out: Path):
        self.document, self.session, self.image, self.out = document, session, image, out
        self.waiting, self.writing = False, False
        self.marks = ColumnDataSource({name: [] for name in (*EDITED, *FOUND)}, name="marks")
        self.worst = ColumnDataSource(dict(NO_WORST), name="worst_marks")
        self.chosen = ColumnDataSource(dict(NO_CHOSEN), name="chosen")
        self.lines = ColumnDataSource(dict(NO_LINES))
        self.residuals = ColumnDataSource(dict(NO_LINES))
        self.errors = ColumnDataSource(dict(NO_IMAGE))
        self.above_image = ColumnDataSource(dict(NO_IMAGE))
        self.above_ellipses = ColumnDataSource(dict(NO_LINES))
        self.above_points = ColumnDataSource(dict(NO_POINTS), name="above_points")
        self.status = Div(name="status", width=WIDTH + 20, styles=CARD)
        self.saved = Div(name="saved", width=BESIDE, styles={"font-size": "13px", "overflow-wrap": "anywhere"})
        self.advice = Div(name="advice", width=BESIDE, styles=CARD)
        self.fields = self._fields()
        frame = {"marks": self.marks, "chosen": self.chosen, "lines": self.lines, "residuals": self.residuals}
        self.picture, self.layers = picture_plot(image, frame | {"errors": self.errors}, session.image_size)
        self.above = above_plot(
            {"image": self.above_image, "ellipses": self.above_ellipses, "points": self.above_points}
        )
        document.title = "roadfiber calibrate"
        document.add_root(self._layout())
        self.marks.selected.on_change("indices", lambda _attr, _old, _new: self.fill_fields())
        self.worst.selected.on_change("indices", lambda _attr, _old, new: self.select_worst(new))
        self.marks.on_change("data", lambda _attr, _old, _new: self.edited())
        self.show()

    def _fields(self) -> dict[str, Any]:
        """Inputs for the selected mark."""
        fields = {}
        for name, title in FIELDS.items():
            fields[name] = TextInput(
                title=title, width=100 if name == "name" else 56, name=f"field_{name}", disabled=True
            )
            fields[name].on_change("value", lambda _attr, _old, _new: self.typed())
        return fields

    def _layout(self) -> Any:
        model = Select(title="model", value=self.session.model, options=list(MODELS), width=110, name="model")
        model.on_change("value", lambda _a, _o, value: self.choose(value))
        shown = CheckboxGroup(labels=list(LAYERS), active=[0, 1], inline=True, name="layers")
        shown.on_change("active", lambda _a, _o, active: self.show_layers(active))
        buttons = []
        for label, action in (
            ("Undo", self.undo),
            ("Redo", self.redo),
            ("Delete selected", self.delete),
            ("Save", self.save),
        ):
            button = Button(
                label=label,
                width=120 if label == "Delete selected" else 75,
                button_type="success" if label == "Save" else "default",
                name=label.split()[0].lower(),
            )
            button.on_click(action)
            buttons.append(button)
        head = Div(
            name="head",
            width=WIDTH + BESIDE,
            text="<h1>Where the camera's pixels lie on the road</h1>Each mark is a point in the picture whose place on "
            "the road is known. The more they agree, and the farther apart they lie, the better vehicles are placed.",
        )
        left = column(self.picture, row(shown), self.status, self.above, width=WIDTH + 95)
        tables = column(worst_table(self.worst), mark_table(self.marks), row(*self.fields.values()))
        right = column(row(model, *buttons), self.saved, self.advice, tables)
        return column(head, row(left, right), stylesheets=[style_sheet()])

    def show_layers(self, active: list[int]) -> None:
        """Show the layers of these numbers."""
        *layers, bar = self.layers
        for index, layer in enumerate(layers):
            layer.visible = index in active
        bar.visible = LAYERS.index("error map") in active

    def select_worst(self, chosen: list[int]) -> None:
        """Select the mark that was chosen in the table of the largest errors."""
        if chosen:
            name = self.worst.data["name"][chosen[0]]
            self.marks.selected.indices = [i for i, mark in enumerate(self.session.marks) if mark.name == name][:1]

    def choose(self, model: str) -> None:
        """Fit with another model."""
        self.session.model = next(name for name in MODELS if name == model)
        self.show()

    def undo(self) -> None:
        """Go one step back."""
        if self.session.undo():
            self.show()

    def redo(self) -> None:
        """Go one step forward."""
        if self.session.redo():
            self.show()

    def delete(self) -> None:
        """Delete the selected marks."""
        chosen = set(self.marks.selected.indices)
        self.marks.selected.indices = []
        if self.session.change(tuple(m for index, m in enumerate(self.session.marks) if index not in chosen)):
            self.show()

    def save(self) -> None:
        """Write the calibration and the points."""
        try:
            written = ", ".join(str(path) for path in self.session.save(self.out))
            self.saved.text = f"saved {html.escape(written)}"
        except (InputError, OSError) as error:
            self.saved.text = f"<b style='color:#c00'>not saved: {html.escape(str(error))}</b>"

    def edited(self) -> None:
        """Take over what was dragged or typed, once the hand rests."""
        if self.writing or self.waiting:
            return
        self.waiting = True
        self.document.add_timeout_callback(self._take_over, WAIT)

    def _take_over(self) -> None:
        self.waiting = False
        marks = read_marks(dict(self.marks.data))
        grown = len(marks) > len(self.session.marks)
        if self.session.change(marks):
            self.saved.text = ""
            self.show()
        if grown:
            self.marks.selected.indices = [len(marks) - 1]

    def fill_fields(self) -> None:
        """Show the selected mark in the inputs; empty ones where none or several are selected."""
        mark = self._selected()
        self.writing = True
        for name, box in self.fields.items():
            value = "" if mark is None else getattr(mark, name)
            box.value = value if isinstance(value, str) else "" if np.isnan(value) else f"{value:.10g}"
            box.disabled = mark is None
        self.writing = False
        there = [mark] if mark is not None else []
        self.chosen.data = {"px": [m.px for m in there], "py": [m.py for m in there], "name": [m.name for m in there]}

    def _selected(self) -> Mark | None:
        chosen = [index for index in self.marks.selected.indices if index < len(self.session.marks)]
        return self.session.marks[chosen[0]] if len(chosen) == 1 else None

    def typed(self) -> None:
        """Take over what was typed for the selected mark."""
        mark = self._selected()
        if self.writing or mark is None:
            return
        try:
            texts = {name: box.value for name, box in self.fields.items()}
            changed = typed_mark(mark, with_place(texts, self.session.frame))
        except ValueError as error:
            self.saved.text = f"<b style='color:#c00'>{html.escape(str(error))}</b>"
            return
        if self.session.change(tuple(changed if other is mark else other for other in self.session.marks)):
            self.saved.text = ""
            self.show()

    def show(self) -> None:
        """Fit, and put everything that follows from the marks on the page."""
        fit, message = None, ""
        try:
            fit = self.session.fit()
        except InputError as error:
            message = f"<b style='color:#c00'>{html.escape(str(error))}</b>"
        self.writing = True
        self.marks.data = table_data(self.session.marks, fit)
        self.writing = False
        self.status.text = describe(fit) if fit else message
        rows = odd_marks(fit) if fit else []
        columns = {"name": 0, "off": 1, "expected": 2}
        self.worst.data = {name: [one[at] for one in rows] for name, at in columns.items()} | {
            "times": [off / expected for _, off, expected in rows]
        }
        lines = advice_lines(fit) if fit else ["Set marks until the fit begins: four at least, not in one line."]
        self.advice.text = "<b>What to do next</b><br>" + "<br>".join(map(html.escape, lines))
        self.fill_fields()
        self._draw(fit)

    def _draw(self, fit: GroundFit | None) -> None:
        if fit is None:
            self.lines.data, self.residuals.data, self.errors.data = dict(NO_LINES), dict(NO_LINES), dict(NO_IMAGE)
            self.above_image.data, self.above_ellipses.data = dict(NO_IMAGE), dict(NO_LINES)
            self.above_points.data = dict(NO_POINTS)
            return
        points, view = self.session.points(), fit.calibration
        width, height = view.image_size
        xs, ys = grid_in_picture(view, points.ground)
        self.lines.data = {"xs": xs, "ys": ys}
        ends = points.pixels + MAGNIFY * (view.to_image(points.ground) - points.pixels)
        pairs = np.stack([points.pixels, ends], axis=1)
        self.residuals.data = {"xs": list(pairs[:, :, 0]), "ys": list(pairs[:, :, 1])}
        self.errors.data = {"image": [sigma_image(view)], "x": [0], "y": [0], "dw": [width], "dh": [height]}
        low, high = area(view)
        seen = from_above(self.image, view, low, high)
        self.above_image.data = {
            "image": [seen], "x": [low[0]], "y": [low[1]], "dw": [high[0] - low[0]], "dh": [high[1] - low[1]]
        }  # fmt: skip
        xs, ys = ellipses(view, points.pixels, points.sigma)
        self.above_ellipses.data = {"xs": xs, "ys": ys}
        self.above_points.data = {"x": points.ground[:, 0], "y": points.ground[:, 1], "name": list(points.names)}
        self.above.x_range.update(start=float(low[0]), end=float(high[0]))
        self.above.y_range.update(start=float(high[1]), end=float(low[1]))


def serve(session: Session, image: Image, out: Path, port: int, browser: bool) -> None:
    """Serve the page on this machine until it is interrupted; scripts and styles come from here, not from the web."""
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    def open_page(document: Document) -> None:
        Page(document, session, image, out)

    try:
        server = Server({"/": Application(FunctionHandler(open_page))}, port=port, address="127.0.0.1")
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror}; give another, or 0 for any") from error
    server.start()
    print(f"calibration page: http://localhost:{server.port}/  (Ctrl-C ends it)", flush=True)
    if browser:
        server.io_loop.add_callback(server.show, "/")
    try:
        server.io_loop.start()
    except KeyboardInterrupt:
        print("ended")
