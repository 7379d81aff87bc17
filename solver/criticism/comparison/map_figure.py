"""Measured, model and residual of a pass and its neighbors in time, with the regions that fail."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.regions import Region
from solver.noise.prediction import blocks_of
from solver.run.report.misfit import misfit_of, rows_of
from solver.run.report.misfit_figure import nearest_channel, pass_label, pictures_of
from solver.run.run import Run
from solver.trajectory.vehicle_pass import Pass
from vision.contract.drawing import canvas, color_map, color_scale, place
from vision.contract.figures import INK, styled

Array = NDArray[np.float64]
CELLS = 400  # most rows or columns of a picture
AROUND = 6.0  # seconds before and after a pass that its picture shows


def shown(run: Run, one: Pass) -> Pass:
    """The pass with the fitted samples shortly before and after it among its rows: what else went by is seen there."""
    samples, rows = run.result.samples, rows_of(run.result, one)
    if not len(rows):
        return one
    block = next(b for b in blocks_of(samples) if b.start <= rows[0] < b.stop)
    seconds = run.time[block]
    inside = (seconds >= run.time[rows[0]] - AROUND) & (seconds <= run.time[rows[-1]] + AROUND)
    return replace(one, rows=np.union1d(samples[block][inside], samples[rows]))


def path_of(run: Run, one: Pass) -> tuple[Array, Array]:
    """Time [row], s, and channel [row] nearest to the vehicle, NaN beyond the fitted ones."""
    return run.time[rows_of(run.result, one)], nearest_channel(run.result, one)[np.isin(one.rows, run.result.samples)]


def touches(region: Region, run: Run, number: int) -> tuple[float, float] | None:
    """First and last second of a region in a pass, None where it is elsewhere.

    That is while its vehicle drives by the region's channels, a gauge length before and after included. A region that
    no vehicle made has a time of its own.
    """
    one = run.passes[number]
    seconds, path = path_of(run, one)
    if not len(seconds):
        return None
    if region.time is not None and region.kind == "unseen":
        whole = run.time[rows_of(run.result, shown(run, one))]
        first, last = max(region.time[0], whole[0]), min(region.time[1], whole[-1])
        return (float(first), float(last)) if first <= last else None
    margin = run.facts["settings"]["gauge_length"] / run.facts["settings"]["channel_spacing"]
    by = seconds[(path >= region.channels[0] - margin) & (path <= region.channels[1] + margin)]
    return (float(by[0]), float(by[-1])) if len(by) and one.track_id in region.passes else None


@styled
def map_figure(comparison: Comparison, run: Run, width: int) -> Figure:
    """Measured, model and residual of the pass that fits worst, with the regions that fail, noise sigmas."""
    result = run.result
    number = int(np.nanargmax(misfit_of(result, run.passes).by_pass))
    one = run.passes[number]
    whole = shown(run, one)
    pictures = pictures_of(result, whole, CELLS)
    scale = color_scale(pictures.measured)
    seconds = run.time[rows_of(result, whole)]
    at_time, path = path_of(run, one)
    first, last = result.fitted_channel[[0, -1]]
    span = seconds[-1] - seconds[0]
    across, tall = (width - 60 - 2 * 20 - 70) / 3, 300
    figure = canvas(width, tall + 70)
    for at, (name, picture) in enumerate(vars(pictures).items()):
        axes = place(figure, name, 50 + at * (across + 20), 24, across, tall)
        extent = (first - 0.5, last + 0.5, span, 0.0)
        image = axes.imshow(picture, aspect="auto", extent=extent, cmap=color_map(), norm=scale, interpolation="none")
        axes.plot(path, at_time - seconds[0], color="#222222", lw=0.8, ls=(0, (1, 2.5)))
        axes.set_title(f"{name}, {pass_label(one)}" if at == 0 else name)
        axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="channel", ylabel="time, s" if at == 0 else "")
        if at:
            axes.tick_params(labelleft=False)
    for region in comparison.regions:
        times = touches(region, run, number)
        if times and region.kind != "shape":
            corner = (region.channels[0] - 0.5, times[0] - seconds[0])
            size = (region.channels[1] - region.channels[0] + 1, times[1] - times[0])
            axes.add_patch(Rectangle(corner, *size, fill=False, ec=INK, lw=0.9))
    bar = place(figure, "scale", 50 + 3 * (across + 20) - 8, 24, 10, tall)
    figure.colorbar(image, cax=bar, format="{x:g}").set_label("noise sigmas")
    return figure
