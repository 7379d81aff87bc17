"""The figures of the workbench, Bokeh's: the map, the depth, three maps of strain rate with one zoom, traces, misfits.

Each class holds the models of one figure and changes what they show; none knows of the bench.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from bokeh.events import Tap
from bokeh.models import (
    Arrow,
    ColumnDataSource,
    HoverTool,
    Label,
    NormalHead,
    Range1d,
    ScaleBar,
    Span,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from roadfiber.web.tiles import Beneath
from solver.run.geojson import Z95, corridor_ring, half_width, runs
from solver.run.rung import Rung
from solver.run.seen import Seen
from vision.contract.palette import BACKWARD, FORWARD, ROUTE

Array = NDArray[np.float64]

INK, MUTED = "#1f2933", "#5d6873"
WIDE: dict[str, Any] = {"sizing_mode": "stretch_width", "toolbar_location": "right", "min_width": 120}


def plain(plot: Any) -> Any:
    """A figure in the style of the pages."""
    plot.outline_line_color = "#d5dae0"
    plot.title.text_font_size, plot.title.text_color = "13px", INK
    plot.grid.grid_line_alpha = 0.35
    plot.axis.axis_label_text_font_style = "normal"
    plot.axis.axis_label_text_color = plot.axis.major_label_text_color = MUTED
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    return plot


def table(**columns: Any) -> dict[str, Any]:
    """Columns of a source: arrays as they are, which go to the browser as such, all else as lists."""
    return {name: one if isinstance(one, np.ndarray) else list(one) for name, one in columns.items()}


def scale_bar(plot: Any) -> ScaleBar:
    """A scale in the corner of a map, through which what lies beneath is seen."""
    bare = {"background_fill_alpha": 0, "border_line_alpha": 0, "padding": 2, "label_location": "right"}
    return ScaleBar(range=plot.x_range, unit="m", location="bottom_left", bar_length=0.12, **bare)


class North:
    """An arrow to the north in the corner of a figure."""

    def __init__(self, plot: Any):
        screen = {f"{end}_units": "screen" for end in ("start", "end")}
        self.arrow = Arrow(end=NormalHead(size=9, fill_color=INK), line_color=INK, **screen)
        units = {f"{axis}_units": "screen" for axis in "xy"}
        self.letter = Label(x=0, y=0, text="N", text_color=INK, text_font_size="12px", **units)
        plot.add_layout(self.arrow)
        plot.add_layout(self.letter)

    def point(self, azimuth: float) -> None:
        """Point it, by the azimuth of +x, degrees; +y points down on the screen."""
        turn = np.radians(azimuth)
        middle, reach = np.array([46.0, 96.0]), 22.0
        way = np.array([np.cos(turn), np.sin(turn)])
        (x0, y0), (x1, y1), (x, y) = middle - reach * way, middle + reach * way, middle + (reach + 9) * way - (4, 7)
        self.arrow.update(x_start=x0, y_start=y0, x_end=x1, y_end=y1)
        self.letter.update(x=x, y=y)


def dash_of(run: Seen) -> str:
    """How the fiber is drawn: solid where it may be relied on."""
    return "solid" if run.place.reliable.any() else "dashed"


class RouteMap:
    """The street from above: route with its corridor, tracks, anchors, where a preview or the rung below puts it.

    Parameters
    ----------
    tapped : called with x and y, m, where somebody clicked
    """

    def __init__(self, tapped: Callable[[float, float], None]):
        self.ground = ColumnDataSource(table(image=[], x=[], y=[], dw=[], dh=[]))
        self.corridor = ColumnDataSource(table(xs=[], ys=[]))
        self.tracks = ColumnDataSource(table(xs=[], ys=[], color=[], name=[]))
        self.other, self.route = (ColumnDataSource(table(x=[], y=[])) for _ in range(2))
        self.anchors = ColumnDataSource(table(x=[], y=[], name=[]))
        self.corners = ColumnDataSource(table(x=[], y=[], words=[]))
        self.place = ColumnDataSource(table(x=[], y=[]))
        self.vehicle = ColumnDataSource(table(x=[], y=[], fill=[]))
        self.plot = plain(
            figure(name="map", height=230, match_aspect=True, tools="pan,wheel_zoom,reset", active_scroll="wheel_zoom",
                   title="From above", x_axis_label="x along the road, m", y_axis_label="y, m", **WIDE)
        )  # fmt: skip
        self.plot.y_range.flipped = True
        self.plot.image_rgba("image", source=self.ground, x="x", y="y", dw="dw", dh="dh")
        tracks = self.plot.multi_line("xs", "ys", source=self.tracks, color="color", line_width=1, alpha=0.7)
        self.plot.add_tools(HoverTool(renderers=[tracks], tooltips=[("vehicle", "@name")]))
        band = self.plot.patches("xs", "ys", source=self.corridor, fill_color=ROUTE, fill_alpha=0.25, line_alpha=0)
        self.plot.line("x", "y", source=self.other, color=INK, line_width=2, line_dash=[5, 4])
        self.line = route = self.plot.line("x", "y", source=self.route, color=ROUTE, line_width=2.5)
        marks = self.plot.scatter("x", "y", source=self.anchors, marker="square", size=9, color=INK, fill_alpha=0)
        self.plot.add_tools(HoverTool(renderers=[marks], tooltips=[("anchor", "@name")]))
        turns = self.plot.scatter("x", "y", source=self.corners, marker="diamond", size=13, color=INK, fill_alpha=0)
        self.plot.add_tools(HoverTool(renderers=[turns], tooltips=[("the fiber", "@words")]))
        self.plot.on_event(Tap, lambda event: tapped(event.x, event.y))
        self.plot.scatter("x", "y", source=self.vehicle, marker="circle", size=9, color=FORWARD, fill_alpha="fill")
        self.plot.scatter("x", "y", source=self.place, marker="diamond", size=12, color=ROUTE, line_color="white")
        self.plot.add_layout(scale_bar(self.plot))
        self.north = North(self.plot)
        # Not the vehicle, which would move the map beneath it.
        self.plot.x_range.renderers = self.plot.y_range.renderers = [tracks, band, route, marks]

    def show(self, run: Seen) -> None:
        """Draw a run, once for all that does not change with its rungs."""
        result = run.result
        known = [slice(a, b + 1) for a, b in runs(result.constrained) if result.constrained[a] and b > a]
        rings = [
            corridor_ring(result.route[one, :2], half_width(result.route[one], result.covariance[one]))
            for one in known
            if np.isfinite(result.covariance[one]).all()
        ]
        self.corridor.data = table(xs=[one[:, 0].tolist() for one in rings], ys=[one[:, 1].tolist() for one in rings])
        x, y = (np.where(result.constrained, result.route[:, at], np.nan) for at in (0, 1))
        self.route.data = table(x=x, y=y)
        self.line.glyph.line_dash = dash_of(run)
        low, high = result.route[:, 0].min() - 15, result.route[:, 0].max() + 15
        paths = [one.position[(one.position[:, 0] > low) & (one.position[:, 0] < high)] for one in run.passes]
        self.tracks.data = table(
            xs=[one[:, 0].tolist() for one in paths],
            ys=[one[:, 1].tolist() for one in paths],
            color=[FORWARD if one.speed > 0 else BACKWARD for one in run.passes],
            name=[f"{one.track_id}, {one.vehicle_class}" for one in run.passes],
        )
        anchors = run.anchors
        self.anchors.data = table(
            x=[one.x for one in anchors], y=[one.y for one in anchors], name=[one.name for one in anchors]
        )
        corners = result.corners
        self.corners.data = table(
            x=[one.x for one in corners], y=[one.y for one in corners], words=[one.words for one in corners]
        )
        self.north.point(run.frame.x_azimuth)

    def beneath(self, ground: Beneath) -> None:
        """Draw a picture of the ground beneath all else, and say whose it is."""
        (x, y), (right, down) = ground.low, ground.high
        self.ground.data = table(image=[ground.image], x=[x], y=[y], dw=[right - x], dh=[down - y])
        self.plot.title.text = f"From above, on map tiles of {ground.host}"

    def beside(self, route: Array) -> None:
        """Draw another route [place, 2 or 3] dashed, or none of no places."""
        self.other.data = table(x=route[:, 0], y=route[:, 1])

    def point(self, place: Array, vehicle: Array | None, seen: bool = True) -> None:
        """Mark a place of the fiber and one of a vehicle, m, hollow where nobody saw it; no vehicle where None."""
        self.place.data = table(x=[place[0]], y=[place[1]])
        there = [] if vehicle is None else [vehicle]
        self.vehicle.data = table(x=[at[0] for at in there], y=[at[1] for at in there], fill=[float(seen)] * len(there))


class DepthProfile:
    """Depth of the fiber by channel, with its 95 % band."""

    def __init__(self, channels: Range1d):
        self.source = ColumnDataSource(table(channel=[], z=[], low=[], high=[]))
        self.other = ColumnDataSource(table(channel=[], z=[]))
        self.plot = plain(
            figure(name="depth", height=150, tools="pan,wheel_zoom,reset", x_range=channels, title="Depth",
                   x_axis_label="channel", y_axis_label="z, m", **WIDE)
        )  # fmt: skip
        self.plot.y_range.flipped = True
        self.plot.varea("channel", "low", "high", source=self.source, fill_color=ROUTE, fill_alpha=0.25)
        self.plot.line("channel", "z", source=self.other, color=INK, line_width=2, line_dash=[5, 4])
        self.line = self.plot.line("channel", "z", source=self.source, color=ROUTE, line_width=2.5)

    def show(self, run: Seen) -> None:
        """Draw a run."""
        place = run.place
        z, half = (np.where(place.constrained, one, np.nan) for one in (place.route[:, 2], Z95 * place.sigma[:, 2]))
        self.source.data = table(channel=place.channel, z=z, low=z - half, high=z + half)
        self.line.glyph.line_dash = dash_of(run)

    def beside(self, channel: NDArray[np.int64], z: Array) -> None:
        """Draw another depth dashed."""
        self.other.data = table(channel=channel, z=z)


class LadderFigure:
    """Misfit and held-out misfit of each rung, down to the noise floor."""

    def __init__(self) -> None:
        self.misfit, self.held = (ColumnDataSource(table(x=[], y=[], name=[])) for _ in range(2))
        self.floor = Span(dimension="width", line_color=INK, line_dash="dashed")
        self.plot = plain(
            figure(name="ladder", height=180, tools="", x_axis_label="rung", y_axis_label="misfit", **WIDE,
                   title="Error ladder: dashed, what noise alone leaves")
        )  # fmt: skip
        style: tuple[tuple[Any, ...], ...] = (
            (self.misfit, ROUTE, "circle", "fitted passes", []),
            (self.held, FORWARD, "square", "passes held out", [6, 3]),
        )
        for source, color, marker, name, dash in style:
            self.plot.line("x", "y", source=source, color=color, line_width=2, line_dash=dash, legend_label=name)
            dots = self.plot.scatter("x", "y", source=source, color=color, marker=marker, size=8, legend_label=name)
            self.plot.add_tools(HoverTool(renderers=[dots], tooltips=[("rung", "@name"), ("misfit", "@y{0.000}")]))
        self.plot.add_layout(self.floor)
        self.plot.legend.background_fill_alpha, self.plot.legend.padding = 0.6, 3
        self.plot.xaxis.ticker.desired_num_ticks = 4
        self.plot.xaxis.ticker.min_interval = 1

    def show(self, rungs: Sequence[Rung], names: Sequence[str]) -> None:
        """Draw a ladder, lowest rung first."""
        at = list(range(1, len(rungs) + 1))
        self.misfit.data = table(x=at, y=[one.chi2_per_dof for one in rungs], name=names)
        held = [np.nan if (one := rung.held_out_chi2_per_dof) is None else one for rung in rungs]
        self.held.data = table(x=at, y=held, name=names)
        self.floor.location = rungs[-1].noise_floor or 1.0


class LiveMisfit:
    """The misfit of the fits under way, step by step."""

    def __init__(self) -> None:
        self.source = ColumnDataSource(table(xs=[], ys=[], color=[]))
        self.plot = plain(
            figure(name="live", height=140, tools="", x_axis_label="step", y_axis_label="chi² per sample", **WIDE,
                   title="Fits under way: the last in color")
        )  # fmt: skip
        self.plot.multi_line("xs", "ys", source=self.source, color="color", line_width=2)

    def show(self, fits: Sequence[tuple[str, list[tuple[int, float]]]]) -> None:
        """Draw fits, the last in the color of routes."""
        lines = [np.array(points, dtype=float) for _, points in fits]
        self.source.data = table(
            xs=[one[:, 0].tolist() for one in lines],
            ys=[one[:, 1].tolist() for one in lines],
            color=[*("#c3c9cf" for _ in lines[1:]), *(ROUTE for _ in lines[-1:])],
        )
        self.plot.title.text = f"Fitting with {fits[-1][0]}" if fits else "No fit under way"
