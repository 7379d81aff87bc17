"""Measured, model and residual as pictures, and where the model fails."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm, Colormap, LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from solver.fit.result import FitResult
from solver.run.report.misfit import Misfit, nearest_channel, pass_label, rows_of, whole_range
from solver.run.seen import Seen
from solver.trajectory.vehicle_pass import Pass
from vision.contract.drawing import canvas, coarse, color_map, place
from vision.contract.figures import INK, png_bytes, styled, svg, with_picture
from vision.contract.palette import ROUTE


@dataclass(frozen=True)
class Pictures:
    """One pass as pictures [row, channel], in noise sigmas; NaN where there is no measurement."""

    measured: NDArray[np.float64]
    model: NDArray[np.float64]
    residual: NDArray[np.float64]


def pictures_of(result: FitResult, one: Pass, cells: int) -> Pictures:
    """Pictures of a pass with at most `cells` rows and columns."""
    rows = rows_of(result, one)
    maps = (result.measured[rows], result.model[rows], result.unexplained(rows))
    return Pictures(*(coarse(whole_range(result, part / result.noise), cells) for part in maps))


def wave_pictures(
    run: Seen, one: Pass, pictures: Sequence[NDArray[np.float64]], scale: AsinhNorm, width: int
) -> list[str]:
    """SVG elements of maps [time, channel] of one pass, all in the same axes, which are drawn once.

    Parameters
    ----------
    pictures : as of `Pictures`
    scale : color scale, noise sigmas
    width : of each, CSS pixels
    """
    drawn, colors = svg(wave_figure(run, one, width)), color_map()
    images = (png_bytes(colors(scale(np.ma.masked_invalid(picture)))) for picture in pictures)
    return [with_picture(drawn, image, *map_place(width)) for image in images]


def map_place(width: int) -> tuple[float, float, float, float]:
    """Left, top, width and height of the map in a wave figure, CSS pixels."""
    return 50, 6, width - 62, 0.95 * width - 48


@styled
def wave_figure(run: Seen, one: Pass, width: int) -> Figure:
    """The axes [time, channel] of a map of one pass, to be drawn over it; the dotted line is the vehicle.

    Parameters
    ----------
    width : of the figure, CSS pixels
    """
    result = run.result
    seconds = run.time[rows_of(result, one)]
    step = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0
    first, last = result.fitted_channel[[0, -1]]
    figure = canvas(width, round(0.95 * width))
    axes = place(figure, "map", *map_place(width))
    inside = np.isin(one.rows, result.samples)
    axes.plot(nearest_channel(result, one)[inside], seconds - seconds[0], color="#222222", lw=0.9, ls=(0, (1, 2.5)))
    axes.set(xlabel="channel", ylabel="time, s")
    axes.set(xlim=(first - 0.5, last + 0.5), ylim=(seconds[-1] + step / 2 - seconds[0], -step / 2))
    return figure


@styled
def scale_figure(scale: AsinhNorm, width: int) -> Figure:
    """The color scale of all maps, noise sigmas."""
    figure = canvas(width, 54)
    axes = place(figure, "scale", 12, 4, width - 24, 12)
    top = float(scale.vmax or 1.0)
    edges = scale.inverse(np.linspace(0, 1, 129))
    axes.pcolormesh(edges, [0, 1], (edges[1:] + edges[:-1])[None] / 2, cmap=color_map(), norm=scale, rasterized=True)
    axes.set_xscale("asinh", linear_width=scale.linear_width)
    ticks = [t for t in (1, 3, 10, 30, 100, 300, 1000) if t <= top]
    ticks = [-t for t in reversed(ticks) if t > 1] + [0] + [t for t in ticks if t > 1]
    axes.set(xlim=(-top, top), yticks=[])
    axes.set_xticks(ticks, [f"{t:+d}" if t else "0" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("strain rate, in standard deviations of the noise", labelpad=1)
    return figure


def bare(axes: Axes) -> None:
    """No frame, no ticks."""
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def draw_marginals(top: Axes, right: Axes, result: FitResult, misfit: Misfit, floor: float) -> None:
    """Misfit by channel above, by pass to the right, with the noise floor."""
    per_pass, per_channel = misfit.by_pass, whole_range(result, misfit.by_channel[None])[0]
    channel = np.arange(result.fitted_channel[0], result.fitted_channel[-1] + 1)
    top.fill_between(channel, floor, np.fmax(per_channel, floor), step="mid", color=ROUTE, alpha=0.35, lw=0)
    top.step(channel, per_channel, where="mid", color=ROUTE, lw=1.2)
    top.axhline(floor, color=INK, lw=0.9, ls=(0, (4, 3)))
    top.set(ylim=(0, max(2.0, 1.08 * float(np.nanmax(per_channel)))), ylabel="chi²")
    top.yaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
    top.tick_params(labelbottom=False)
    right.barh(np.arange(len(per_pass)), per_pass, height=0.7, color=ROUTE, alpha=0.55)
    right.axvline(floor, color=INK, lw=0.9, ls=(0, (4, 3)))
    right.set(xlim=(0, max(2.0, 1.3 * float(np.nanmax(per_pass)))), xlabel="chi²")
    right.tick_params(labelleft=False)
    right.xaxis.set_major_locator(MaxNLocator(2, steps=[1, 2, 5, 10]))


@styled
def failure_figure(run: Seen, misfit: Misfit, width: int) -> Figure:
    """Where the model fails: chi2 of each pass in bins of channels; by channel above, by pass to the right.

    Parameters
    ----------
    run, misfit : to draw
    width : of the figure, CSS pixels
    """
    passes, edges, values = run.passes, misfit.edges, misfit.by_pass_and_bin
    left, right = 90, (56 if width < 500 else 130)
    across = width - left - right - 14
    row = max(6, min(24, 480 // len(passes)))
    height = row * len(passes)
    figure = canvas(width, height + 140)
    top = place(figure, "by channel", left, 8, across, 78)
    grid = place(figure, "by pass and channel", left, 94, across, height)
    side = place(figure, "by pass", left + across + 10, 94, right, height)
    floor = run.facts["noise_floor"] or 1.0
    colors = Normalize(floor, max(4.0 * floor, float(np.nanmax(values))))
    extent = (edges[0] - 0.5, edges[-1] - 0.5, len(passes) - 0.5, -0.5)
    grid.imshow(values, aspect="auto", extent=extent, cmap=excess_map(), norm=colors, interpolation="none")
    draw_marginals(top, side, run.result, misfit, floor)
    for axes in (top, grid):
        axes.set_xlim(extent[:2])
    side.set_ylim(grid.get_ylim())
    every = -(-14 // row)
    grid.set_yticks(range(0, len(passes), every), [pass_label(p) for p in passes[::every]])
    grid.set_xlabel("channel")
    bare(grid)
    return figure


def excess_map() -> Colormap:
    """From nothing, so that the page shows through, to the color of the route and then dark."""
    stops = [(0.0, (*to_rgb(ROUTE), 0.0)), (0.6, (*to_rgb(ROUTE), 1.0)), (1.0, (0.35, 0.1, 0.0, 1.0))]
    return LinearSegmentedColormap.from_list("excess", stops).with_extremes(bad="#b5bac0")


def worst(values: NDArray[np.float64], count: int) -> list[int]:
    """Indices, ascending, of the `count` largest values [item], NaN left out.

    >>> worst(np.array([1.0, 5.0, np.nan, 3.0]), 2)
    [1, 3]
    """
    order = np.argsort(np.nan_to_num(values, nan=-np.inf))[::-1]
    return sorted(int(i) for i in order[:count] if np.isfinite(values[i]))
