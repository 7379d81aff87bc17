"""The waterfall of a record, without regard to traffic: what was recorded, when, and on which channel."""

from typing import TYPE_CHECKING

import numpy as np

from solver.survey.das.record import channel_ranges
from solver.survey.survey_figure import draw_record, in_sigmas
from vision.contract.drawing import canvas, place
from vision.contract.figures import INK, styled
from vision.contract.palette import ROUTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from solver.survey.das.record import DASRecord

WIDTH, HEIGHT, BESIDE = 1200, 560, 110  # px
LEFT, TOP, UNDER, LINE = 66, 34, 50, 15  # px
LETTERS = 190  # of a line below


@styled
def waterfall(record: "DASRecord") -> "Figure":
    """Draw a record.

    Parameters
    ----------
    record : all or any part of it

    Returns
    -------
    figure : strain rate in sigmas of each channel's noise over time and channel, the noise beside it, and below what
        is left out and why
    """
    dead = record.channel[record.dead]
    lines = [f"no signal (excluded, or never changing) on {channel_ranges(dead)}"] if len(dead) else []
    lines = [line if len(line) < LETTERS else f"{line[:LETTERS]} ..." for line in (*lines, *record.cautions)]
    figure = canvas(WIDTH, TOP + HEIGHT + UNDER + LINE * len(lines))
    left = place(figure, "record", LEFT, TOP, WIDTH - LEFT - BESIDE - 60, HEIGHT)
    draw_record(left, record, in_sigmas(record.strain_rate))
    left.set_xlabel(f"s since {str(record.start)[:23].replace('T', ' ')} UTC")
    right = place(figure, "noise", WIDTH - BESIDE - 12, TOP, BESIDE, HEIGHT)
    some = record.strain_rate[:: max(1, len(record.time) // 1000)]
    alive = ~record.dead & np.isfinite(some).any(0)
    level = 1.4826e9 * np.nanmedian(np.abs(some[:, alive]), 0)
    right.plot(level, record.channel[alive], color=ROUTE, lw=0.8)
    right.set(title="Noise, nm/m/s", yticks=[], xlim=(0, None))
    right.set_ylim(left.get_ylim())
    bottom = 1 - (TOP + HEIGHT + UNDER - 4) / (figure.get_figheight() * figure.dpi)
    for number, line in enumerate(lines):
        y = bottom - number * LINE / (figure.get_figheight() * figure.dpi)
        figure.text(LEFT / WIDTH, y, line, color=INK, fontsize=8, va="top")
    return figure
