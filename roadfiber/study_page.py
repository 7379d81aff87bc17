"""The page of the paper's study: which of its claims hold in simulation, and the tables and figures behind that."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from roadfiber.study_surveys import FIELD
from solver.run.report.parts import next_section, page
from vision.contract.figures import svg

if TYPE_CHECKING:
    import pandas as pd

    from roadfiber.studying import Study

NOT_AT_HAND = (
    "The authors' field data were not at hand, and how their files are laid out is not known here: what the paper says "
    "of the field is quoted beside the simulation, not checked. There is no loader for those files."
)
METHODS = (
    "The methods: spline is what roadfiber locate does; network is the paper's own, network-whitened the same with the "
    "noise model, priors and anchors of spline; geometric draws a curve that touches circles around the vehicles."
)
LOCATED = (
    f"A survey counts as located where no point of its route is more than {FIELD[1]:g} m from the true one: that is "
    "the worst that the paper reached in the field. A claim holds for a method that does here what the paper says of "
    "its own."
)
READING = (
    "Means over the surveys of each value. Expected is the error that no method can beat on average (Cramer-Rao). Off "
    "at most is the largest distance between the two routes (Hausdorff)."
)
HOLDS = {True: "yes", False: "no", None: "too few values"}
CLAIMS = ("what was varied", "the claim", "method", "off at most, here", "does it hold?")
COLUMNS = (
    "method", "surveys", "not located", "mean error, m", "10 to 90 % of surveys", "expected, m", "times expected",
    "off at most, m", "within 1.96 sigma", "side not sure", "seconds",
)  # fmt: skip


def study_page(study: "Study") -> str:
    """The whole page."""
    claims = study.claims
    hold = sum(one is not None and bool(one) for one in claims["agrees"])
    rows = [tuple(map(str, row)) for row in claims[["axis", "said", "method", "found"]].to_numpy()]
    rows = [(*row, HOLDS[one]) for row, one in zip(rows, claims["agrees"].tolist(), strict=True)]
    parts = [
        "<header><p>The paper's study, repeated on simulated surveys, whose answer is known</p>"
        f"<h1>What holds of the paper's claims: {hold} of {len(claims)}</h1></header>"
        f"<section><h2>What the paper says, and what the simulation gives</h2><p>{LOCATED}</p>"
        f"{html(CLAIMS, rows, 'words')}<p>{METHODS}</p><p>{escape(NOT_AT_HAND)}</p></section>"
    ]
    for name, axis in study.axes.items():
        table = html((axis.label, *COLUMNS), axis_rows(study.table(name), axis.field), "few")
        parts.append(
            f"<section><h2>{escape(f'Error against {axis.label}')}</h2><p>{READING}</p>{svg(study.plot(name))}{table}"
            "</section>"
        )
    lines = [
        "`roadfiber plan site.toml` says what a survey of yours would reach.",
        "claims.csv and a csv and a picture of each figure, with every column, are beside this page.",
    ]
    return page("The paper's study", "".join(parts) + next_section(lines))


def axis_rows(table: "pd.DataFrame", field: str) -> list[tuple[str, ...]]:
    """Rows of an axis for people: a line per value and method."""
    return [
        (
            f"{one[field]:g}", str(one["method"]), f"{one['surveys']:.0f}", f"{one['failed']:.0f}",
            shown(one["mean"]), f"{shown(one['low'])} to {shown(one['high'])}", shown(one["expected"]),
            shown(one["ratio"], 1), shown(one["hausdorff"], 2), shown(100 * one["covered"], 0, " %"),
            shown(100 * one["two sides"], 0, " %"), shown(one["seconds"], 1),
        )
        for one in table.to_dict("records")
    ]  # fmt: skip


def shown(value: float, digits: int = 3, unit: str = "") -> str:
    """A number; a dash where there is none.

    >>> shown(0.1234), shown(float("nan")), shown(95.2, 0, " %")
    ('0.123', '-', '95 %')
    """
    return f"{value:.{digits}f}{unit}" if np.isfinite(value) else "-"


def html(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str) -> str:
    """A table; its look is that of its kind."""
    top = "".join(f"<th>{escape(one)}</th>" for one in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(one)}</td>' for one in row)}</tr>" for row in rows)
    return f'<div class="wide-table"><table class="{kind}"><tr>{top}</tr>{body}</table></div>'
