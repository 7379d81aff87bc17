"""The calibration page: drag marks on a frame, type their places, see the errors at once. Bokeh, served locally."""

import html
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    CheckboxGroup,
    ColorBar,
    ColumnDataSource,
    DataTable,
    Div,
    LogColorMapper,
    NumberFormatter,
    PointDrawTool,
    Range1d,
    Select,
    StringFormatter,
    TableColumn,
    TextInput,
)
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from calib.ground import MODELS, GroundFit
from calib.layers import ellipses, from_above, grid_in_picture, rgba
from calib.maps import LEVELS, area, sigma_image
from calib.page_text import EDITED, FIELDS, FOUND, describe, read_marks, table_data, typed_mark, with_place
from calib.session import Mark, Session
from vision.contract import InputError

Image = NDArray[np.uint8]
NO_LINES: dict[str, list[Any]] = {"xs": [], "ys": []}
NO_IMAGE: dict[str, list[Any]] = {"image": [], "x": [], "y": [], "dw": [], "dh": []}
NO_POINTS: dict[str, list[Any]] = {"x": [], "y": [], "name": []}
LAYERS = ("ground grid", "residuals x20", "error map")
PIXELS = ("px", "py", "residual_px", "sigma")
WAIT = 80  # ms over which changes are gathered before a fit
MAGNIFY = 20.0
WIDTH = 700  # of the frame on the page


class Page:
    """The Bokeh models of one open page, kept in sync with its session."""

    def __init__(self, document: Document, session: Session, image: Image, out: Path):
        self.document, self.session, self.image, self.out = document, session, image, out
        self.waiting, self.writing = False, False
        self.marks = ColumnDataSource({name: [] for name in (*EDITED, *FOUND)}, name="marks")
        self.lines = ColumnDataSource(dict(NO_LINES))
        self.residuals = ColumnDataSource(dict(NO_LINES))
        self.errors = ColumnDataSource(dict(NO_IMAGE))
        self.above_image = ColumnDataSource(dict(NO_IMAGE))
        self.above_ellipses = ColumnDataSource(dict(NO_LINES))
        self.above_points = ColumnDataSource(dict(NO_POINTS), name="above_points")
        self.status = Div(name="status", width=WIDTH, styles={"font-size": "13px"})
        self.saved = Div(name="saved", styles={"font-size": "13px"})
        self.fields = self._fields()
        self.picture, self.layers = self._picture()
        self.above = self._above()
        document.title = "roadfiber calibrate"
        document.add_root(self._layout())
        self.marks.selected.on_change("indices", lambda _attr, _old, _new: self.fill_fields())
        self.marks.on_change("data", lambda _attr, _old, _new: self.edited())
        self.show()

    def _picture(self) -> tuple[Any, list[Any]]:
        width, height = self.session.image_size
        plot = figure(
            name="picture", frame_width=WIDTH, frame_height=round(WIDTH * height / width), x_range=Range1d(0, width),
            y_range=Range1d(height, 0), tools="pan,wheel_zoom,reset", active_scroll="wheel_zoom",
            title="drag marks; click to add one; click one to select it and type its place",
        )  # fmt: skip
        plot.image_rgba([rgba(self.image)], x=0, y=0, dw=width, dh=height)
        colors = LogColorMapper(palette=Viridis256[::-1], low=LEVELS[0], high=LEVELS[-1], nan_color="rgba(0,0,0,0)")
        errors = plot.image("image", source=self.errors, x="x", y="y", dw="dw", dh="dh", color_mapper=colors, alpha=0.5)
        bar = ColorBar(color_mapper=colors, title="1 sigma, m", width=8)
        plot.add_layout(bar, "right")
        grid = plot.multi_line("xs", "ys", source=self.lines, color="#6ec8ff", line_width=1)
        residuals = plot.multi_line("xs", "ys", source=self.residuals, color="#ffe600", line_width=2)
        points = plot.scatter("px", "py", source=self.marks, size=11, fill_alpha=0.25, color="color", line_width=2,
                              selection_line_color="white", selection_fill_alpha=0.6)  # fmt: skip
        names = plot.text("px", "py", "name", source=self.marks, x_offset=8, y_offset=-4, text_color="color",
                          text_font_size="11px", background_fill_color="black", background_fill_alpha=0.35)  # fmt: skip
        points.nonselection_glyph = names.nonselection_glyph = None  # the same as unselected: not faded
        draw = PointDrawTool(renderers=[points])
        plot.add_tools(draw)
        plot.toolbar.active_tap = draw
        errors.visible = False
        return plot, [grid, residuals, errors]

    def _fields(self) -> dict[str, Any]:
        """Inputs for the selected mark."""
        fields = {}
        for name, title in FIELDS.items():
            fields[name] = TextInput(
                title=title, width=120 if name == "name" else 68, name=f"field_{name}", disabled=True
            )
            fields[name].on_change("value", lambda _attr, _old, _new: self.typed())
        return fields

    def _above(self) -> Any:
        plot = figure(
            name="above", width=600, height=430, x_range=Range1d(0, 1), y_range=Range1d(1, 0),
            tools="pan,wheel_zoom,reset", title="from above: typed places (+), 2 sigma around where their pixels are",
            x_axis_label="x, m", y_axis_label="y, m (right of +x)",
        )  # fmt: skip
        plot.image_rgba("image", source=self.above_image, x="x", y="y", dw="dw", dh="dh")
        plot.patches("xs", "ys", source=self.above_ellipses, fill_alpha=0.15, color="#ffe600")
        plot.scatter("x", "y", source=self.above_points, marker="cross", size=12, color="#ff40ff", line_width=2)
        plot.text("x", "y", "name", source=self.above_points, x_offset=6, y_offset=-4, text_color="#ff40ff",
                  text_font_size="10px")  # fmt: skip
        return plot

    def _layout(self) -> Any:
        number, text = NumberFormatter(format="0.000", nan_format="-"), StringFormatter()
        pixels = NumberFormatter(format="0.0", nan_format="-")
        titles = {"name": "name", "px": "px", "py": "py", "x": "x, m", "y": "y, m", "sigma": "sigma, px",
                  "sigma_xy": "sigma, m", "residual_px": "off, px", "residual_m": "off, m",
                  "leave_one_out_m": "held out, m"}  # fmt: skip
        columns = [
            TableColumn(
                field=name,
                title=title,
                formatter=text if name == "name" else pixels if name in PIXELS else number,
                width=88 if name == "name" else 56,
            )
            for name, title in titles.items()
        ]
        table = DataTable(source=self.marks, columns=columns, width=600, height=260, index_position=None,
                          sortable=False, reorderable=False, name="table", autosize_mode="none")  # fmt: skip
        model = Select(title="model", value=self.session.model, options=list(MODELS), width=120, name="model")
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
            button = Button(label=label, width=110, button_type="success" if label == "Save" else "default",
                            name=label.split()[0].lower())  # fmt: skip
            button.on_click(action)
            buttons.append(button)
        left = column(self.picture, row(shown), self.status)
        fields = row(*self.fields.values())
        right = column(row(model, *buttons[:2]), row(*buttons[2:], self.saved), table, fields, self.above)
        return row(left, right)

    def show_layers(self, active: list[int]) -> None:
        """Show the layers with these indices."""
        for index, layer in enumerate(self.layers):
            layer.visible = index in active

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
        """Apply what was dragged or typed, after a pause in the input."""
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

    def _selected(self) -> Mark | None:
        chosen = [index for index in self.marks.selected.indices if index < len(self.session.marks)]
        return self.session.marks[chosen[0]] if len(chosen) == 1 else None

    def typed(self) -> None:
        """Apply what was typed for the selected mark."""
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
        """Fit, and update everything on the page that depends on the marks."""
        fit, message = None, ""
        try:
            fit = self.session.fit()
        except InputError as error:
            message = f"<b style='color:#c00'>{html.escape(str(error))}</b>"
        self.writing = True
        self.marks.data = table_data(self.session.marks, fit)
        self.writing = False
        self.status.text = describe(fit) if fit else message
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
