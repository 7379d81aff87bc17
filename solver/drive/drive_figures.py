"""Figures of a located drive: the drive over the waterfall, the channel map, the route from above, the misfit."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solver.drive.waterfall import draw_car, draw_record
from solver.run.geojson import Z95, runs
from vision.contract.drawing import canvas, place
from vision.contract.figures import INK, MUTED, RULE, styled
from vision.contract.palette import BACKWARD, FORWARD, ROUTE, SERIES

if TYPE_CHECKING:
    from solver.drive.drive_run import DriveRun

Array = NDArray[np.float64]

LEFT, RIGHT, TOP, UNDER, BETWEEN = 70, 20, 26, 46, 44  # px
#: Most legs that a drive may have.
MOST_LEGS = 1000
#: m, half-widths that the figure shows between.
NARROW, WIDE = 0.1, 300.0
#: Color of loops, and dots of a leg that goes on along the map or against it.
LOOP = SERIES[2]


def shade_loops(axes: Axes, run: "DriveRun") -> None:
    """Mark the channels of each loop."""
    for one in run.facts["loops"]:
        axes.axvspan(one["first_channel"] - 0.5, one["last_channel"] + 0.5, color=LOOP, alpha=0.25, lw=0)


@styled
def waterfall_figure(run: "DriveRun", width: int) -> Figure:
    """The record in noise sigmas over time and channel, and the car where the fit has it."""
    height = 420
    figure = canvas(width, TOP + height + UNDER)
    axes = place(figure, "record", LEFT, TOP, width - LEFT - RIGHT, height)
    channel = run.arrays["channel"]
    ends = int(channel[0]), int(channel[-1])
    draw_record(axes, np.asarray(run.arrays["picture"], np.float32), ends, float(run.facts["seconds_shown"]))
    draw_car(axes, run.arrays["car_time"], run.arrays["car_channel"])
    for one in run.facts["loops"]:
        axes.axhspan(one["first_channel"] - 0.5, one["last_channel"] + 0.5, xmax=0.012, color=LOOP, lw=0)
    axes.set_title("The record, in sigmas of its noise: black is loud; the car as located; loops at the left edge")
    return figure


@styled
def channel_figure(run: "DriveRun", width: int) -> Figure:
    """The channel map: where along the map each channel lies, the slack up to it, and how sure that is."""
    heights = (150, 190, 150)
    figure = canvas(width, TOP + sum(heights) + 2 * BETWEEN + UNDER)
    channel, constrained = run.arrays["channel"], run.arrays["constrained"]
    along, half = run.arrays["along"], Z95 * run.arrays["sigma_along"]
    tops = np.cumsum([TOP, *(height + BETWEEN for height in heights)])
    names = ("along", "slack", "width")
    panels = [
        place(figure, name, LEFT, int(top), width - LEFT - RIGHT, height)
        for name, top, height in zip(names, tops, heights, strict=False)
    ]
    for axes in panels:
        shade_loops(axes, run)
        axes.set_xlim(channel[0] - 0.5, channel[-1] + 0.5)
    sure = run.placed.reliable
    draw_line(panels[0], channel, along / 1e3, half / 1e3, sure)
    panels[0].axhspan(0, run.facts["map_length"] / 1e3, color=RULE, alpha=0.3, lw=0, zorder=0)
    panels[0].set(ylabel="along the map, km", title="Which channel lies where (gray: the map; green: loops of slack)")
    slack = slack_of(run)
    draw_line(panels[1], channel, slack, half, sure)
    shown = slack[constrained] if constrained.any() else slack
    margin = max(8.0, 0.08 * float(np.ptp(shown)))
    panels[1].set_ylim(shown.min() - margin, shown.max() + margin)
    panels[1].set(ylabel="m", title="Cable less path: it climbs where cable is slack, with the 95 % band")
    panels[2].fill_between(channel, NARROW, np.clip(half, NARROW, WIDE), color=ROUTE, alpha=0.3, lw=0, step="mid")
    heard = run.arrays["heard"]
    panels[2].plot(channel[heard], np.full(heard.sum(), NARROW * 1.15), "|", color=INK, ms=5, mew=0.8)
    panels[2].set(yscale="log", ylim=(NARROW, WIDE), xlabel="channel", ylabel="m")
    panels[2].yaxis.set_major_formatter("{x:g}")
    panels[2].yaxis.set_minor_formatter("")
    panels[2].set_title("Half-width of the 95 % band along the path; ticks: channels that heard the car")
    return figure


def slack_of(run: "DriveRun") -> Array:
    """Cable less path up to each channel, m, 0 at the first that is located."""
    factor = float(run.facts["parameters"]["length_factor"]["value"] or 1.0)
    slack = run.arrays["distance"] - factor * run.arrays["along"]
    located = np.flatnonzero(run.arrays["constrained"])
    return np.asarray(slack - slack[located[0] if len(located) else 0])


def draw_line(axes: Axes, channel: Array, value: Array, half: Array, sure: NDArray[np.bool_]) -> None:
    """A line with its band: solid where the drive decides it and no check failed, dotted elsewhere."""
    axes.fill_between(channel, value - half, value + half, color=ROUTE, alpha=0.25, lw=0)
    for first, last in runs(sure):
        part = slice(max(0, first - 1), last + 1)
        style = "-" if sure[first] else (0, (1, 1.5))
        axes.plot(channel[part], value[part], color=ROUTE, lw=1.6, ls=style)


@styled
def plan_figure(run: "DriveRun", width: int) -> Figure:
    """The route from above, the map, the car and the loops; x to the right, y down."""
    route, constrained = run.arrays["route"], run.arrays["constrained"]
    line = run.arrays["map"]
    whole = np.concatenate([line, run.arrays["car"], route[constrained, :2]])
    low, high = whole.min(0) - 20, whole.max(0) + 20
    inner = width - LEFT - RIGHT
    height = int(np.clip(inner * (high[1] - low[1]) / (high[0] - low[0]), 160, 620))
    figure = canvas(width, TOP + height + UNDER)
    axes = place(figure, "plan", LEFT, TOP, inner, height)
    axes.plot(*line.T, color=MUTED, lw=1.2, ls=(0, (4, 2)), label="operator's map")
    axes.plot(*run.arrays["car"].T, color=BACKWARD, lw=0, marker=".", ms=1.5)
    axes.plot([], [], color=BACKWARD, lw=2.5, label="car")
    sure = run.placed.reliable
    for first, last in runs(sure):
        style = "-" if sure[first] else (0, (1, 1.5))
        inside = slice(max(0, first - 1), last + 1)
        axes.plot(*route[inside, :2].T, color=ROUTE, lw=1.8, ls=style)
    axes.plot([], [], color=ROUTE, lw=1.8, label="fiber (dotted: not decided by the drive, or a check failed)")
    for number, one in enumerate(run.facts["loops"]):
        label = "loop of slack" if number == 0 else None
        axes.plot(one["x"], one["y"], "o", mfc="none", mec=LOOP, mew=1.6, ms=8, label=label)
    # As many meters a pixel both ways.
    half = float(((high - low) / (inner, height)).max()) * np.array([inner, height]) / 2
    (left, top), (right, bottom) = (low + high) / 2 - half, (low + high) / 2 + half
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="x, m", ylabel="y, m (right of +x is down)")
    # Above the axes, where no line is.
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, borderaxespad=0.2)
    return figure


@styled
def misfit_figure(run: "DriveRun", width: int) -> Figure:
    """How far each channel's picks are from the fit, leg by leg, along the map; and the share of channels heard."""
    heights = (190, 90)
    figure = canvas(width, TOP + sum(heights) + BETWEEN + UNDER)
    along = run.arrays["along"] / 1e3
    inner = width - LEFT - RIGHT
    upper = place(figure, "misfit", LEFT, TOP, inner, heights[0])
    lower = place(figure, "heard", LEFT, TOP + heights[0] + BETWEEN, inner, heights[1])
    residual = np.asarray(run.arrays["residual"], float)
    for leg, one in enumerate(residual):
        upper.plot(along, np.clip(one, -10, 10), ".", ms=3, color=SERIES[leg % len(SERIES)], label=f"leg {leg + 1}")
    upper.axhline(0, color=RULE, lw=0.8)
    upper.set(ylabel="m", title="What the picks of each leg are off, after clock and errors of the GPS")
    upper.set_ylim(-1.1 * min(10, scale_of(residual)), 1.1 * min(10, scale_of(residual)))
    if 1 < len(residual) <= len(SERIES):
        upper.legend(loc="upper right", ncols=len(residual), markerscale=3)
    edges = np.linspace(0, run.facts["map_length"] / 1e3, 61)
    inside = run.arrays["beside"] & ~run.arrays["loop"]
    every = np.histogram(along[inside], edges)[0]
    heard = np.histogram(along[inside & run.arrays["heard"]], edges)[0]
    share = np.divide(heard, every, out=np.full(len(every), np.nan), where=every > 0)
    lower.bar(edges[:-1], np.nan_to_num(share), np.diff(edges), align="edge", color=FORWARD, alpha=0.7)
    lower.set(
        ylim=(0, 1.02), yticks=(0, 0.5, 1), xlabel="along the map, km", title="Share of channels that hear the car"
    )
    for axes in (upper, lower):
        axes.set_xlim(edges[0], edges[-1])
    return figure


def scale_of(residual: Array) -> float:
    """Largest misfit that is shown, m."""
    known = np.abs(residual[np.isfinite(residual)])
    return max(1.0, float(np.percentile(known, 99))) if len(known) else 1.0
