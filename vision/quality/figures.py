"""Pictures of tracks' quality: jitter by place, effect on the route, detected classes in space and time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vision.contract.figures import DPI, MUTED, styled
from vision.jitter import LIMIT
from vision.quality.drawing import BLUE, ORANGE, RED, class_color, fitted, panels
from vision.quality.measures import Measures
from vision.quality.route_effect import FEWEST
from vision.quality.setting import Setting

if TYPE_CHECKING:
    import pandas as pd

WIDE, NARROW = 1060, 350  # px
HIGH = 200  # px, of a panel
BESIDE = 50  # px, that the labels of an axis take
PER_ENTRY = 150  # px, that an entry of a legend takes
DETAIL = 12  # points of a line between two changes of class; more would not be visible


def columns(width: int) -> int:
    """How many panels stand beside each other."""
    return 2 if width > 2 * NARROW else 1


def panel_width(width: int) -> float:
    """Width of a panel without its labels, px."""
    return width / columns(width) - BESIDE


@styled
def jitter_figure(found: Sequence[Measures], width: int = WIDE) -> Figure:
    """Jitter by bin along x, mean and standard deviation, before and after interpolation, with the 35 cm line."""
    figure, axes = panels(len(found), width, HIGH, columns(width))
    unit = found[0].setting.unit
    for one, ax in zip(found, axes, strict=True):
        half = float(one.after["high"].iloc[0] - one.after["low"].iloc[0]) / 2
        for bins, color, label, side in (
            (one.before, ORANGE, "before interpolation", -0.15),
            (one.after, BLUE, "after", 0.15),
        ):
            middle = bins["low"] + half * (1 + side)
            ax.errorbar(middle, bins["mean"], bins["sd"], fmt="o", ms=4, lw=1.1, capsize=2, color=color, label=label)
        if unit == "m":
            ax.axhline(LIMIT, color=RED, lw=1, ls="--", label=f"{100 * LIMIT:.0f} cm")
        ax.set_title(fitted(one.setting.name, panel_width(width)))
    known = [bins[bins["fixes"] >= FEWEST] for m in found for bins in (m.before, m.after)]
    tallest = max(float((bins["mean"] + bins["sd"]).to_numpy().max(initial=0.0)) for bins in known)
    axes[0].set_ylim(0, max(1.1 * tallest, 1.3 * LIMIT if unit == "m" else 0.0) or 1.0)
    label_axes(figure, axes, f"x, {unit}", f"jitter, {unit}")
    legend(figure, axes[0])
    return figure


@styled
def route_figure(found: Sequence[Measures], width: int = WIDE) -> Figure:
    """Predicted standard deviation of the route by bin along x: from noise alone, and as stated."""
    figure, axes = panels(len(found), width, HIGH, columns(width))
    for one, ax in zip(found, axes, strict=True):
        effect = one.effect
        if effect is None:
            continue
        known = effect[effect["passes"] > 0]
        for axis, color in (("x", ORANGE), ("y", BLUE)):
            way = {"x": "along", "y": "sideways"}[axis]
            ax.fill_between(
                (known["low"] + known["high"]) / 2, known[f"route_{axis}"], known[f"stated_{axis}"],
                color=color, alpha=0.18, lw=0,
            )  # fmt: skip
            middle = (known["low"] + known["high"]) / 2
            ax.plot(middle, known[f"stated_{axis}"], color=color, lw=1.6, label=f"{way}, as stated")
            ax.plot(middle, known[f"route_{axis}"], color=color, lw=1, ls=":", label=f"{way}, noise alone")
        for _, row in known.iterrows():
            ax.annotate(
                f"{row['passes']:.0f}", ((row["low"] + row["high"]) / 2, 1), (0, -2), ha="center", va="top",
                xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=7.5, color=MUTED,
            )  # fmt: skip
        ax.set_title(fitted(one.setting.name, panel_width(width)))
    # Limits for all panels, as they share the axis: values beyond would spill into the next panel.
    reach = [effect[effect["passes"] > 0] for one in found if (effect := one.effect) is not None]
    edges = np.concatenate([part[["low", "high"]].to_numpy().ravel() for part in reach])
    if len(edges):
        axes[0].set_xlim(edges.min(), edges.max())
    axes[0].set_ylim(0, 1.2 * axes[0].get_ylim()[1])
    label_axes(figure, axes, "x, m (small figures: vehicles that passed)", "1 sigma of the route, m")
    legend(figure, axes[0])
    return figure


@styled
def class_figure(settings: Sequence[Setting], width: int = WIDE) -> Figure:
    """Every track as a line in x and time, in the color of what was detected; a dot where that changes."""
    figure, axes = panels(len(settings), width, 300, columns(width))
    names = sorted({name for s in settings for name in s.tracks["detected_class"].unique() if name})
    for setting, ax in zip(settings, axes, strict=True):
        draw_classes(setting, ax)
        ax.set_title(fitted(setting.name, panel_width(width)))
    axes[0].set_ylim(*span([setting.tracks["time"] for setting in settings])[::-1])
    axes[0].set_xlim(*span([setting.tracks["x"] for setting in settings]))
    label_axes(figure, axes, f"x, {settings[0].unit}", "time, s")
    handles = [ax_line(axes[0], class_color(name), name) for name in names]
    if names:
        legend(figure, axes[0], handles)
    return figure


def span(columns: Sequence["pd.Series"]) -> tuple[float, float]:
    """Lowest and highest value, at least 1 apart."""
    low, high = min(float(c.min()) for c in columns), max(float(c.max()) for c in columns)
    return low, max(high, low + 1.0)


def legend(figure: Figure, ax: Axes, handles: Sequence[Artist] | None = None) -> None:
    """Explain the lines of `ax` above the panels, in as many columns as there is room for."""
    shown = ax.get_legend_handles_labels()[0] if handles is None else handles
    room = round(figure.get_figwidth() * DPI / PER_ENTRY)
    figure.legend(handles=shown, loc="outside upper left", ncols=min(len(shown), max(room, 1)))


def ax_line(ax: Axes, color: str, label: str) -> LineCollection:
    """Swatch for the legend."""
    return LineCollection([], colors=[color], linewidths=2, label=label)


def draw_classes(setting: Setting, ax: Axes) -> None:
    """Draw the tracks of a setting as lines colored by the detected class."""
    seen = setting.tracks[~setting.tracks["missed"]]
    lines, colors, changed = [], [], []
    for _, track in seen.groupby("track_id", sort=True):
        place = track[["x", "time"]].to_numpy(float)
        label = track["detected_class"].to_numpy()
        cuts = np.flatnonzero(label[1:] != label[:-1]) + 1
        changed.append(place[cuts])
        for first, stop in zip([0, *cuts], [*cuts, len(place)], strict=True):
            lines.append(thinned(place[first : stop + 1]))
            colors.append(class_color(label[first]))
    ax.add_collection(LineCollection(lines, colors=colors, linewidths=1.6))
    dots = np.concatenate(changed) if changed else np.zeros((0, 2))
    ax.plot(*dots.T, ".", ms=3, color=MUTED)


def thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most `DETAIL` of the points, first and last among them.

    >>> thinned(np.arange(200.0).reshape(100, 2))[[0, -1]].tolist()
    [[0.0, 1.0], [198.0, 199.0]]
    """
    return points[np.unique(np.linspace(0, len(points) - 1, DETAIL).round().astype(int))]


def label_axes(figure: Figure, axes: Sequence[Axes], across: str, up: str) -> None:
    """Label the figure's axes once, and let panels above others keep their ticks' labels off."""
    figure.supxlabel(across, fontsize=9, color=MUTED)
    figure.supylabel(up, fontsize=9, color=MUTED)
    for ax in axes:
        ax.margins(x=0.02)
