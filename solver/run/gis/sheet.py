"""One page for the file: where the fiber is, how sure that is, in which class, what is not claimed, and how to dig."""

import textwrap
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from solver.run.geojson import Z95, corridor_ring, half_width
from solver.run.gis.accuracy import CLAIM, share_lines
from solver.run.gis.layers import Subject
from solver.run.gis.target import Target
from solver.run.report.route_figure import draw_line, draw_north
from vision.contract.figures import INK, MUTED, PAPER, styled
from vision.contract.palette import ROUTE

#: A4, inches; and characters of a line of small print.
A4, LINE = (8.27, 11.69), 118
#: Places that the table of coordinates lists.
ROWS = 12
#: Height of a line of small print, of the page's.
LEADING = 0.0118
#: For who digs: the steps that one-call services ask for are to call, wait for the marks, respect them, dig with care.
DIGGING = (
    "Before anyone digs. This route is an estimate from vibration of the ground. It is not a utility locate, and no "
    "mark on the street. It shows one fiber; pipes and cables of others are not on it. Call the one-call service "
    "(in the United States 811) and wait until all utilities are marked. Within the corridor, and wherever the "
    "marks ask for it, dig by hand or by vacuum until the fiber is seen; use no machine there, and do not trust the "
    "depth. The fiber may lie outside the corridor, which at best holds it in 95 of 100 surveys like this one."
)


@styled
def sheet(subject: Subject, target: Target) -> Figure:
    """The page: title, trust, what a crew must know, map, sideways place and depth with the corridor, classes, places.

    Parameters
    ----------
    subject : the route
    target : coordinates of the table
    """
    figure = Figure(figsize=A4)
    place = subject.place
    figure.text(0.08, 0.955, f"{subject.name}: fiber route", size=16, weight="bold")
    trust = wrapped(place.told)
    figure.text(0.08, 0.945, trust, size=8, va="top", color=MUTED)
    below = 0.945 - LEADING * (trust.count("\n") + 2)
    digging = wrapped(DIGGING, 105)
    figure.text(0.08, below, digging, size=8, va="top", weight="bold")
    top = min(0.785, below - LEADING * (digging.count("\n") + 3))
    boxes = {
        "map": (0.12, 0.635, 0.8, max(0.03, top - 0.635)),
        "side": (0.12, 0.485, 0.8, 0.095),
        "depth": (0.12, 0.35, 0.8, 0.09),
    }
    axes = {name: figure.add_axes(box) for name, box in boxes.items()}
    for name, one in axes.items():
        one.set_label(name)
    draw_map(axes["map"], subject)
    half = half_width(place.route, place.covariance)
    draw_profile(axes["side"], subject, 1, half, "y, m across the road (right is down)")
    draw_profile(axes["depth"], subject, 2, Z95 * place.sigma[:, 2], "depth below the road, m")
    axes["depth"].set_xlabel("distance along the fiber, m")
    figure.text(0.08, 0.295, "Accuracy (PAS 128:2022)", size=10, weight="bold")
    figure.text(0.08, 0.282, "\n".join(share_lines(subject.accuracy)), size=8, va="top", linespacing=1.5)
    figure.text(0.08, 0.21, wrapped(CLAIM, 52), size=7, va="top", color=MUTED, linespacing=1.35)
    draw_table(figure, subject, target)
    made = f"Made {datetime.now(UTC):%Y-%m-%d} by roadfiber {version('roadfiber')}"
    recorded = f" of a record of {subject.recorded}" if subject.recorded else ""
    figure.text(0.08, 0.025, f"{made}{recorded}; third coordinate: {target.third}", size=7, color=MUTED)
    return figure


def wrapped(text: str, width: int = LINE) -> str:
    """Text broken into lines."""
    return "\n".join(textwrap.wrap(text, width, break_on_hyphens=False))


def draw_map(axes: Axes, subject: Subject) -> None:
    """From above, in the local frame, of one scale along and across; true north, scale and signs are told."""
    place = subject.place
    half = half_width(place.route, place.covariance)
    if np.isfinite(half).all():
        ring = corridor_ring(place.route[:, :2], half)
        axes.fill(ring[:, 0], ring[:, 1], color=ROUTE, alpha=0.25, lw=0, label="95 % corridor")
    axes.axhline(0, color=MUTED, lw=0.6, ls=(0, (6, 4)), label="survey line, y = 0")
    x, y, sure = place.route[:, 0], place.route[:, 1], place.reliable
    axes.plot(np.where(sure, x, np.nan), y, color=ROUTE, lw=1.8, label="fiber")
    if not sure.all():
        axes.plot(np.where(sure, np.nan, x), y, color=ROUTE, lw=1.2, ls="--", label="fiber, not to be relied on")
    for at, one in enumerate(subject.anchors):
        axes.plot(one.x, one.y, "s", ms=5, mfc=PAPER, mec=INK, label="" if at else "anchor, known place")
        axes.annotate(one.name, (one.x, one.y), (0, 7), textcoords="offset points", ha="center", size=7)
    axes.set(xlabel="x, m along the road", ylabel="y, m")
    axes.set_title("From above", loc="left")
    low, high = min(y.min() - 3, -2.0), max(y.max() + 3, 2.0)
    axes.set_xlim(x.min() - 1, x.max() + 1)
    axes.set_ylim(high, low)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="lower left", bbox_to_anchor=(0.13, 0.99), ncols=5, fontsize=6.5, frameon=False, columnspacing=1.2)
    length = MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0, np.ptp(x) + 2)[1]
    beneath = {"bbox_to_anchor": (1, -0.12), "bbox_transform": axes.transAxes, "frameon": False, "color": INK}
    axes.add_artist(AnchoredSizeBar(axes.transData, length, f"{length:g} m", "upper right", **beneath))
    draw_north(axes, subject.frame.x_azimuth)


def draw_profile(axes: Axes, subject: Subject, axis: int, half: np.ndarray, label: str) -> None:
    """A coordinate along the fiber with its 95 % band, dashed where it may not be relied on."""
    place = subject.place
    at, value = place.distance, place.route[:, axis]
    axes.fill_between(at, value - half, value + half, color=ROUTE, alpha=0.25, lw=0)
    draw_line(axes, at, value, place.reliable)
    axes.invert_yaxis()
    axes.set_title(label)
    axes.grid(axis="y", color=MUTED, lw=0.4, alpha=0.35)


def draw_table(figure: Figure, subject: Subject, target: Target) -> None:
    """Coordinates of some channels with 95 % half-widths, in millimeters or to the ninth decimal of a degree."""
    place, found = subject.place, subject.accuracy
    some = np.unique(np.linspace(0, len(place.channel) - 1, ROWS).round().astype(int))
    points = target.points(subject.frame, place.route[some])
    form = "{:.7f}" if target.degrees else "{:.2f}"
    head = ["channel", *target.names, "depth", "± across", "± depth", "class"]
    rows = [
        [
            f"{place.channel[i]}",
            *map(form.format, point[:2]),
            *map("{:.2f}".format, (place.route[i, 2], found.across[i], found.depth[i])),
            str(found.pas128[i]),
        ]
        for i, point in zip(some, points, strict=True)
    ]
    axes = figure.add_axes((0.47, 0.05, 0.47, 0.235))
    axes.set_label("table")
    axes.axis("off")
    table = axes.table(rows, colLabels=head, loc="center", cellLoc="right", edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(6.5)
    table.auto_set_column_width(range(len(head)))
    axes.set_title(f"Coordinates, {target.crs.to_string()}, {target.unit}; depth and ±, m, at 95 %", size=8)
