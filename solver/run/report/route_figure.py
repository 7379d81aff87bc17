"""The map: the road from above, the fiber's sideways position and its depth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from solver.fit.result import Corner
from solver.run.geojson import Z95, corridor_ring, half_width, normals, runs
from solver.run.run import Run
from solver.trajectory.vehicle_pass import Pass
from vision.contract.drawing import canvas, place
from vision.contract.figures import INK, MUTED, PAPER, styled
from vision.contract.palette import BACKWARD, FORWARD, ROUTE

MARGIN = 5.0  # m of road shown beyond either end of the route
LATERAL_SPAN = 1.2  # m, least height of the sideways panel
PANEL = 130  # px, height of the two lower panels
LABEL = 20  # px, room for an anchor's name
POINTS = 200  # most points drawn of one track
WIDE_ALPHA, FIT_ALPHA = 0.25, 0.3  # of the corridor, and of the fit's own within it

Limits = tuple[float, float]


def along_x(route: NDArray[np.float64]) -> bool:
    """Whether a route [channel, 3] keeps on along x, so that x can stand for the place on the fiber."""
    step = np.diff(route[:, :2], axis=0)
    length = np.linalg.norm(step, axis=1)
    return bool((step[:, 0] > 0.5 * length).all() or (step[:, 0] < -0.5 * length).all())


def abscissa(run: Run, straight: bool | None = None) -> NDArray[np.float64]:
    """Horizontal coordinate [channel] of the two lower panels, m: x where `straight`, by default where it keeps on."""
    straight = along_x(run.result.route) if straight is None else straight
    return run.result.route[:, 0] if straight else run.result.distance


def padded(values: NDArray[np.float64], pad: float, least: float = 0.0) -> Limits:
    """Range of finite values, widened by `pad` on both sides and to `least` in all."""
    low, high = float(np.nanmin(values)) - pad, float(np.nanmax(values)) + pad
    more = max(0.0, least - (high - low)) / 2
    return low - more, high + more


def same_scale(x: Limits, y: Limits, width: float, lowest: float, highest: float) -> tuple[Limits, Limits, float]:
    """Widen the ranges x or y, m, so that both have one scale in a panel `width` px wide; also its height, px.

    >>> same_scale((0.0, 100.0), (0.0, 10.0), 1000.0, 50.0, 500.0)
    ((0.0, 100.0), (0.0, 10.0), 100.0)
    """
    scale = width / (x[1] - x[0])
    height = min(max((y[1] - y[0]) * scale, lowest), highest)
    scale = min(scale, height / (y[1] - y[0]))
    grow_x, grow_y = (width / scale - (x[1] - x[0])) / 2, (height / scale - (y[1] - y[0])) / 2
    return (x[0] - grow_x, x[1] + grow_x), (y[0] - grow_y, y[1] + grow_y), height


def draw_track(axes: Axes, one: Pass, window: Limits) -> None:
    """One vehicle's way: solid where it was seen, dotted where it is extrapolated, an arrow where it goes."""
    color = FORWARD if one.speed > 0 else BACKWARD
    shown = (one.position[:, 0] > window[0]) & (one.position[:, 0] < window[1])
    for first, last in runs(one.in_view):
        part = slice(first, last + 2, max(1, (last + 1 - first) // POINTS))
        if one.in_view[first]:
            axes.plot(*one.position[part].T, color=color, lw=0.9, alpha=0.85)
        else:
            axes.plot(*one.position[part].T, color=color, lw=0.8, alpha=0.7, ls=(0, (1, 2)))
    if shown.any():
        middle = np.flatnonzero(shown)[shown.sum() // 2]
        tail, tip = one.position[middle], one.position[middle] + 0.1 * one.velocity[middle]
        arrow = {"arrowstyle": "-|>", "color": color, "lw": 0.9, "mutation_scale": 9}
        axes.annotate("", xy=tip, xytext=tail, arrowprops=arrow)


def draw_line(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], sure: NDArray[np.bool_]) -> None:
    """The fiber: solid where it may be relied on, dashed where assumptions decide or a check failed."""
    for first, last in runs(sure):
        part = slice(first, last + 2)
        axes.plot(x[part], y[part], color=ROUTE, lw=2.0, ls="-" if sure[first] else (0, (2.5, 1.5)), zorder=4)


def draw_anchors(
    axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], half: NDArray[np.float64] | None = None
) -> None:
    """Anchors, with their own 95 % bars where `half` gives them."""
    axes.errorbar(x, y, yerr=half, fmt="s", ms=6, mfc=PAPER, mec=INK, mew=1.4, ecolor=INK, elinewidth=1.2, zorder=5)


def draw_corners(axes: Axes, corners: Sequence[Corner], x: ArrayLike, y: ArrayLike) -> None:
    """Corners of the fiber as diamonds; steps in depth as triangles that point the way it goes."""
    for corner, *at in zip(corners, np.asarray(x), np.asarray(y), strict=True):
        marker = "D" if corner.kind == "corner" else "v" if corner.amount > 0 else "^"
        axes.plot(*at, marker, ms=7, mfc="none", mec=INK, mew=1.2, zorder=5)


def draw_north(axes: Axes, x_azimuth: float) -> None:
    """Arrow to the north above the upper right corner; +x points right, x_azimuth degrees clockwise from north."""
    angle = np.deg2rad(x_azimuth)
    way = 10 * np.array([np.cos(angle), np.sin(angle)])
    center = np.add(axes.transAxes.transform((1.0, 1.0)), (-26, 18))
    tail, tip, letter = axes.transAxes.inverted().transform([center - way, center + way, center + 1.7 * way])
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.4, "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip, tail, "axes fraction", arrowprops=arrow, annotation_clip=False)
    axes.text(letter[0], letter[1], "N", transform=axes.transAxes, ha="center", va="center", weight="bold")


def draw_scale(axes: Axes) -> None:
    """A bar of a round length above the upper left corner, about a sixth of the panel or less."""
    low, high = axes.get_xlim()
    most = (high - low) / 6
    step = 10.0 ** np.floor(np.log10(most))
    length = next(step * times for times in (5, 2, 1) if step * times <= most)
    across = axes.transAxes.inverted().transform(axes.transAxes.transform((0.0, 1.0)) + np.array([0.0, 18.0]))[1]
    last = 0.86
    first = last - length / (high - low)
    axes.annotate(
        "",
        (last, across),
        (first, across),
        "axes fraction",
        "axes fraction",
        arrowprops={"arrowstyle": "|-|, widthA=.25, widthB=.25", "color": INK, "lw": 1.4, "shrinkA": 0, "shrinkB": 0},
        annotation_clip=False,
    )
    axes.text(first - 0.008, across, f"{length:g} m", transform=axes.transAxes, ha="right", va="center")


def draw_plan(axes: Axes, run: Run, window: Limits) -> None:
    """The road from above; y grows downward, as it does to the right of +x."""
    result = run.result
    axes.axhline(0.0, color=MUTED, lw=0.6, ls=(0, (6, 4)), zorder=0)
    for one in run.passes:
        draw_track(axes, one, window)
    half = half_width(result.route, run.place.covariance)
    if np.isfinite(half).all():
        ring = corridor_ring(result.route[:, :2], half)
        axes.fill(ring[:, 0], ring[:, 1], color=ROUTE, alpha=WIDE_ALPHA, lw=0, zorder=2)
    draw_line(axes, result.route[:, 0], result.route[:, 1], run.place.reliable)
    draw_anchors(axes, np.array([a.x for a in run.anchors]), np.array([a.y for a in run.anchors]))
    draw_corners(axes, result.corners, [one.x for one in result.corners], [one.y for one in result.corners])
    traffic = np.median(np.concatenate([one.position[:, 1] for one in run.passes]))
    for anchor in run.anchors:
        away = (0, -11 if anchor.y > traffic else 11)
        axes.annotate(anchor.name, (anchor.x, anchor.y), away, textcoords="offset points", ha="center", va="center")
    draw_north(axes, run.frame.x_azimuth)
    draw_scale(axes)
    axes.set_ylabel("y, m")


@dataclass(frozen=True)
class Profile:
    """One coordinate along the fiber, m.

    Parameters
    ----------
    name : title of the panel
    value, half : [channel], the coordinate and its 95 % half-width
    fit_half : [channel], the same if the model lacks nothing
    sure : [channel], whether data and anchors decide it
    known, known_half : [anchor], the coordinate of the anchors and its 95 % half-width
    """

    name: str
    value: NDArray[np.float64]
    half: NDArray[np.float64]
    fit_half: NDArray[np.float64]
    sure: NDArray[np.bool_]
    known: NDArray[np.float64]
    known_half: NDArray[np.float64]

    @property
    def band(self) -> NDArray[np.float64]:
        """Everything that the panel must show, m."""
        return np.concatenate([self.value - self.half, self.value + self.half, self.known])


def sideways_profile(run: Run, base: NDArray[np.float64] | None = None) -> Profile:
    """Lateral position; off a route `base` [channel, 3], by default off itself where it does not follow the road."""
    result = run.result
    half, own = (np.nan_to_num(half_width(result.route, one)) for one in (run.place.covariance, result.covariance))
    sigma = np.array([a.sigma_xy for a in run.anchors])
    places = np.array([(a.x, a.y) for a in run.anchors]).reshape(-1, 2)
    if base is None and along_x(result.route):
        return Profile("Sideways", result.route[:, 1], half, own, run.place.reliable, places[:, 1], Z95 * sigma)
    at = [int(np.argmin(np.abs(result.channel - a.channel))) for a in run.anchors]
    base = result.route if base is None else base
    across = normals(base)
    off = ((result.route - base)[:, :2] * across).sum(1)
    miss = ((places - base[at, :2]) * across[at]).sum(1)
    return Profile("Off the route", off, half, own, run.place.reliable, miss, Z95 * sigma)


def depth_profile(run: Run) -> Profile:
    """Depth below the road."""
    result = run.result
    half, own = (np.nan_to_num(Z95 * one.sigma[:, 2]) for one in (run.place, result))
    sure = ~(result.data_share[:, 2] < 0.5) & run.place.reliable
    known, sigma = (np.array([getattr(a, name) for a in run.anchors]) for name in ("z", "sigma_z"))
    return Profile("Depth", result.route[:, 2], half, own, sure, known, Z95 * sigma)


def draw_profile(axes: Axes, run: Run, profile: Profile, straight: bool | None = None) -> None:
    """A profile with its 95 % corridor, within it that which takes the model for granted, and the anchors."""
    x = abscissa(run, straight)
    bands = [(profile.half, WIDE_ALPHA), *([] if run.added is None else [(profile.fit_half, FIT_ALPHA)])]
    for half, alpha in bands:
        axes.fill_between(x, profile.value - half, profile.value + half, color=ROUTE, alpha=alpha, lw=0, zorder=2)
    draw_line(axes, x, profile.value, profile.sure)
    at = np.interp([a.channel for a in run.anchors], run.result.channel, x)
    draw_anchors(axes, at, profile.known, profile.known_half)
    corners = [one.distance for one in run.result.corners]
    draw_corners(
        axes, run.result.corners, *(np.interp(corners, run.result.distance, one) for one in (x, profile.value))
    )
    axes.grid(axis="y", color=MUTED, lw=0.4, alpha=0.35)


def stretch_of(axes: Axes) -> str:
    """How much taller than true the axes draw, in words."""
    box = axes.get_window_extent()
    x, y = axes.get_xlim(), axes.get_ylim()
    times = round(abs(box.height / (y[1] - y[0])) / abs(box.width / (x[1] - x[0])))
    return f"{times} × taller than true" if times > 1 else "about true to scale"


def ground_limits(run: Run, width: float) -> tuple[Limits, Limits]:
    """Ranges x and y, m, that show the route, its anchors and the traffic beside it in a panel `width` px wide."""
    route = run.result.route
    half = np.nan_to_num(half_width(route, run.place.covariance))
    x = padded(route[:, 0], MARGIN)
    tracks = [p.position[(p.position[:, 0] > x[0]) & (p.position[:, 0] < x[1]), 1] for p in run.passes]
    across = np.concatenate([route[:, 1] - half, route[:, 1] + half, *tracks, [a.y for a in run.anchors]])
    return x, padded(across, LABEL * (x[1] - x[0]) / width)


@styled
def route_figure(run: Run, width: int) -> Figure:
    """From above, true to scale; sideways position and depth, stretched, with the 95 % corridor and the fit's own.

    Parameters
    ----------
    run : to draw
    width : of the figure, CSS pixels

    Returns
    -------
    figure : with axes labeled `plan`, `lateral` and `depth`
    """
    left, across, straight = 66, width - 78, along_x(run.result.route)
    x, y, height = same_scale(*ground_limits(run, across), across, 90, 0.75 * across)
    figure = canvas(width, round(height) + 2 * PANEL + 190)
    plan = place(figure, "plan", left, 46, across, height)
    lateral = place(figure, "lateral", left, height + 96, across, PANEL)
    depth = place(figure, "depth", left, height + PANEL + 146, across, PANEL)
    plan.set(xlim=x, ylim=y[::-1], title="From above, true to scale")
    draw_plan(plan, run, x)
    sideways, down = sideways_profile(run), depth_profile(run)
    draw_profile(lateral, run, sideways)
    draw_profile(depth, run, down)
    lateral.set_ylim(padded(sideways.band, 0.05 + 0.08 * float(np.ptp(sideways.band)), LATERAL_SPAN)[::-1])
    depth.axhline(0.0, color=MUTED, lw=3)
    depth.set_ylim(max(1.5, 1.08 * float(down.band.max())), -0.08)
    for axes, profile in ((lateral, sideways), (depth, down)):
        axes.set_xlim(x if straight else padded(run.result.distance, MARGIN))
        axes.set_title(f"{profile.name}, {stretch_of(axes)}")
    lateral.set_ylabel("y, m" if straight else "m")
    depth.set(ylabel="z, m", xlabel="x, m along the road" if straight else "distance along the fiber, m")
    return figure
