"""The pictures of a comparison, in the style of the report."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from solver.criticism.comparison.comparison import Comparison
from solver.criticism.comparison.comparison_words import NAMES
from solver.criticism.comparison.power import Powers, Spectrum
from solver.criticism.comparison.split import SOURCES
from solver.criticism.comparison.stack import Stack
from solver.run.report.misfit import pass_label, whole_range
from solver.run.report.misfit_figure import bare, excess_map, worst
from solver.run.run import Run
from vision.contract.drawing import canvas, color_map, place
from vision.contract.figures import INK, MUTED, styled
from vision.contract.palette import BACKWARD, FORWARD, ROUTE

Array = NDArray[np.float64]
MOST_ROWS = 24  # of bars in one panel
DASHED = (0, (4, 3))


@styled
def split_figure(comparison: Comparison, width: int) -> Figure:
    """Whose the misfit is, as shares of what lies above the noise."""
    split = comparison.split
    above = max(split.chi2 - split.noise, 1e-300)
    names = [NAMES[source] for source in SOURCES] + ["none of these"]
    shares = 100 * np.array([*(split.explained[source] for source in SOURCES), split.unexplained]) / above
    row = 26
    figure = canvas(width, row * len(names) + 44)
    left = 120 if width < 500 else 190
    axes = place(figure, "shares", left, 4, width - left - (20 if width < 500 else 130), row * len(names))
    colors = [FORWARD, FORWARD, BACKWARD, BACKWARD, ROUTE, MUTED]
    axes.barh(range(len(names)), shares, height=0.62, color=colors, alpha=0.8)
    for at, share in enumerate(shares):
        percent = 100 * share / 100 * above / split.chi2
        text = f"{share:.0f} %" if share >= 0.5 else "0"
        axes.text(share + 1, at, f"{text}  ({percent:.1f} % of chi²)" if share >= 0.5 else text, va="center")
    axes.set_yticks(range(len(names)), names, color=INK)
    axes.set(xlim=(0, 100), ylim=(len(names) - 0.5, -0.5), xlabel="share of the misfit above the noise, %")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return figure


# ---- in the vehicle's frame ------------------------------------------------------------------------------------------


def draw_residual(axes: Axes, stack: Stack, group: int) -> None:
    """Residual with its band of two sigmas."""
    axes.fill_between(stack.ahead, -2 * stack.sigma[group], 2 * stack.sigma[group], color=MUTED, alpha=0.2, lw=0)
    axes.plot(stack.ahead, stack.residual[group], color=ROUTE, lw=1.4)


def draw_parts(axes: Axes, stack: Stack, group: int) -> None:
    """Symmetric and antisymmetric part of the residual."""
    band = 2 * stack.sigma[group] / np.sqrt(2)
    axes.fill_between(stack.ahead, -band, band, color=MUTED, alpha=0.2, lw=0)
    axes.plot(stack.ahead, stack.symmetric[group], color=FORWARD, lw=1.4, label="symmetric")
    axes.plot(stack.ahead, stack.antisymmetric[group], color=ROUTE, lw=1.4, ls=DASHED, label="antisymmetric")


def draw_shapes(axes: Axes, stack: Stack, group: int) -> None:
    """Measured and model."""
    axes.plot(stack.ahead, stack.measured[group], color=INK, lw=1.6, alpha=0.55, label="measured")
    axes.plot(stack.ahead, stack.model[group], color=ROUTE, lw=1.2, ls=DASHED, label="model")


@styled
def stack_figure(stack: Stack, width: int) -> Figure:
    """Measured and model, residual, and its two parts, by channel group, against the distance ahead of the vehicle."""
    narrow = width < 500
    rows = 1 if narrow else len(stack.channels)
    columns = (draw_shapes, draw_residual, draw_parts)
    gap, left, tall = 46, 44, 92
    across = width - left - 8 if narrow else (width - left - 8 - 2 * gap) / 3
    down = tall + 22
    figure = canvas(width, (3 if narrow else 1) * (rows * down + 40) + 6)
    limits = [_limit(stack.measured, stack.sigma), *[_limit(stack.residual, stack.sigma)] * 2]
    titles = ("measured and model", "residual, with two sigmas of noise", "its two parts")
    for column, (draw, limit) in enumerate(zip(columns, limits, strict=True)):
        for row in range(rows):
            top = (column * (rows * down + 40) if narrow else 0) + row * down + 18
            axes = place(
                figure, f"{column} {row}", left + (0 if narrow else column * (across + gap)), top, across, tall
            )
            draw(axes, stack, row)
            axes.axhline(0, color=MUTED, lw=0.6)
            axes.axvline(0, color=MUTED, lw=0.6, ls=(0, (1, 2)))
            axes.set(xlim=(stack.ahead[0], stack.ahead[-1]), ylim=(-limit, limit))
            first, last = stack.channels[row]
            who = f"all, {first}-{last}" if row == 0 else f"channels {first}-{last}"
            axes.set_title(f"{who}: {titles[column]}" if row == 0 else who, fontsize=8.5, pad=3)
            axes.yaxis.set_major_locator(MaxNLocator(3))
            axes.tick_params(labelbottom=row == rows - 1)
            if row == rows - 1:
                axes.set_xlabel("distance ahead of the vehicle, m")
            if row == 0 and column != 1:
                axes.legend(frameon=False, fontsize=8, loc="upper right", handlelength=1.6, borderpad=0)
    return figure


def _limit(residual: Array, sigma: Array) -> float:
    there = np.isfinite(residual) & np.isfinite(sigma)
    return 1.1 * max(float(np.median(sigma[there])) * 5, float(np.abs(residual[there]).max())) if there.any() else 1.0


# ---- power -----------------------------------------------------------------------------------------------------------


def draw_powers(axes: Axes, powers: Powers, floor: float, title: str) -> None:
    """Chi2 per sample of each value of a property, with two sigmas of noise around the floor."""
    shown = worst(powers.chi2, MOST_ROWS)
    values, sigma = powers.chi2[shown], powers.sigma[shown]
    at = np.arange(len(shown))
    axes.hlines(at, floor, values, color=ROUTE, lw=3, alpha=0.35)
    axes.errorbar(values, at, xerr=2 * sigma, fmt="o", color=ROUTE, ms=4, lw=0.9)
    axes.axvline(floor, color=INK, lw=0.9, ls=DASHED)
    axes.set_yticks(at, [powers.labels[i] for i in shown])
    top = max(floor * 1.3, float(np.nanmax(values + 2 * sigma, initial=floor)) * 1.05)
    low = min(floor * 0.9, float(np.nanmin(values - 2 * sigma, initial=floor)) * 0.98)
    axes.set(xlim=(low, top), ylim=(len(shown) - 0.4, -0.6))
    axes.set_title(title)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)


@styled
def channel_figure(comparison: Comparison, run: Run, width: int) -> Figure:
    """Chi2 per sample by channel, and near each vehicle by pass and channel."""
    result, power, passes = run.result, comparison.power, run.passes
    left, row = 100, max(6, min(20, 400 // len(passes)))
    tall = row * len(passes)
    figure = canvas(width, 100 + tall + 76)
    top = place(figure, "by channel", left, 6, width - left - 10, 84)
    grid = place(figure, "by pass and channel", left, 100, width - left - 10, tall)
    channel = np.arange(result.fitted_channel[0], result.fitted_channel[-1] + 1)
    floor, chi2 = (whole_range(result, values[None])[0] for values in (comparison.noise, power.channel.chi2))
    top.fill_between(channel, floor, np.fmax(chi2, floor), step="mid", color=ROUTE, alpha=0.35, lw=0)
    top.step(channel, chi2, where="mid", color=ROUTE, lw=1.2)
    top.step(channel, floor, where="mid", color=INK, lw=0.9, ls=DASHED)
    top.set(ylim=(0, max(2.0, 1.08 * float(np.nanmax(chi2)))), ylabel="chi² per sample")
    top.tick_params(labelbottom=False)
    values = whole_range(result, power.by_pass_and_channel)
    extent = (channel[0] - 0.5, channel[-1] + 0.5, len(passes) - 0.5, -0.5)
    most = max(4.0, float(np.nanquantile(values, 0.995))) if np.isfinite(values).any() else 4.0
    level = comparison.level
    picture = grid.imshow(
        values, aspect="auto", extent=extent, cmap=excess_map(), vmin=level, vmax=most, interpolation="none"
    )
    every = -(-12 // row)
    grid.set_yticks(range(0, len(passes), every), [pass_label(one) for one in passes[::every]])
    grid.set_xlabel("channel")
    bare(grid)
    for axes in (top, grid):
        axes.set_xlim(extent[:2])
    bar = place(figure, "scale", left, 100 + tall + 44, min(220, width - left - 130), 8)
    figure.colorbar(picture, cax=bar, orientation="horizontal")
    bar.spines[:].set_visible(False)
    bar.text(1.03, 0.5, "chi² per sample near the vehicle", transform=bar.transAxes, va="center", color=MUTED)
    return figure


@styled
def power_figure(comparison: Comparison, run: Run, width: int) -> Figure:
    """Chi2 per sample by pass, speed, class, lane and distance of the vehicle."""
    power, floor, narrow = comparison.power, comparison.level, width < 500
    columns = [
        [(power.one_pass, "by pass")],
        [(power.speed, "by speed"), (power.vehicle_class, "by class")],
        [(power.lane, "by lane"), (power.gap, "by distance of the vehicle")],
    ]
    stacked = [[panel for column in columns for panel in column]] if narrow else columns
    margins = [190] if narrow else [90, 80, 190]
    heights = [sum(20 * min(len(p.labels), MOST_ROWS) + 62 for p, _ in column) for column in stacked]
    figure = canvas(width, max(heights) + 20)
    left = 0.0
    share = (width - sum(margins) - 14 * len(stacked)) / len(stacked)
    for column, margin in zip(stacked, margins, strict=True):
        top = 22
        for powers, title in column:
            tall = 20 * min(len(powers.labels), MOST_ROWS) + 6
            draw_powers(place(figure, title, left + margin, top, share, tall), powers, floor, title)
            top += tall + 56
        left += margin + share + 14
    return figure


@styled
def spectrum_figure(spectrum: Spectrum, run: Run, width: int) -> Figure:
    """Power of the whitened residual by frequency and wavenumber, 1 = noise, with the vehicles' speeds as lines."""
    narrow = width < 500
    left, wide = 52, (width - 66 if narrow else width * 0.42)
    tall = 250
    figure = canvas(width, (tall + 70) * (2 if narrow else 1) + (60 if narrow else 10))
    axes = place(figure, "spectrum", left, 18, wide, tall)
    top = max(4.0, float(spectrum.power.max()))
    scale = LogNorm(min(0.5, 1 / top), top)
    mesh = axes.pcolormesh(
        spectrum.wavenumber,
        spectrum.frequency,
        np.maximum(spectrum.power, 1e-6),
        norm=scale,
        cmap=color_map(),
        rasterized=True,
    )
    speeds = [abs(one.speed) for one in run.passes]
    most = spectrum.frequency[-1]
    for speed in (min(speeds), max(speeds)):
        axes.plot([-most / speed, 0, most / speed], [most, 0, most], color=INK, lw=0.8, ls=(0, (1, 2)))
    ends = (spectrum.wavenumber[0], spectrum.wavenumber[-1])
    axes.set(
        xlim=ends, ylim=(0, most), xlabel="wavenumber, 1/m; right: moves with the vehicles", ylabel="frequency, Hz"
    )
    axes.set_title("power against the noise's")
    bar = place(
        figure,
        "scale",
        left + wide + 8 if not narrow else left,
        18 if not narrow else tall + 66,
        *((9, tall) if not narrow else (wide, 8)),
    )
    figure.colorbar(mesh, cax=bar, orientation="horizontal" if narrow else "vertical", format="{x:g}")
    bar.xaxis.set_minor_formatter("")
    bar.yaxis.set_minor_formatter("")
    bar.spines[:].set_visible(False)
    start = left + wide + 110 if not narrow else left
    down = 18 if not narrow else tall + 120
    across, high = (width - start - 12, (tall - 62) / 2)
    plots = (
        (spectrum.frequency, spectrum.by_frequency, "frequency, Hz"),
        (spectrum.wavenumber, spectrum.by_wavenumber, "wavenumber, 1/m"),
    )
    for number, (at, values, name) in enumerate(plots):
        panel = place(figure, name, start, down + number * (high + 62), across, high)
        panel.plot(at, values, color=ROUTE, lw=1.4)
        panel.axhline(1, color=INK, lw=0.9, ls=DASHED)
        panel.set(
            xlim=(at[0], at[-1]), ylim=(0, 1.08 * max(1.8, float(values.max()))), xlabel=name, ylabel="power / noise"
        )
    return figure


def figures_of(comparison: Comparison, run: Run, width: int) -> dict[str, Figure]:
    """All pictures by name but the maps, which the page draws itself."""
    return {
        "split": split_figure(comparison, width),
        "stack": stack_figure(comparison.stack, width),
        "channels": channel_figure(comparison, run, width),
        "power": power_figure(comparison, run, width),
        "spectrum": spectrum_figure(comparison.power.spectrum, run, width),
    }
