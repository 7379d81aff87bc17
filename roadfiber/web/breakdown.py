"""Where the residual is: as the vehicles carry it along, and by channel, pass, speed, class, lane and distance."""

from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models import ColumnDataSource, FactorRange, HoverTool, Range1d, Span
from bokeh.plotting import figure

from roadfiber.web.figures import INK, MUTED, WIDE, plain, table
from vision.contract.palette import ROUTE

if TYPE_CHECKING:
    from solver.criticism.comparison.comparison import Comparison

#: What the bars may be of: in words, and the name of that part of `solver.criticism.comparison.power.Power`.
PROPERTIES = {
    "pass": "one_pass",
    "speed": "speed",
    "class": "vehicle_class",
    "lane": "lane",
    "distance from the vehicle": "gap",
}
#: Bars at most; those above the rest.
MOST = 20


class VehicleFrame:
    """What is left at each distance ahead of the vehicles, averaged over them, with two sigmas of noise."""

    def __init__(self) -> None:
        self.source = ColumnDataSource(table(ahead=[], measured=[], model=[], residual=[], low=[], high=[]))
        self.plot = plain(
            figure(name="vehicle frame", height=210, tools="pan,wheel_zoom,reset", title="In the vehicle's frame",
                   x_axis_label="m ahead of the vehicle", y_axis_label="of the model's peak", **WIDE)
        )  # fmt: skip
        self.plot.varea("ahead", "low", "high", source=self.source, fill_color=MUTED, fill_alpha=0.25)
        self.plot.line(
            "ahead", "model", source=self.source, color=INK, alpha=0.5, line_dash=[5, 3], legend_label="model"
        )
        self.plot.line("ahead", "residual", source=self.source, color=ROUTE, line_width=2, legend_label="residual")
        self.plot.legend.background_fill_alpha, self.plot.legend.padding = 0.6, 3

    def show(self, comparison: "Comparison") -> None:
        """Draw the stack of all channels."""
        stack = comparison.stack
        band = 2 * stack.sigma[0]
        self.source.data = table(
            ahead=stack.ahead, measured=stack.measured[0], model=stack.model[0], residual=stack.residual[0],
            low=-band, high=band,
        )  # fmt: skip


class ByChannel:
    """Chi2 per sample of each channel."""

    def __init__(self, channels: Range1d):
        self.source = ColumnDataSource(table(channel=[], chi2=[]))
        self.floor = Span(dimension="width", line_color=INK, line_dash="dashed")
        self.plot = plain(
            figure(name="by channel", height=150, tools="pan,wheel_zoom,reset", x_range=channels,
                   x_axis_label="channel", y_axis_label="chi² per sample",
                   title="Residual by channel: dashed, noise alone", **WIDE)
        )  # fmt: skip
        self.plot.step("channel", "chi2", source=self.source, mode="center", color=ROUTE, line_width=1.6)
        self.plot.add_layout(self.floor)

    def show(self, comparison: "Comparison") -> None:
        """Draw all channels."""
        powers = comparison.power.channel
        self.source.data = table(channel=[int(one) for one in powers.labels], chi2=powers.chi2)
        self.floor.location = comparison.level


class ByProperty:
    """Chi2 per sample by some property of the vehicles, with two sigmas of noise."""

    def __init__(self) -> None:
        self.source = ColumnDataSource(table(label=[], chi2=[], low=[], high=[]))
        self.floor = Span(dimension="height", line_color=INK, line_dash="dashed")
        self.plot = plain(
            figure(name="by property", height=210, tools="", y_range=FactorRange(), x_axis_label="chi² per sample",
                   title="Residual near the vehicles", **WIDE)
        )  # fmt: skip
        self.plot.y_range.range_padding = 0.1
        dots = self.plot.scatter("chi2", "label", source=self.source, color=ROUTE, size=8)
        self.plot.segment("low", "label", "high", "label", source=self.source, color=ROUTE)
        self.plot.add_tools(HoverTool(renderers=[dots], tooltips=[("", "@label"), ("chi² per sample", "@chi2{0.00}")]))
        self.plot.add_layout(self.floor)

    def show(self, comparison: "Comparison", by: str) -> None:
        """Draw the values of one of `PROPERTIES`."""
        powers: Any = getattr(comparison.power, PROPERTIES[by])
        order = np.argsort(np.nan_to_num(powers.chi2))[-MOST:]
        known = [int(at) for at in order if np.isfinite(powers.chi2[at])]
        labels = [powers.labels[at] for at in known]
        chi2, sigma = powers.chi2[known], powers.sigma[known]
        self.plot.y_range.factors = list(dict.fromkeys(labels))
        self.source.data = table(label=labels, chi2=chi2, low=chi2 - 2 * sigma, high=chi2 + 2 * sigma)
        self.floor.location = comparison.level
        self.plot.title.text = f"Residual near the vehicles by {by}: dashed, noise alone"
