"""The page of an error ladder."""

from collections.abc import Sequence
from html import escape
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from solver.run.report.parts import page, with_commands
from solver.run.rung import Rung
from vision.contract.drawing import canvas, place
from vision.contract.figures import styled, svg


@styled
def ladder_figure(rungs: Sequence[Rung]) -> Figure:
    """Misfit and held-out misfit against the rungs with the noise floor, and how far the route moved."""
    figure = canvas(720, 420)
    upper = place(figure, "misfit", 60, 20, 620, 220)
    lower = place(figure, "route", 60, 270, 620, 90)
    x = np.arange(len(rungs))
    upper.plot(x, [r.chi2_per_dof for r in rungs], "o-", color="C0", label="fitted passes")
    held = [np.nan if r.held_out_chi2_per_dof is None else r.held_out_chi2_per_dof for r in rungs]
    upper.plot(x, held, "s--", color="C1", label="passes held out")
    floor = rungs[-1].noise_floor
    if floor is not None:
        upper.axhline(floor, color="0.5", linewidth=1)
        upper.text(len(rungs) - 0.5, floor, " noise floor", va="bottom", ha="right", color="0.4")
    upper.set_ylabel("chi2 per degree of freedom")
    upper.set_xticks(x, [""] * len(rungs))
    upper.legend(frameon=False)
    lower.bar(x, [r.route_change for r in rungs], color="C2", width=0.5)
    lower.set_ylabel("route moved, m")
    news = [[name for name in after.effects if name not in before.effects] for before, after in pairwise(rungs)]
    lower.set_xticks(x, ["start", *(f"+ {', '.join(names)}" for names in news)])
    for axes in (upper, lower):
        axes.set_xlim(-0.5, len(rungs) - 0.5)
    return figure


def ladder_body(rungs: Sequence[Rung]) -> str:
    """The ladder as a part of a page."""
    head = "<tr><th>model</th><th>chi2/dof</th><th>held out</th><th>route moved, m</th><th>since the first, m</th></tr>"
    rows = "".join(
        f"<tr><td>{escape(', '.join(r.effects) or 'as published')}</td><td>{r.chi2_per_dof:.3f}</td>"
        f"<td>{'-' if r.held_out_chi2_per_dof is None else f'{r.held_out_chi2_per_dof:.3f}'}</td>"
        f"<td>{r.route_change:.2f}</td><td>{r.route_change_from_first:.2f}</td></tr>"
        for r in rungs
    )
    return f"{doubt_list(rungs)}{svg(ladder_figure(rungs))}<table><thead>{head}</thead><tbody>{rows}</tbody></table>"


def doubt_list(rungs: Sequence[Rung]) -> str:
    """What must be said of rungs before their numbers."""
    lines = [(rung.effects[-1], line) for rung in rungs for line in rung.words]
    items = "".join(f"<li><b>+ {escape(name)}:</b> {with_commands(line)}.</li>" for name, line in lines)
    return f'<ul class="doubts">{items}</ul>' if items else ""


def ladder_page(rungs: Sequence[Rung], name: str) -> str:
    """ladder.html."""
    return page(
        f"{name}: error ladder", f"<header><p>{escape(name)}</p><h1>Error ladder</h1></header>{ladder_body(rungs)}"
    )
