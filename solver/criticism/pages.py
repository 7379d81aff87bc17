"""Pages of a diagnosis, of the error ladder and of the story of both; they open offline."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from solver.criticism.candidate import Candidate
from solver.criticism.plain_verdict import details, headline, hidden_change, least_words, size_words, titles
from solver.criticism.score import FOUND
from solver.criticism.verdict_words import left_open
from solver.run.report.ladder_page import ladder_body
from solver.run.report.parts import page
from solver.run.rung import Rung
from vision.contract.drawing import canvas, place
from vision.contract.figures import styled, svg

if TYPE_CHECKING:
    from solver.criticism.diagnosis import Diagnosis

VERDICTS = {
    "adequate": "The model is adequate",
    "missing-effect": "An effect is missing",
    "unknown-effect": "Something unknown acts",
    "inconclusive": "The survey cannot say",
}
SHOWN = 12


def distance(length: float | None) -> str:
    """How far a route moves, m, as a page shows it."""
    return "-" if length is None else f"{length:.2f}"


def row(candidate: Candidate, listed: Sequence[Candidate]) -> str:
    """A line of the table of effects."""
    gain = candidate.held_out_gain
    cells = [
        f"{escape(candidate.title)}<br><code>{escape(candidate.effect)}</code>",
        candidate.stage,
        candidate.verdict,
        f"{candidate.delta_chi2:.0f}" + ("" if candidate.refitted else "*"),
        escape(size_words(candidate)),
        distance(candidate.route_change),
        f"{100 * candidate.retained_share:.0f} %",
        escape(least_words(candidate)) or "none",
        "-" if gain is None else f"{gain:+.2g}",
    ]
    names = escape(titles(candidate.confounded_with, listed)) if candidate.confounded_with else "-"
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + f'<td class="names">{names}</td></tr>'


HEAD = (
    "effect",
    "stage",
    "verdict",
    "fall of chi2 (*&nbsp;predicted)",
    "size of it",
    "ignored, it moves the route by, m",
    "left by the route",
    "smallest that would show",
    "held-out gain",
    "not told from",
)


def table(candidates: Sequence[Candidate]) -> str:
    """The best effects."""
    head = "".join(f"<th>{name}</th>" for name in HEAD)
    rows = "\n".join(row(c, candidates) for c in candidates[:SHOWN])
    return f'<div class="wide-table"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


@styled
def evidence_figure(candidates: Sequence[Candidate]) -> Figure:
    """Bars of the fall of chi2, best effects first."""
    best = [c for c in candidates if c.delta_chi2 > 0][:SHOWN]
    figure = canvas(720, 70 + 22 * max(len(best), 1))
    axes = place(figure, "evidence", 210, 10, 480, 22 * max(len(best), 1))
    places = np.arange(len(best))
    colors = ["0.6" if c.generic else "C0" for c in best]
    axes.barh(places, [max(c.delta_chi2, 1.0) for c in best], color=colors, height=0.62)
    axes.set_yticks(places, [c.title for c in best])
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.axvline(2 * FOUND, color="C3", linewidth=1)
    axes.set_xlabel("fall of chi2 (log); right of the line it is more than chance; gray: discrepancy models")
    return figure


def power_table(candidates: Sequence[Candidate]) -> str:
    """What the survey would have shown of effects that did not show."""
    absent = [c for c in candidates if c.verdict != "present" and c.evidence <= FOUND and not c.generic]
    cells = [
        f"<tr><td>{escape(c.title)}</td><td>{c.verdict}</td><td>{escape(least_words(c)) or 'none'}</td>"
        f"<td>{distance(hidden_change(c))}</td></tr>"
        for c in sorted(absent, key=lambda c: c.title)
    ]
    head = (
        "<tr><th>effect</th><th>verdict</th><th>smallest size that would have shown</th>"
        "<th>which would move the route by, m</th></tr>"
    )
    return f"<table><thead>{head}</thead><tbody>{''.join(cells)}</tbody></table>"


def audit_words(diagnosis: "Diagnosis") -> str:
    """The noise audit in a sentence."""
    a = diagnosis.audit
    if a.faults:
        return "The noise audit failed: " + escape("; ".join(a.faults)) + "."
    return (
        f"The noise audit passed: {a.samples} quiet samples, whitened variance {a.variance:.2f}, largest correlation "
        f"in time {a.in_time:+.3f}, between channels {a.across:+.3f}. Before whitening neighboring samples correlate "
        f"by {a.memory:.2f}, and {100 * a.common_share:.0f} % of the noise is common to all channels."
    )


def verdict_sentence(diagnosis: "Diagnosis") -> str:
    """A verdict's words as a sentence, in which an effect keeps the name that commands take."""
    words, names = diagnosis.words, {c.effect for c in diagnosis.candidates}
    start = words if words.split()[0] in names else words[:1].upper() + words[1:]
    return escape(start.rstrip(".") + ".")


def diagnosis_body(diagnosis: "Diagnosis", name: str) -> str:
    """A diagnosis as a part of a page."""
    words = verdict_sentence(diagnosis)
    lines = " ".join(map(escape, details(diagnosis)))
    separate = ""
    if diagnosis.separate:
        separate = f"<p>What would tell them apart: {escape(diagnosis.separate)}.</p>"
    verdict = VERDICTS[diagnosis.verdict].lower()
    return f"""<header><p>{escape(name)}: {verdict}</p><h1>{escape(headline(diagnosis))}</h1>
<p>{lines}</p>{separate}<p>In the terms of the commands: {words}</p></header>
<section><h2>Candidates</h2>{svg(evidence_figure(diagnosis.candidates))}{table(diagnosis.candidates)}</section>
<section><h2>Noise</h2><p>{audit_words(diagnosis)}</p></section>"""


def diagnosis_page(diagnosis: "Diagnosis", name: str) -> str:
    """diagnosis.html."""
    power = f"<section><h2>What could have hidden</h2>{power_table(diagnosis.candidates)}</section>"
    return page(f"{name}: diagnosis", diagnosis_body(diagnosis, name) + power)


@dataclass(frozen=True)
class Chapter:
    """A diagnosis and what was done about it."""

    diagnosis: "Diagnosis"
    done: str


def story_page(chapters: Sequence[Chapter], rungs: Sequence[Rung], name: str) -> str:
    """explain.html: every diagnosis, what was done about it, and the ladder."""
    still = escape(left_open(one.diagnosis.candidates[0] for one in chapters if one.diagnosis.candidates))
    body = f"<header><p>{escape(name)}</p><h1>What the model lacked</h1><p>{still}</p></header>"
    body += f"<section><h2>Error ladder</h2>{ladder_body(rungs)}</section>"
    for number, chapter in enumerate(chapters, 1):
        diagnosis = chapter.diagnosis
        words = verdict_sentence(diagnosis)
        body += (
            f"<section><h2>{number}. {escape(headline(diagnosis))}</h2><p>{words}</p>"
            f"<p>{escape(chapter.done)}</p>{table(diagnosis.candidates[:6])}</section>"
        )
    if still:
        body += f"<section><h2>What is still open</h2><p>{still}</p></section>"
    return page(f"{name}: what the model lacked", body)
