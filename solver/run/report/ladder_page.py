"""The page of an error ladder: how the error falls and the route moves, rung by rung."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solver.catalogue.catalogue import title_of
from solver.run.report.parts import next_section, page, with_commands
from solver.run.rung import Rung, route_moved, rung_names
from vision.contract.drawing import canvas, color_map, color_scale, place
from vision.contract.figures import INK, MUTED, PAPER, data_uri, png_bytes, styled, svg
from vision.contract.palette import ROUTE

#: px: width of figures, height of the panel of misfits.
WIDTH, HEIGHT = 1060, 250
HELD = "#0072b2"


def news(rungs: Sequence[Rung]) -> list[str]:
    """What each rung has that the one below has not, by title."""
    return rung_names(rungs, title_of)


@styled
def ladder_figure(rungs: Sequence[Rung]) -> Figure:
    """Misfit and held-out misfit above the noise floor, where the axis begins, and how far the route moved."""
    figure = canvas(WIDTH, HEIGHT + 210)
    upper = place(figure, "misfit", 70, 20, WIDTH - 110, HEIGHT)
    lower = place(figure, "route", 70, HEIGHT + 50, WIDTH - 110, 90)
    x = np.arange(len(rungs))
    misfit = np.array([r.chi2_per_dof for r in rungs], dtype=float)
    held = np.array([np.nan if r.held_out_chi2_per_dof is None else r.held_out_chi2_per_dof for r in rungs])
    floor = rungs[-1].noise_floor
    draw_misfits(upper, x, (misfit, held), floor)
    upper.set_xticks(x, [""] * len(rungs))
    lower.bar(x, np.nan_to_num([r.route_change for r in rungs]), color=ROUTE, width=0.3)
    for at, rung in enumerate(rungs):
        lower.text(at, np.nan_to_num(rung.route_change), rung.moved, ha="center", va="bottom", color=INK)
    lower.set_ylabel("route moved, m")
    lower.set_ylim(0, 1.3 * max([0.01, *(r.route_change for r in rungs if np.isfinite(r.route_change))]))
    lower.set_xticks(x, news(rungs))
    for axes in (upper, lower):
        axes.set_xlim(-0.5, len(rungs) - 0.5)
    return figure


def draw_misfits(
    axes: Axes, x: NDArray[np.int64], both: tuple[NDArray[np.float64], NDArray[np.float64]], floor: float | None
) -> None:
    """Lines of both misfits, shaded down to the floor, with their numbers."""
    known = np.concatenate([values[np.isfinite(values)] for values in both])
    base = float(known.min()) if floor is None else floor
    top = max(float(known.max()), base)
    reach = max(top - base, 0.02)
    axes.fill_between(x, base, both[0], color=ROUTE, alpha=0.15, lw=0)
    # Numbers in the colors of text, which can be read on both themes.
    kinds = ((ROUTE, "o-", "fitted passes", -11, INK), (HELD, "s--", "passes held out", 4, MUTED))
    for values, (color, style, name, up, said) in zip(both, kinds, strict=True):
        axes.plot(x, values, style, color=color, label=name)
        for at, value in zip(x, values, strict=True):
            if np.isfinite(value):
                # Away from the line: it begins at the first rung, and falls toward the others.
                ha, aside = ("right", -8) if at == x[0] else ("left", 8)
                text = axes.annotate(f"{value:.3f}", (at, value), (aside, up), textcoords="offset points", ha=ha)
                text.set(color=said, bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.5, "alpha": 0.85})
    if floor is not None:
        axes.axhline(floor, color=INK, lw=1.0, ls=(0, (4, 3)))
        axes.text(-0.48, floor, f"noise alone: {floor:.3f}", va="bottom", ha="left", color=MUTED)
    low = min(float(known.min()), base)
    axes.set_ylim(low - 0.06 * reach, top + 0.15 * reach)
    axes.set_ylabel("misfit, chi² per degree of freedom")
    axes.legend(loc="upper right")


@styled
def move_figure(rungs: Sequence[Rung]) -> Figure:
    """The route of every rung, from above and in depth: the first in gray, the last in the color of routes."""
    figure = canvas(WIDTH, 470)
    panels = [place(figure, name, 70, 24 + 220 * row, WIDTH - 110, 170) for row, name in enumerate(("plan", "depth"))]
    for number, rung in enumerate(rungs):
        route = np.array(rung.route, dtype=float).reshape(-1, 4)
        last = number == len(rungs) - 1
        look: dict[str, Any] = (
            {"color": ROUTE, "lw": 2.2} if last else {"color": MUTED, "lw": 1.2, "ls": (0, (number + 1, 1.5))}
        )
        panels[0].plot(route[:, 1], route[:, 2], label=news(rungs)[number], zorder=3 + last, **look)
        panels[1].plot(route[:, 1], route[:, 3], zorder=3 + last, **look)
    panels[0].set(ylabel="y, m", title="From above, stretched sideways")
    panels[1].set(ylabel="z, m", xlabel="x, m along the road", title="Depth, stretched")
    for axes in panels:
        low, high = axes.get_ylim()
        pad = max(0.0, 0.4 - (high - low)) / 2
        axes.set_ylim(high + pad, low - pad)
        axes.grid(axis="y", color=MUTED, lw=0.4, alpha=0.35)
    panels[0].legend(loc="best", facecolor=PAPER)
    return figure


def thumbnails(rungs: Sequence[Rung]) -> str:
    """What each rung leaves of one pass, in one color scale."""
    seen = [(rung.glimpse, name) for rung, name in zip(rungs, news(rungs), strict=True) if rung.glimpse is not None]
    images = [(np.array(one.residual, dtype=float), name) for one, name in seen if one.residual]
    if not images:
        return ""
    scale = color_scale(images[0][0])
    figures = "".join(
        f"<figure><figcaption>{escape(name)}</figcaption><img alt='residual' "
        f"src='{data_uri(png_bytes(color_map()(scale(np.ma.masked_invalid(image)))))}'></figure>"
        for image, name in images
    )
    track = escape(seen[0][0].track)
    return (
        f"<section><h2>What is left of one pass</h2><p>Vehicle {track}: time runs down, channels run along the fiber; "
        f'one color scale. Noise alone is pale.</p><div class="rungs">{figures}</div></section>'
    )


def anchor_section(rungs: Sequence[Rung]) -> str:
    """How far the route of each rung is from each anchor."""
    off = [{name: (m, s) for name, m, s in (rung.glimpse.anchors if rung.glimpse else ())} for rung in rungs]
    names = list(dict.fromkeys(name for one in off for name in one))
    if not names:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    rows = "".join(
        f"<tr><td>{escape(label)}</td>{''.join(f'<td>{miss_words(one.get(name))}</td>' for name in names)}</tr>"
        for label, one in zip(news(rungs), off, strict=True)
    )
    return (
        "<section><h2>Anchors</h2><p>How far the route is from each known point, in meters and in the point's sigmas."
        f'</p><div class="wide-table"><table><tr><th></th>{head}</tr>{rows}</table></div></section>'
    )


def miss_words(miss: tuple[float, float] | None) -> str:
    """A miss in meters and sigmas."""
    return "-" if miss is None else f"{miss[0]:.2f} m <small>{miss[1]:.1f} σ</small>"


def ladder_table(rungs: Sequence[Rung]) -> str:
    """Numbers of all rungs."""
    names = (
        "model",
        "misfit, chi²/dof",
        "on passes held out",
        "noise alone",
        "route moved, m",
        "since the first, m",
    )
    head = "".join(f"<th>{name}</th>" for name in names)
    rows = "".join(
        f"<tr><td>{escape(label)}</td><td>{r.chi2_per_dof:.3f}</td><td>{known(r.held_out_chi2_per_dof)}</td>"
        f"<td>{known(r.noise_floor)}</td><td>{known(r.route_change, 2)}</td>"
        f"<td>{known(r.route_change_from_first, 2)}</td></tr>"
        for r, label in zip(rungs, news(rungs), strict=True)
    )
    return f'<div class="wide-table"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def known(value: float | None, digits: int = 3) -> str:
    """A number, where there is one."""
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def ladder_body(rungs: Sequence[Rung]) -> str:
    """The ladder as a part of a page."""
    return (
        f"<section><h2>How the error falls</h2>{doubt_list(rungs)}"
        "<p>Each rung has one effect more in its model. The axis begins where noise alone would leave the misfit: what "
        "is shaded is error that the model makes. Passes held out were not seen by the fit.</p>"
        f"{svg(ladder_figure(rungs))}{ladder_table(rungs)}</section>{thumbnails(rungs)}"
        f"<section><h2>How the route moves</h2>{svg(move_figure(rungs))}</section>{anchor_section(rungs)}"
    )


def doubt_list(rungs: Sequence[Rung]) -> str:
    """What must be said of rungs before their numbers."""
    lines = [(rung.effects[-1], line) for rung in rungs for line in rung.words]
    items = "".join(f"<li><b>+ {escape(title_of(name))}:</b> {with_commands(line)}.</li>" for name, line in lines)
    return f'<ul class="doubts">{items}</ul>' if items else ""


def headline(rungs: Sequence[Rung]) -> str:
    """How far the error fell, in a sentence."""
    first, last = rungs[0], rungs[-1]
    if len(rungs) == 1:
        return f"One rung: misfit {first.chi2_per_dof:.3f}"
    fell = f"Misfit {first.chi2_per_dof:.3f} to {last.chi2_per_dof:.3f}"
    floor = "" if last.noise_floor is None else f", where noise alone leaves {last.noise_floor:.3f}"
    return f"{fell}{floor}; {route_moved(last.route_change_from_first)}"


def ladder_page(rungs: Sequence[Rung], name: str) -> str:
    """ladder.html."""
    lines = [
        "`roadfiber diagnose RUN` says what the last model still lacks.",
        "A rung is undone by going on from the run folder of the rung below: each keeps its own.",
    ]
    head = f"<header><p>{escape(name)} · error ladder</p><h1>{escape(headline(rungs))}</h1></header>"
    return page(f"{name}: error ladder", f"{head}{ladder_body(rungs)}{next_section(lines)}")
