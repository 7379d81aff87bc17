"""One page for the file: where the fiber is, how sure that is, in which class, and what is not claimed."""

import textwrap
from importlib.metadata import version

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solver.run.geojson import Z95, corridor_ring, half_width
from solver.run.gis.accuracy import CLAIM, share_lines
from solver.run.gis.layers import Subject
from solver.run.gis.target import Target
from vision.contract.figures import INK, MUTED, PAPER, styled
from vision.contract.palette import ROUTE

#: A4, inches; and characters of a line of small print.
A4, LINE = (8.27, 11.69), 118
#: Places that the table of coordinates lists.
ROWS = 12


@styled
def sheet(subject: Subject, target: Target) -> Figure:
    """The page: title and trust, map, sideways place and depth with the 95 % corridor, classes, coordinates.

    Parameters
    ----------
    subject : the route
    target : coordinates of the table
    """
    figure = Figure(figsize=A4)
    place = subject.place
    figure.text(0.08, 0.955, f"{subject.name}: fiber route", size=16, weight="bold")
    figure.text(0.08, 0.94, wrapped(subject.trust), size=8, va="top", color=MUTED)
    boxes = {"map": (0.12, 0.67, 0.8, 0.17), "side": (0.12, 0.5, 0.8, 0.11), "depth": (0.12, 0.35, 0.8, 0.1)}
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
    made = f"roadfiber {version('roadfiber')}; third coordinate: {target.third}"
    figure.text(0.08, 0.025, made, size=7, color=MUTED)
    return figure


def wrapped(text: str, width: int = LINE) -> str:
    """Text broken into lines."""
    return "\n".join(textwrap.wrap(text, width))


def draw_map(axes: Axes, subject: Subject) -> None:
    """From above, in the local frame, north marked."""
    place = subject.place
    half = half_width(place.route, place.covariance)
    if np.isfinite(half).all():
        ring = corridor_ring(place.route[:, :2], half)
        axes.fill(ring[:, 0], ring[:, 1], color=ROUTE, alpha=0.25, lw=0)
    axes.axhline(0, color=MUTED, lw=0.6, ls=(0, (6, 4)))
    axes.plot(place.route[:, 0], place.route[:, 1], color=ROUTE, lw=1.8)
    for one in subject.anchors:
        axes.plot(one.x, one.y, "s", ms=5, mfc=PAPER, mec=INK)
        axes.annotate(one.name, (one.x, one.y), (0, 7), textcoords="offset points", ha="center", size=7)
    low, high = place.route[:, 1].min() - 3, place.route[:, 1].max() + 3
    axes.set_ylim(max(high, 2.0), min(low, -2.0))
    axes.set(xlabel="x, m along the road", ylabel="y, m", title="From above")
    angle = np.deg2rad(subject.frame.x_azimuth)
    way = 0.05 * np.array([np.cos(angle), np.sin(angle) * 3])
    arrow = {"arrowstyle": "-|>", "color": INK}
    tip, tail = (0.96 + way[0], 1.13 + way[1] / 2), (0.96 - way[0], 1.13 - way[1] / 2)
    axes.annotate("", tip, tail, "axes fraction", arrowprops=arrow)
    axes.text(0.91, 1.1, "N", transform=axes.transAxes, weight="bold")


def draw_profile(axes: Axes, subject: Subject, axis: int, half: np.ndarray, label: str) -> None:
    """A coordinate along the fiber with its 95 % band, dashed where data and anchors do not decide."""
    place = subject.place
    at, value = place.distance, place.route[:, axis]
    axes.fill_between(at, value - half, value + half, color=ROUTE, alpha=0.25, lw=0)
    axes.plot(at, np.where(place.constrained, value, np.nan), color=ROUTE, lw=1.6)
    axes.plot(at, np.where(place.constrained, np.nan, value), color=ROUTE, lw=1.2, ls="--")
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
