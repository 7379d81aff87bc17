"""The picture of a survey before anything is fitted: the record in noise sigmas, the tracks, the anchors."""

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solver.survey.das.record import channel_ranges
from vision.contract.drawing import canvas, coarse, color_map, color_scale, place
from vision.contract.figures import INK, MUTED, PAPER, styled, svg
from vision.contract.palette import BACKWARD, FORWARD, ROUTE

if TYPE_CHECKING:
    from solver.survey.das.record import DASRecord
    from solver.survey.survey import Survey

WIDTH, WATERFALL, ROAD = 960, 320, 150  # px
LEFT, TOP, BETWEEN, LINE = 66, 34, 54, 15  # px
#: Most rows or columns of the picture, and most tracks drawn.
CELLS, TRACKS = 800, 300
#: Standard deviation over median absolute deviation of normal noise.
NORMAL = 1.4826

Array = NDArray[np.float64]


def in_sigmas(strain_rate: Array) -> Array:
    """A record [time, channel] divided by each channel's noise; NaN where nothing was measured.

    Noise is estimated from the median absolute deviation: most of the time no vehicle is near a channel.

    >>> rate = np.random.default_rng(0).normal(0, 3e-9, (4000, 2)) + 1e-8
    >>> bool(np.allclose(in_sigmas(rate).std(0), 1, atol=0.05))
    True
    """
    found = np.full(strain_rate.shape, np.nan)
    for column in np.flatnonzero(np.isfinite(strain_rate).any(axis=0)):
        values = strain_rate[:, column] - np.nanmedian(strain_rate[:, column])
        sigma = NORMAL * float(np.nanmedian(np.abs(values)))
        # If most samples are rounded to one number, their standard deviation tells more.
        found[:, column] = values / (sigma or float(np.nanstd(values)) or 1.0)
    return found


def on_fiber(survey: "Survey") -> Callable[[Array], Array] | None:
    """Channel at a place along the road, by a straight line through the anchors; None with fewer than two."""
    x = np.array([one.x for one in survey.anchors])
    if len(x) < 2 or np.ptp(x) < survey.record.gauge_length:
        return None
    slope, offset = np.polyfit(x, [one.channel for one in survey.anchors], 1)
    return lambda along: offset + slope * along


def left_out(survey: "Survey") -> list[str]:
    """Parts of the record that cannot be used, and why; a line each."""
    record = survey.record
    dead = record.channel[record.dead]
    lines = [f"no signal (excluded, or never changing) on {channel_ranges(dead)}"] if len(dead) else []
    return [*lines, *record.cautions, *record.provenance["notes"]]


def draw_record(axes: Axes, record: "DASRecord", sigmas: Array) -> None:
    """The waterfall of a record [time, channel] in sigmas of its noise: time to the right, channels upward."""
    step, scale, colors = float(np.median(np.diff(record.time))), color_scale(sigmas), color_map()
    # Time that was not read looks like samples that were not measured.
    axes.set_facecolor(tuple(colors.get_bad().tolist()))
    ends = (float(record.channel[0]) - 0.5, float(record.channel[-1]) + 0.5)
    for rows in record.windows:
        image = axes.imshow(
            coarse(sigmas[rows], CELLS).T,
            aspect="auto",
            origin="lower",
            extent=(record.time[rows][0], record.time[rows][-1] + step, *ends),
            cmap=colors,
            norm=scale,
            interpolation="nearest",
        )
    axes.set(ylabel="channel", title="Strain rate, in sigmas of each channel's noise")
    axes.set_xlim(record.time[0], record.time[-1] + step)
    figure = axes.get_figure()
    assert figure is not None
    figure.colorbar(image, ax=axes, fraction=0.03, pad=0.01, ticks=[-10, -3, 0, 3, 10], format="%g")


def draw_tracks(axes: Axes, survey: "Survey", place_of: Callable[[Array], Array] | None = None) -> None:
    """Vehicle positions over time: along the road, colored by direction, or dashed at the channels from `place_of`."""
    assert survey.tracks is not None
    for _, track in list(survey.tracks.groupby("track_id", sort=False))[:TRACKS]:
        t = (track["time"].dt.tz_convert(None) - survey.record.start).dt.total_seconds()
        x = track["x"].to_numpy(float)
        if place_of is None:
            axes.plot(t, x, color=FORWARD if x[-1] >= x[0] else BACKWARD, lw=1.2)
        else:
            axes.plot(t, place_of(x), color=INK, lw=1.0, ls=(0, (4, 3)))


@styled
def survey_figure(survey: "Survey") -> Figure:
    """Draw a survey.

    Parameters
    ----------
    survey : to draw

    Returns
    -------
    figure : the record in noise sigmas over time and channel, with anchors, and with tracks where two anchors say
        which channel is where; the tracks along the road; below, what is left out and why
    """
    lines = left_out(survey)
    figure = canvas(WIDTH, TOP + WATERFALL + BETWEEN + ROAD + 50 + LINE * len(lines))
    across = WIDTH - LEFT - 34
    upper = place(figure, "record", LEFT, TOP, across, WATERFALL)
    draw_record(upper, survey.record, in_sigmas(survey.record.strain_rate))
    room = upper.get_position()
    lower = place(figure, "road", LEFT, TOP + WATERFALL + BETWEEN, WIDTH * room.width, ROAD)
    first, last = survey.record.channel[[0, -1]]
    to_channel = on_fiber(survey)
    for one in survey.anchors:
        upper.axhline(one.channel, color=ROUTE, lw=1)
        said = upper.annotate(one.name, (0, one.channel), (3, 3), textcoords="offset points", color=INK, fontsize=8)
        said.set_bbox({"facecolor": PAPER, "edgecolor": "none", "pad": 0.8, "alpha": 0.85})
        lower.axhline(one.x, color=ROUTE, lw=1)
    if survey.tracks is None:
        lower.text(0.5, 0.5, "the video is not tracked yet", transform=lower.transAxes, ha="center", color=MUTED)
    else:
        draw_tracks(lower, survey)
        if to_channel is not None:
            draw_tracks(upper, survey, to_channel)
            upper.set_title("Strain rate, in sigmas of each channel's noise; dashed: tracks, as the anchors place them")
    upper.set_ylim(first - 0.5, last + 0.5)
    for axes in (upper, lower):
        axes.set_xlim(survey.record.time[0], survey.record.time[-1])
    start = str(survey.record.start)[:19].replace("T", " ")
    lower.set(ylabel="x, m", xlabel=f"s since {start} UTC", title="Vehicles along the road")
    bottom = 1 - (TOP + WATERFALL + BETWEEN + ROAD + 44) / (figure.get_figheight() * figure.dpi)
    for number, line in enumerate(lines):
        y = bottom - number * LINE / (figure.get_figheight() * figure.dpi)
        figure.text(LEFT / WIDTH, y, line, color=INK, fontsize=8, va="top")
    return figure


def survey_html(survey: "Survey") -> str:
    """The survey as a part of a page."""
    return (
        f"<p>{escape(repr(survey)[1:-1])}</p>"
        f'<div style="max-width:{WIDTH}px;--ink:#1f2933;--muted:#66707a;--rule:#d5dae0;--paper:#fefefe">'
        f"{svg(survey_figure(survey))}</div>"
    )
