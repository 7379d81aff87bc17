"""Figures of the strain rate on the workbench: three maps with one zoom, and traces through them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from bokeh.events import MouseMove, RangesUpdate, Reset, Tap
from bokeh.models import (
    ColumnDataSource,
    CrosshairTool,
    CustomJS,
    HoverTool,
    LinearColorMapper,
    Range1d,
    Span,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from roadfiber.web.figures import INK, MUTED, WIDE, plain, table
from roadfiber.web.strain_maps import PassMaps, palette, picture, steps
from vision.contract.palette import ROUTE, limit_of

Array = NDArray[np.float64]

#: Where there is no measurement.
NOTHING = "#b5bac0"
#: ms between two moments under the cursor that the server is told of.
PACE = 150


class StrainMaps:
    """Measured, model and residual of one pass: one zoom, one cursor, one scale of colors.

    Parameters
    ----------
    tapped : called with channel and second where somebody clicked
    moved : called when the zoom has changed
    """

    NAMES = ("measured", "model", "residual")

    def __init__(self, tapped: Callable[[float, float], None], moved: Callable[[], None]):
        self.maps: PassMaps | None = None
        self.channels, self.seconds = Range1d(0, 1), Range1d(1, 0)
        self.images = [ColumnDataSource(table(image=[], x=[], y=[], dw=[], dh=[])) for _ in self.NAMES]
        self.path = ColumnDataSource(table(x=[], y=[]))
        self.boxes = ColumnDataSource(table(xs=[], ys=[], width=[]))
        self.under = ColumnDataSource({"channel": [0.0], "second": [0.0]}, name="under")
        self.colors = LinearColorMapper(palette=list(palette(10.0)), low=-10, high=10, nan_color=NOTHING)
        lines = [Span(dimension=way, line_color=INK, line_alpha=0.5) for way in ("width", "height")]
        self.plots = [self.one(name, image, lines) for name, image in zip(self.NAMES, self.images, strict=True)]
        follow = CustomJS(
            args={"under": self.under, "pace": PACE},
            code="""
                const now = Date.now()
                if (now - (window.roadfiber_told || 0) < pace) return
                window.roadfiber_told = now
                under.data = {channel: [cb_obj.x], second: [cb_obj.y]}
            """,
        )
        for plot in self.plots:
            plot.on_event(Tap, lambda event: tapped(event.x, event.y))
            plot.on_event(RangesUpdate, lambda event: moved())
            plot.on_event(Reset, lambda event: self.whole())
            plot.js_on_event(MouseMove, follow)

    def one(self, name: str, image: ColumnDataSource, lines: list[Span]) -> Any:
        """One of the three."""
        plot = plain(
            figure(name=name, height=340, x_range=self.channels, y_range=self.seconds, title=name.capitalize(),
                   tools="pan,box_zoom,wheel_zoom,reset", active_scroll="wheel_zoom", x_axis_label="channel",
                   y_axis_label="time, s" if name == "measured" else None, **WIDE)
        )  # fmt: skip
        drawn = plot.image("image", source=image, x="x", y="y", dw="dw", dh="dh", color_mapper=self.colors)
        plot.line("x", "y", source=self.path, color=INK, line_width=1.2, line_dash=[1, 3])
        plot.multi_line("xs", "ys", source=self.boxes, color=INK, line_width="width")
        tips = [("channel", "$x{0}"), ("second", "$y{0.00}"), (f"{name}, sigmas", "@image{0.0}")]
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=tips), CrosshairTool(overlay=lines))
        return plot

    def show(self, maps: PassMaps, keep: bool) -> None:
        """Draw a pass; as it is zoomed where `keep`."""
        self.maps = maps
        limit = limit_of(maps.measured)
        if limit != self.colors.high:
            self.colors.update(palette=list(palette(limit)), low=-limit, high=limit)
        path = maps.path[np.isfinite(maps.path).all(1)]
        self.path.data = table(x=path[:, 0], y=path[:, 1])
        if keep:
            self.draw()
        else:
            self.whole()

    def whole(self) -> None:
        """Show all of the pass."""
        if self.maps is not None:
            left, right, first, last = self.maps.extent
            self.zoom((left, right), (first, last))

    def zoom(self, channels: tuple[float, float], seconds: tuple[float, float]) -> None:
        """Show a window."""
        self.channels.update(start=channels[0], end=channels[1])
        self.seconds.update(start=seconds[1], end=seconds[0])
        self.draw()

    def draw(self) -> None:
        """Draw what lies in the window, each cell with what is largest in it."""
        if self.maps is None:
            return
        channels = sorted((self.channels.start, self.channels.end))
        seconds = sorted((self.seconds.start, self.seconds.end))
        for image, name in zip(self.images, self.NAMES, strict=True):
            image.data = picture(self.maps, getattr(self.maps, name), tuple(channels), tuple(seconds))

    def outline(self, boxes: Sequence[tuple[Array, Array, bool]]) -> None:
        """Outline regions: channels and seconds of their corners, and whether it is the chosen one."""
        self.boxes.data = table(
            xs=[x.tolist() for x, *_ in boxes],
            ys=[y.tolist() for _, y, *_ in boxes],
            width=[2.6 if chosen else 1.0 for *_, chosen in boxes],
        )


class Traces:
    """What one channel measured and what the model has, in time."""

    def __init__(self) -> None:
        self.measured, self.model, self.residual = (ColumnDataSource(table(x=[], y=[])) for _ in range(3))
        self.now = Span(dimension="height", line_color=INK, line_dash="dotted")
        self.plot = plain(
            figure(name="traces", height=230, tools="pan,wheel_zoom,reset", x_axis_label="time, s",
                   y_axis_label="noise sigmas", title="Click a map, or choose a channel", **WIDE)
        )  # fmt: skip
        self.plot.line("x", "y", source=self.residual, color=MUTED, line_width=1, legend_label="residual")
        self.plot.line("x", "y", source=self.measured, color=INK, line_width=1.6, legend_label="measured")
        self.plot.line("x", "y", source=self.model, color=ROUTE, line_width=1.4, line_dash=[5, 3], legend_label="model")
        self.plot.add_layout(self.now)
        self.plot.legend.orientation, self.plot.legend.background_fill_alpha = "horizontal", 0.6
        self.plot.legend.padding = self.plot.legend.margin = 3

    def show(self, maps: PassMaps, channel: float, second: float) -> int:
        """Draw the channel nearest to a number; that channel."""
        at, measured, model = maps.trace(channel)
        parts = ((self.measured, measured), (self.model, model), (self.residual, measured - model))
        for source, values in parts:
            x, y = steps(values, maps.seconds)
            source.data = table(x=x, y=y)
        self.now.location = second
        self.plot.title.text = f"Channel {at}"
        return at
