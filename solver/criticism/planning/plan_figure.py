"""The figure of a plan: lanes and expected corridor from above, and the expected sigmas along the road."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solver.run.geojson import Z95
from vision.contract.drawing import canvas, place
from vision.contract.figures import INK, MUTED, PAPER, styled
from vision.contract.palette import BACKWARD, FORWARD, ROUTE

if TYPE_CHECKING:
    from solver.criticism.planning.plan import Plan

#: px: the room left of the panels, and the height of the lower one.
LEFT, LOWER = 66, 190


@styled
def plan_figure(plan: "Plan", width: int) -> Figure:
    """From above, y true to the scale of x or stretched; below it the sigmas across and in depth.

    Parameters
    ----------
    plan : to draw
    width : of the figure, CSS pixels

    Returns
    -------
    figure : with axes labeled `plan` and `sigma`
    """
    across = width - LEFT - 24
    upper = 170
    figure = canvas(width, upper + LOWER + 130)
    above = place(figure, "plan", LEFT, 30, across, upper)
    below = place(figure, "sigma", LEFT, upper + 74, across, LOWER)
    draw_above(above, plan)
    draw_sigmas(below, plan)
    return figure


def draw_above(axes: Axes, plan: "Plan") -> None:
    """Lanes with their vehicles, the expected fiber with its 95 % corridor, anchors."""
    section, table = plan.planned.site.plan, plan.table
    half = Z95 * table["sigma_y"]
    axes.fill_between(table["x"], table["y"] - half, table["y"] + half, color=ROUTE, alpha=0.25, lw=0)
    axes.plot(table["x"], table["y"], color=ROUTE, lw=2)
    for lane in section.lanes:
        color = FORWARD if lane.direction > 0 else BACKWARD
        ends = (0.0, section.length)[:: lane.direction]
        arrow = {"arrowstyle": "-|>", "color": color, "lw": 1.2, "mutation_scale": 11}
        axes.annotate("", (ends[1], lane.y), (ends[0], lane.y), arrowprops=arrow)
        said = ", ".join(f"{count} {name}" for name, count in lane.vehicles.items() if count) or "no vehicle"
        axes.annotate(said, (section.length / 2, lane.y), (0, 8), textcoords="offset points", ha="center", color=INK)
    axes.plot(section.anchors, [section.offset] * len(section.anchors), "s", ms=6, mfc=PAPER, mec=INK, mew=1.4, ls="")
    values = [*(lane.y for lane in section.lanes), *(table["y"] - half), *(table["y"] + half)]
    axes.set_xlim(-0.02 * section.length, 1.02 * section.length)
    axes.set_ylim(max(values) + 1.2, min(values) - 1.8)
    axes.set_title("From above: lanes, expected fiber with its 95 % corridor, anchors")
    axes.set_ylabel("y, m (right is down)")


def draw_sigmas(axes: Axes, plan: "Plan") -> None:
    """One standard deviation across and in depth along the road, and what is wanted."""
    table, wanted = plan.table, plan.wanted
    both = (
        ("across", table["sigma_y"], ROUTE, "-", wanted.across),
        ("in depth", table["sigma_z"], FORWARD, "--", wanted.depth),
    )
    for name, sigma, color, style, limit in both:
        axes.plot(table["x"], sigma, color=color, ls=style, lw=1.8, label=name)
        if np.isfinite(limit):
            axes.axhline(limit, color=color, lw=0.9, ls=":", label=f"wanted {name}")
    axes.set_xlim(-0.02 * table["x"].max(), 1.02 * table["x"].max())
    axes.set_ylim(0, 1.15 * max(float(table[["sigma_y", "sigma_z"]].max().max()), *finite(wanted.across, wanted.depth)))
    axes.grid(axis="y", color=MUTED, lw=0.4, alpha=0.35)
    axes.set(title="Expected standard deviation along the road", xlabel="x, m along the road", ylabel="1 sigma, m")
    axes.legend(loc="upper center", ncols=4)


def finite(*values: float) -> list[float]:
    """Those that are finite, and 0."""
    return [0.0, *(value for value in values if np.isfinite(value))]
