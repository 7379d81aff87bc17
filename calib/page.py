"""The calibration page: drag marks on a frame, type their places, see the errors at once. Bokeh, served locally."""

import html
import secrets
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    CheckboxGroup,
    Div,
    InlineStyleSheet,
    Select,
    TextInput,
)
from numpy.typing import NDArray

from calib.ground import MODELS
from calib.page_figures import BESIDE, NO_LABELS, WIDTH, Figures
from calib.page_text import (
    FIELDS,
    HEAD,
    STYLE,
    describe,
    listed,
    read_marks,
    table_data,
    typed_mark,
    with_place,
    wrong,
)
from calib.session import Mark, Session
from vision.contract import InputError

Image = NDArray[np.uint8]
LAYERS = ("ground grid", "residuals x20", "error map")
WAIT = 80  # ms over which changes are gathered before a fit
TOKEN = 24  # bytes of the part of the address that is drawn at random


class Page:
    """The Bokeh models of one open page, kept in sync with its session."""

    def __init__(self, document: Document, session: Session, image: Image, out: Path):
        self.document, self.session, self.out = document, session, out
        self.waiting, self.writing = False, False
        self.figures = Figures(image, session.image_size)
        self.marks, self.table = self.figures.marks, self.figures.table
        style = InlineStyleSheet(css=STYLE)
        self.head = Div(text=HEAD, width=WIDTH + BESIDE, stylesheets=[style])
        self.status = Div(name="status", width=WIDTH, stylesheets=[style])
        self.saved = Div(name="saved", width=220, stylesheets=[style])
        self.fields = self._fields()
        document.title = "roadfiber calibrate"
        document.add_root(self._layout())
        self.marks.selected.on_change("indices", lambda _attr, _old, _new: self.fill_fields())
        self.table.selected.on_change("indices", lambda _attr, _old, new: self.pick(new))
        self.marks.on_change("data", lambda _attr, _old, _new: self.edited())
        self.show()

    def _fields(self) -> dict[str, Any]:
        """Inputs for the selected mark."""
        fields = {}
        for name, title in FIELDS.items():
            fields[name] = TextInput(
                title=title, width=120 if name == "name" else 68, name=f"field_{name}", disabled=True
            )
            fields[name].on_change("value", lambda _attr, _old, new, name=name: self.typed(name, new))
        return fields

    def _layout(self) -> Any:
        table = self.figures.rows()
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
            button = Button(label=label, width=110, button_type="primary" if label == "Save" else "default",
                            name=label.split()[0].lower())  # fmt: skip
            button.on_click(action)
            buttons.append(button)
        left = column(self.figures.picture, row(shown), self.status)
        fields = list(self.fields.values())
        right = column(
            row(model, *buttons[:2]),
            row(*buttons[2:], self.saved),
            table,
            row(*fields[:3]),
            row(*fields[3:]),
            self.figures.above,
        )
        return column(self.head, row(left, right))

    def show_layers(self, active: list[int]) -> None:
        """Show the layers with these indices."""
        for index, layer in enumerate(self.figures.layers):
            layer.visible = index in active

    def choose(self, model: str) -> None:
        """Fit with another model."""
        self.take_over()
        self.session.model = next(name for name in MODELS if name == model)
        self.show()

    def undo(self) -> None:
        """Go one step back."""
        self.take_over()
        if self.session.undo():
            self.show()

    def redo(self) -> None:
        """Go one step forward."""
        self.take_over()
        if self.session.redo():
            self.show()

    def delete(self) -> None:
        """Delete the selected marks."""
        self.take_over()
        chosen = set(self.marks.selected.indices)
        self.marks.selected.indices = []
        if self.session.change(tuple(m for index, m in enumerate(self.session.marks) if index not in chosen)):
            self.show()

    def save(self) -> None:
        """Write the calibration and the points."""
        self.take_over()
        try:
            written = ", ".join(str(path) for path in self.session.save(self.out))
            self.saved.text = (
                f"saved {html.escape(written)}; name it as <code>calibration</code> in [camera] of site.toml"
            )
        except (InputError, OSError) as error:
            self.saved.text = wrong(f"not saved: {error}")

    def edited(self) -> None:
        """Apply what was dragged or added, after a pause in the input."""
        if self.writing or self.waiting:
            return
        self.waiting = True
        self.document.add_timeout_callback(self.take_over, WAIT)

    def take_over(self) -> None:
        """Apply now what was dragged or added, before anything else is done to the marks."""
        if not self.waiting:
            return
        self.waiting = False
        marks = read_marks(dict(self.marks.data))
        grown = len(marks) > len(self.session.marks)
        if self.session.change(marks):
            self.saved.text = ""
            self.show()
        if grown:
            self.marks.selected.indices = [len(marks) - 1]

    def pick(self, rows: list[int]) -> None:
        """Rows of the table were selected: select their marks."""
        if not self.writing:
            self.marks.selected.indices = [self.table.data["at"][at] for at in rows]

    def fill_fields(self) -> None:
        """Show the selected mark in the inputs; empty ones where none or several are selected."""
        mark, chosen = self._selected(), set(self.marks.selected.indices)
        self.writing = True
        self.table.selected.indices = [row for row, at in enumerate(self.table.data["at"]) if at in chosen]
        marks = [one for at, one in enumerate(self.session.marks) if at in chosen]
        self.figures.labels.data = {name: [getattr(one, name) for one in marks] for name in NO_LABELS}
        for name, box in self.fields.items():
            value = "" if mark is None else getattr(mark, name)
            box.value = value if isinstance(value, str) else "" if np.isnan(value) else f"{value:.10g}"
            box.disabled = mark is None
        self.writing = False

    def _selected(self) -> Mark | None:
        chosen = [index for index in self.marks.selected.indices if index < len(self.session.marks)]
        return self.session.marks[chosen[0]] if len(chosen) == 1 else None

    def typed(self, name: str, text: str) -> None:
        """Apply what was typed into a field for the selected mark."""
        if self.writing:
            return
        self.take_over()
        if (mark := self._selected()) is None:
            return
        try:
            texts = {field: box.value for field, box in self.fields.items()} | {name: text}
            changed = typed_mark(mark, with_place(texts, self.session.frame))
        except ValueError as error:
            self.saved.text = wrong(error)
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
            message = wrong(error)
        self.writing = True
        # With the index of a mark that is no more, Bokeh drags a row into some columns only.
        count = len(self.session.marks)
        self.marks.selected.indices = [at for at in self.marks.selected.indices if at < count]
        self.marks.data = table_data(self.session.marks, fit)
        self.table.data = listed(dict(self.marks.data))
        self.writing = False
        self.status.text = describe(fit) if fit else message
        self.fill_fields()
        self.figures.draw(self.session.points() if fit else None, fit)


def serve(session: Session, image: Image, out: Path, port: int, browser: bool) -> None:
    """Serve the page on this machine until it is interrupted; scripts and styles come from here, not from the web.

    It has an address that nobody can guess, and Bokeh takes a websocket from `localhost` and its port alone: neither a
    page of another origin nor another user of this machine can drive it.
    """
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    def open_page(document: Document) -> None:
        Page(document, session, image, out)

    page = f"/{secrets.token_urlsafe(TOKEN)}"
    try:
        # Without an index, which would tell the address.
        server = Server(
            {page: Application(FunctionHandler(open_page))}, port=port, address="127.0.0.1", use_index=False
        )
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror}; give another, or 0 for any") from error
    server.start()
    print(f"calibration page: http://localhost:{server.port}{page}  (Ctrl-C ends it)", flush=True)
    if browser:
        server.io_loop.add_callback(server.show, page)
    try:
        server.io_loop.start()
    except KeyboardInterrupt:
        print("ended")
