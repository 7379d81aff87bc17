"""Where on the page of the workbench each thing stands."""

from typing import Any

import panel as pn

from roadfiber.web.controls import WIDE
from roadfiber.web.tiles import Beneath
from roadfiber.web.words import STYLE
from roadfiber.web.workbench_page import Page
from solver.run.report import glossary

#: px, width of the column of controls, and of the video.
LEFT, VIDEO = 390, 340


def laid_out(page: Page, ground: Beneath | None = None) -> Any:
    """All that is on a page, on a picture of the ground where there is one."""
    if ground is not None:
        page.map.beneath(ground)
    controls, button = page.controls, page.controls.button

    def drawn(one: Any) -> Any:
        return pn.pane.Bokeh(one.plot, **WIDE)

    mine = controls.file, controls.code, button["check"], controls.checked
    own = pn.Card(*mine, title="An effect of your own", collapsed=True, **WIDE)
    terms = pn.Card(pn.pane.HTML(glossary.terms(), stylesheets=[STYLE], **WIDE), title="Terms", collapsed=True, **WIDE)
    left = pn.Column(
        controls.passes, controls.regions, controls.where, controls.effects, controls.about, controls.size,
        controls.follow, controls.expected, pn.Row(button["add"], button["undo"], button["redo"]), controls.force,
        pn.Row(button["diagnose"], button["cancel"]), controls.work, page.live.place, controls.steps,
        page.ladder.place, pn.Row(*controls.exports), terms, own, width=LEFT,
    )  # fmt: skip
    right = pn.Column(
        drawn(page.map),
        pn.Row(*(pn.pane.Bokeh(plot, **WIDE) for plot in page.maps.plots), **WIDE),
        drawn(page.depth),
        pn.Row(controls.channel, button["turn"], controls.second, **WIDE),
        pn.Row(drawn(page.traces), pn.Column(controls.picture, width=VIDEO), **WIDE),
        page.by_channel.place,
        pn.Row(page.stack.place, pn.Column(controls.by, page.by_property.place, **WIDE), **WIDE),
        **WIDE,
    )
    return pn.Column(controls.heading, controls.said, pn.Row(left, right, **WIDE), min_width=900, **WIDE)
