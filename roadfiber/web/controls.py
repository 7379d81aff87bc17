"""What can be chosen, moved and pressed on the workbench; every control has a label and is reached by the keyboard."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn

from roadfiber.web import own_effect, words
from roadfiber.web.breakdown import PROPERTIES

WIDE: dict[str, Any] = {"sizing_mode": "stretch_width"}
#: Of lists, whose lines are as long as they are.
LISTED: dict[str, Any] = WIDE | {"stylesheets": ["option { white-space: normal; }"]}
#: Buttons: name in the code, and what is written on it.
BUTTONS = {
    "add": "Add to the model",
    "turn": "The fiber turns here",
    "undo": "Undo",
    "redo": "Redo",
    "diagnose": "Diagnose",
    "cancel": "Cancel",
    "check": "Check and score it",
}
EXPORTED = ("route.geojson", "route.csv")


def html() -> Any:
    """A pane of words."""
    return pn.pane.HTML("", stylesheets=[words.STYLE], sizing_mode="stretch_width", margin=(0, 8))


class Controls:
    """The widgets of one page, and its panes of words.

    Parameters
    ----------
    folder : gives the run folder whose files are exported
    """

    def __init__(self, folder: Callable[[], Path]):
        self.writing = False
        self.heading, self.said, self.where, self.about, self.expected, self.work = (html() for _ in range(6))
        self.steps, self.checked = html(), html()
        self.where.object = words.LOOKING
        self.picture: Any = pn.pane.HTML("", min_height=40, **WIDE)
        self.passes: Any = pn.widgets.Select(label="Pass", **WIDE)
        self.regions: Any = pn.widgets.MultiSelect(label="Where the model fails", size=6, options={}, **LISTED)
        self.effects: Any = pn.widgets.MultiSelect(label="What may be missing", size=9, options={}, **LISTED)
        self.size: Any = pn.widgets.FloatSlider(label="Size", start=0.0, end=1.0, step=0.01, disabled=True, **WIDE)
        self.follow: Any = pn.widgets.Checkbox(label="let route, vehicles and ground follow", value=True)
        self.force: Any = pn.widgets.Checkbox(label="keep it even if held-out passes fit no better", value=False)
        self.channel: Any = pn.widgets.IntSlider(label="Channel", **WIDE)
        self.second: Any = pn.widgets.FloatSlider(label="Second of the pass", step=0.05, **WIDE)
        self.by: Any = pn.widgets.Select(label="Residual by", options=list(PROPERTIES), **WIDE)
        self.file: Any = pn.widgets.TextInput(label="File, kept beside the run", value=own_effect.NAME, **WIDE)
        code = "textarea { font: 12px/1.4 ui-monospace, monospace; white-space: pre; }"
        self.code: Any = pn.widgets.TextAreaInput(
            label="Python", value=own_effect.TEMPLATE, rows=12, max_length=2**20, stylesheets=[code], **WIDE
        )
        self.button: dict[str, Any] = {
            name: pn.widgets.Button(label=label, color="primary" if name == "add" else "default", min_width=70)
            for name, label in BUTTONS.items()
        }
        self.exports: list[Any] = [
            pn.widgets.FileDownload(
                callback=lambda name=name: folder() / name,
                filename=name,
                embed=False,
                label=f"Export {name}",
                color="default",
                **WIDE,
            )
            for name in EXPORTED
        ]

    def set(self, widget: Any, **values: Any) -> None:
        """Change a widget without hearing of it."""
        self.writing = True
        try:
            widget.param.update(**values)
        finally:
            self.writing = False

    def heard(self, widget: Any, called: Callable[[], Any]) -> None:
        """Have a function called when somebody changes a widget."""
        widget.param.watch(lambda event: None if self.writing else called(), "value")

    def pressed(self, name: str, called: Callable[[], Any]) -> None:
        """Have a function called when a button is pressed."""
        self.button[name].on_click(lambda event: called())

    def able(self, can: dict[str, bool]) -> None:
        """Which buttons can be pressed."""
        for name, able in can.items():
            self.button[name].disabled = not able
