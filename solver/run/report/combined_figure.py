"""The figure of a route from several runs: sideways place and depth, each run by itself beside them."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from solver.run.geojson import Z95, half_width
from solver.run.report.route_figure import along_x, draw_line
from vision.contract.drawing import canvas, place
from vision.contract.figures import MUTED, styled
from vision.contract.palette import ROUTE

if TYPE_CHECKING:
    from solver.run.combined import Combined

HEIGHT = 200  # px of each panel
#: Lines of the single runs.
DASHES = ("-", (0, (4, 2)), (0, (1, 1.5)), (0, (4, 1, 1, 1)))


@styled
def combined_figure(combined: "Combined", width: int) -> Figure:
    """Sideways place y and depth over x, or over the distance where the fiber turns back; `width` in CSS pixels."""
    straight = along_x(combined.place.route)
    figure = canvas(width, 2 * HEIGHT + 110)
    panels = [place(figure, name, 70, 20 + i * (HEIGHT + 20), width - 100, HEIGHT) for i, name in enumerate("yz")]
    at = combined.place.route[:, 0] if straight else combined.place.distance
    wide = half_width(combined.place.route, combined.place.covariance)
    for axes, axis, half in zip(panels, (1, 2), (wide, Z95 * combined.place.sigma[:, 2]), strict=True):
        value = combined.place.route[:, axis]
        axes.fill_between(at, value - half, value + half, color=ROUTE, alpha=0.2, lw=0)
        draw_line(axes, at, value, combined.judged.reliable)
        shown = [value - half, value + half]
        for number, (run, told) in enumerate(zip(combined.runs, combined.agreement, strict=True)):
            here = np.isin(run.result.channel, run.problem.channel)
            along = run.result.route[here, 0] if straight else run.result.distance[here]
            line = run.result.route[here, axis]
            shown.append(line)
            axes.plot(along, line, color=MUTED, lw=1, ls=DASHES[number % len(DASHES)], label=told.run)
        low, high = (f(np.concatenate(shown)) for f in (np.nanmin, np.nanmax))
        axes.set_ylim(high + 0.1, low - 0.1)
    panels[0].set_ylabel("y, m (right is down)")
    panels[1].set_ylabel("depth, m")
    panels[0].set_xticklabels([])
    panels[1].set_xlabel("x, m" if straight else "along the fiber, m")
    panels[0].legend(loc="best", frameon=False, fontsize=9)
    return figure
