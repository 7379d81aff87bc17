"""The start of a survey in the browser: name its files, have them checked, and write site.toml."""

from html import escape
from pathlib import Path
from typing import Any

import panel as pn
from bokeh.models import ColumnDataSource, DatetimeTickFormatter, FactorRange, HoverTool
from bokeh.plotting import figure

from roadfiber.web.controls import WIDE, html
from roadfiber.web.figures import North, plain, scale_bar, table
from roadfiber.web.site_checks import SIGNS, Checked
from roadfiber.web.site_draft import FIELDS, Draft, found_in
from roadfiber.web.worker import Worker
from vision.contract import InputError, require_writable, writing
from vision.contract.palette import FORWARD, ROUTE
from vision.contract.statements import table_html

SITE = "site.toml"
#: Fields: what they are called, and an example.
LABELS = {
    "name": ("Name of the survey", "Elm Street"),
    "origin": ("Origin: latitude, longitude of x = y = 0", "32.113, 34.804"),
    "azimuth": ("Azimuth of +x, degrees clockwise from north", "78.0"),
    "das": ("DAS files, by name or pattern", "das/*.h5"),
    "gauge_length": ("Gauge length, m, where the files do not say it", "10.0"),
    "channel_spacing": ("Channel spacing, m, where the files do not say it", "1.02"),
    "quantity": ("Quantity, where the files do not say it", "strain_rate"),
    "tracks": ("Trajectories or GPS (else the video is tracked)", "trajectories.csv"),
    "video": ("Video", "street.mp4"),
    "calibration": ("Its calibration", "calibration.json"),
    "start": ("Start of the video, with its zone", "2025-08-11T06:00:00Z"),
    "anchors": ("Known points of the fiber, if there are any", "anchors.csv"),
}
COLORS = {"good": "#0072b2", "look": "#e69f00", "failed": "#d55e00"}


class StartPage:
    """One browser's page of a survey's start.

    Parameters
    ----------
    folder : where site.toml goes; names are relative to it
    worker : that checks
    """

    def __init__(self, folder: Path, worker: Worker):
        self.folder, self.worker = folder, worker
        self.document: Any = pn.state.curdoc
        self.checked: tuple[Draft, Checked] | None = None
        draft = found_in(folder)
        self.kept = draft.kept
        self.box: dict[str, Any] = {
            name: pn.widgets.TextInput(label=label, placeholder=example, value=getattr(draft, name), **WIDE)
            for name, (label, example) in LABELS.items()
        }
        for box in self.box.values():
            box.param.watch(lambda event: self.able(), "value")
        self.check_button: Any = pn.widgets.Button(label="Check", color="primary")
        self.write_button: Any = pn.widgets.Button(label=f"Write {SITE}", disabled=True)
        self.replace: Any = pn.widgets.Checkbox(label=f"replace the {SITE} that is there", value=False)
        self.replace.visible = (folder / SITE).exists()
        self.check_button.on_click(lambda event: self.check())
        self.write_button.on_click(lambda event: self.write())
        self.said, self.list, self.text = html(), html(), html()
        self.figures()
        self.said.object = "<small>Fill in what you have, and press Check. Nothing is written before.</small>"

    def figures(self) -> None:
        """Make the map and the picture of times."""
        self.tracks = ColumnDataSource(table(xs=[], ys=[], name=[]))
        self.anchors = ColumnDataSource(table(x=[], y=[], name=[]))
        self.map = plain(
            figure(name="map", height=260, match_aspect=True, tools="pan,wheel_zoom,reset", title="From above",
                   x_axis_label="x along the road, m", y_axis_label="y, m", toolbar_location="right", **WIDE)
        )  # fmt: skip
        self.map.y_range.flipped = True
        lines = self.map.multi_line("xs", "ys", source=self.tracks, color=FORWARD)
        marks = self.map.scatter("x", "y", source=self.anchors, marker="square", size=9, color=ROUTE, fill_alpha=0)
        self.map.add_tools(
            HoverTool(renderers=[lines], tooltips=[("vehicle", "@name")]),
            HoverTool(renderers=[marks], tooltips=[("anchor", "@name")]),
        )
        self.map.add_layout(scale_bar(self.map))
        self.north = North(self.map)
        self.spans = ColumnDataSource(table(what=[], first=[], last=[]))
        self.times = plain(
            figure(name="times", height=150, tools="", y_range=FactorRange(), x_axis_type="datetime",
                   title="When each was recorded, UTC", toolbar_location=None, **WIDE)
        )  # fmt: skip
        self.times.hbar("what", left="first", right="last", height=0.5, source=self.spans, color=FORWARD, alpha=0.7)
        self.times.xaxis.formatter = DatetimeTickFormatter(seconds="%H:%M:%S", minsec="%H:%M:%S", minutes="%H:%M:%S")
        self.map.visible = self.times.visible = False

    def view(self) -> Any:
        """All that is on the page."""
        head = html()
        head.object = (
            f"<h1>A new survey in {escape(self.folder.name)}</h1><p>Names are relative to "
            f"<code>{escape(str(self.folder))}</code>. x runs along the road, y to the right of +x, z down; meters.</p>"
        )
        groups = (
            ("Place", ("name", "origin", "azimuth")),
            ("DAS record", ("das", "gauge_length", "channel_spacing", "quantity")),
            ("Vehicles: trajectories, or a video", ("tracks", "video", "calibration", "start")),
            ("Known points", ("anchors",)),
        )
        fields: list[Any] = []
        for title, names in groups:
            above = html()
            above.object = f"<h2>{title}</h2>"
            fields += [above, *(self.box[name] for name in names)]
        left = pn.Column(*fields, width=420)
        right = pn.Column(
            pn.Row(self.check_button, self.write_button), self.replace, self.said, self.list,
            pn.pane.Bokeh(self.times, **WIDE), pn.pane.Bokeh(self.map, **WIDE), self.text, **WIDE,
        )  # fmt: skip
        return pn.Column(head, pn.Row(left, right, **WIDE), min_width=820, **WIDE)

    @property
    def draft(self) -> Draft:
        """What stands in the fields."""
        return Draft(**{name: self.box[name].value.strip() for name in FIELDS}, kept=self.kept)

    def able(self) -> None:
        """What was checked may be written, as long as it is not changed."""
        self.write_button.disabled = not (
            self.checked is not None and self.checked[0] == self.draft and self.checked[1].able
        )

    def later(self, called: Any) -> None:
        """Have something done on the page, from any thread."""
        if self.document is None:
            called()
        else:
            self.document.add_next_tick_callback(called)

    def check(self) -> None:
        """Have the survey checked, in the background."""
        draft = self.draft
        self.check_button.disabled, self.write_button.disabled = True, True
        self.said.object = "Checking: fields ..."

        def done(found: Checked) -> None:
            self.later(lambda: self.show(draft, found))

        def told(step: tuple[str, str]) -> None:
            self.later(lambda: setattr(self.said, "object", f"Checking: {escape(step[1]).lower()} ..."))

        def failed(line: str) -> None:
            self.later(lambda: self.end(f"<b>Not checked:</b> {escape(line)}"))

        self.worker.ask("check_site", self.folder, draft, then=done, told=told, failed=failed)

    def end(self, line: str) -> None:
        """Say how it ended."""
        self.said.object, self.check_button.disabled = line, False
        self.able()

    def show(self, draft: Draft, found: Checked) -> None:
        """Show what was found."""
        self.checked = draft, found
        self.list.object = "".join(
            f"<p style='border-left:4px solid {COLORS[one.verdict]};padding-left:8px'><b>{SIGNS[one.verdict]}</b> · "
            f"<b>{escape(one.what)}</b>: {escape(one.words)}</p>"
            for one in found.checks
        )
        self.list.object += table_html(found.statements)
        self.draw(found)
        if found.able:
            self.text.object = f"<h2>{SITE}</h2><pre>{escape(draft.text())}</pre>"
        failed = sum(one.verdict == "failed" for one in found.checks)
        self.end(
            f"<span id='said'>{failed} of {len(found.checks)} checks failed; mend that, and check again.</span>"
            if failed
            else f"<span id='said'>Nothing failed: {SITE} may be written.</span>"
        )

    def draw(self, found: Checked) -> None:
        """Draw times and places."""
        names = list(found.spans)[::-1]
        self.times.y_range.factors = names
        ends = [found.spans[name] for name in names]
        self.spans.data = table(what=names, first=[one[0] for one in ends], last=[one[1] for one in ends])
        tracks = found.tracks
        self.tracks.data = table(
            xs=[x for x, _ in tracks.values()], ys=[y for _, y in tracks.values()], name=list(tracks)
        )
        anchors = found.anchors
        self.anchors.data = table(
            name=[name for name, *_ in anchors], x=[x for _, x, _ in anchors], y=[y for *_, y in anchors]
        )
        self.north.point(found.azimuth)
        self.times.visible, self.map.visible = bool(names), bool(tracks or found.anchors)

    def write(self) -> None:
        """Write site.toml, whole or not at all; one that is there only where that is wanted."""
        path = self.folder / SITE
        if path.exists() and not self.replace.value:
            self.replace.visible = True
            self.said.object = f"<span id='said'>There is a {SITE} already: tick the box to replace it.</span>"
            return
        try:
            require_writable(path)
            with writing(path) as temporary:
                temporary.write_text(self.draft.text(), encoding="utf-8")
        except InputError as error:
            self.said.object = f"<span id='said'>Not written: {escape(str(error))}</span>"
            return
        self.said.object = (
            f"<span id='said'>Written: {escape(str(path))}</span><p>Next: <code>roadfiber locate "
            f"{escape(str(path))} --out {escape(str(self.folder / 'run'))}</code></p>"
        )


def serve_start(folder: Path, port: int, browser: bool) -> None:
    """Serve the start of a survey on this machine until Ctrl-C ends it.

    Raises
    ------
    InputError
        If there is no such folder.
    """
    from roadfiber.web.server import serve

    folder = folder.resolve()
    if not folder.is_dir():
        raise InputError(f"{folder}: no folder; give the one that holds the survey's files")
    pn.extension()
    worker = Worker("the worker that checks")
    try:
        serve(
            lambda: StartPage(folder, worker).view(), "new survey", port=port, browser=browser, title="roadfiber: start"
        )
    finally:
        worker.stop()
