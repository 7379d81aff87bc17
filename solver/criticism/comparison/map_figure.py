"""Measured, model and residual of a pass and its neighbors in time, with the regions that fail."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.pass_windows import path_of, shown, touches
from solver.run.report.misfit import misfit_of, pass_label, rows_of
from solver.run.report.misfit_figure import pictures_of
from solver.run.run import Run
from vision.contract.drawing import canvas, color_map, color_scale, place
from vision.contract.figures import INK, styled

Array = NDArray[np.float64]
CELLS = 400  # most rows or columns of a picture


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
