"""Pages of a diagnosis, of the error ladder and of the story of both; they open offline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from solver.criticism.candidate import Candidate
from solver.criticism.diagnosis_figures import (
    LEFT,
    before_after,
    route_section,
    signatures,
    support_figure,
    sureness_section,
    wave_section,
)
from solver.criticism.finding import LISTED
from solver.criticism.plain_verdict import details, headline, hidden_change, least_words, size_words, titles
from solver.criticism.policy import POLICY
from solver.criticism.probability_figure import probability_figure
from solver.criticism.verdict_words import left_open
from solver.run.report.ladder_page import ladder_body
from solver.run.report.parts import EXPORT, next_section, page, with_commands
from solver.run.run import Run
from solver.run.rung import Rung
from vision.contract.figures import svg

if TYPE_CHECKING:
    from solver.criticism.finding import Diagnosis

VERDICTS = {
    "adequate": "The model is adequate",
    "missing-effect": "An effect is missing",
    "unknown-effect": "Something unknown acts",
    "inconclusive": "The survey cannot say",
}


def distance(length: float | None) -> str:
    """How far a route moves, m, as a page shows it."""
    return "-" if length is None else f"{length:.2f}"


def row(candidate: Candidate, listed: Sequence[Candidate], pictures: Mapping[str, str]) -> str:
    """A line of the table of effects."""
    gain = candidate.held_out_gain
    images = [(pictures.get(LEFT), "what the model leaves"), (pictures.get(candidate.effect), "what this changes")]
    pair = "".join(f'<img class="signature" alt="{alt}" src="{source}">' for source, alt in images if source)
    cells = [
        f"{escape(candidate.title)}<br><code>{escape(candidate.effect)}</code>",
        f'<div class="pair">{pair}</div>' if candidate.effect in pictures else "",
        f"{candidate.verdict}<br><small>{candidate.stage}</small>",
        f"{candidate.delta_chi2:,.0f}" + ("" if candidate.refitted else "*"),
        f'<span class="size">{escape(size_words(candidate))}</span>',
        distance(candidate.route_change),
        f"{100 * candidate.retained_share:.0f} %",
        f'<span class="size">{escape(least_words(candidate)) or "none"}</span>',
        "-" if gain is None else f"{gain:+.2g}",
    ]
    names = escape(titles(candidate.confounded_with, listed)) if candidate.confounded_with else "-"
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + f'<td class="names">{names}</td></tr>'


HEAD = (
    "effect",
    "left by the model, and what this changes",
    "verdict",
    "misfit that it takes away",
    "its size",
    "ignored, it moves the route by, m",
    "no route imitates",
    "smallest that would show",
    "gain on passes held out",
    "not told from",
)
VERDICT_WORDS = (
    "<p><b>Present</b>: it shows. <b>Excluded</b>: half its usual size would have shown. <b>Negligible</b>: too small "
    "to matter, or shown only where it is large. <b>Inconclusive</b>: this survey cannot say.</p>"
)
COLUMN_WORDS = (
    "<p>Misfit that it takes away: the fall of chi²; with *, it and the picture are predicted, not fitted in full. No "
    "route imitates: the share of its signal that is left once the route has moved as far as it can to look alike.</p>"
)


def table(candidates: Sequence[Candidate], pictures: Mapping[str, str] | None = None) -> str:
    """The best effects, with pictures of what they change in one pass."""
    head = "".join(f"<th>{name}</th>" for name in HEAD)
    rows = "\n".join(row(c, candidates, pictures or {}) for c in candidates[:LISTED])
    return f'<div class="wide-table"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def power_table(candidates: Sequence[Candidate]) -> str:
    """What the survey would have shown of effects that did not show."""
    absent = [c for c in candidates if c.verdict != "present" and c.evidence <= POLICY.found and not c.generic]
    cells = [
        f"<tr><td>{escape(c.title)}</td><td>{c.verdict}</td><td>{escape(least_words(c)) or 'none'}</td>"
        f"<td>{distance(hidden_change(c))}</td></tr>"
        for c in sorted(absent, key=lambda c: c.title)
    ]
    head = (
        "<tr><th>effect</th><th>verdict</th><th>smallest size that would have shown</th>"
        "<th>which would move the route by, m</th></tr>"
    )
    return f'<div class="wide-table"><table><thead>{head}</thead><tbody>{"".join(cells)}</tbody></table></div>'


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


def next_words(diagnosis: "Diagnosis") -> list[str]:
    """What to do next, with commands between backticks."""
    first = diagnosis.candidates[0] if diagnosis.candidates else None
    if diagnosis.verdict == "missing-effect" and first is not None:
        return [
            f"`roadfiber add RUN {first.effect} --out RUN-2` puts it into the model, fits everything again and shows "
            "how the error falls and how far the route moves."
        ]
    if diagnosis.verdict == "adequate":
        return [EXPORT]
    lines = ["`roadfiber compare RUN` shows where, when and how model and measurement differ."]
    if diagnosis.separate:
        lines.append(f"A survey that could tell needs {diagnosis.separate}.")
    elif diagnosis.verdict == "unknown-effect":
        lines.append("`roadfiber diagnose RUN --plugin mine.py` tests an effect of your own beside the catalogue.")
    return lines


def diagnosis_body(diagnosis: "Diagnosis", run: Run | None = None) -> str:
    """What a diagnosis found as a part of a page: support, before and after, candidates."""
    pair = None if run is None else before_after(run, diagnosis)
    moved = diagnosis.candidates[0].route_change if diagnosis.candidates else None
    title = diagnosis.candidates[0].title if diagnosis.candidates else ""
    shown = "" if pair is None else wave_section(pair, title) + route_section(pair, moved)
    pictures = {} if pair is None else signatures(pair, diagnosis)
    bars = svg(probability_figure(diagnosis.explanations, diagnosis.candidates)) if diagnosis.explanations else ""
    probable = (
        "<section><h2>How probable each explanation is</h2><p>All of them together hold 100 %. Each effect is weighed "
        "with a law that may be off by some percent and a size that may be as large as is plausible; gray are nothing "
        "that would show, something unnoticed, of which no model has a trace, and something that the catalogue does "
        f"not know.</p>{bars}</section>"
    )
    support = (
        "<section><h2>What supports which explanation</h2><p>Orange is the one that the verdict names, blue are other "
        "known effects, each alone in the model and everything fitted again; gray stands for something unknown, which "
        "bends to anything and so always takes away much. What a bar is worth, the probabilities say: they know of "
        f"laws and sizes, and that no model is exact.</p>{svg(support_figure(diagnosis.candidates))}</section>"
    )
    effects = (
        f"<section><h2>Candidates</h2>{VERDICT_WORDS}{COLUMN_WORDS}{table(diagnosis.candidates, pictures)}</section>"
    )
    sure = "" if run is None else sureness_section(run)
    return (probable if bars else "") + support + shown + sure + effects


def lead(diagnosis: "Diagnosis", name: str) -> str:
    """The verdict as a sentence, and what follows from it."""
    lines = "".join(f"<p>{escape(line)}</p>" for line in details(diagnosis))
    separate = f"<p>What would tell them apart: {escape(diagnosis.separate)}.</p>" if diagnosis.separate else ""
    verdict = VERDICTS[diagnosis.verdict]
    return (
        f"<header><p>{escape(name)} · {verdict}</p><h1>{escape(headline(diagnosis))}</h1>"
        f'<div class="lead">{lines}{separate}</div></header>'
    )


def diagnosis_page(diagnosis: "Diagnosis", name: str, run: Run | None = None) -> str:
    """diagnosis.html; with the run that it is of, one vehicle and the route before and after too."""
    body = lead(diagnosis, name) + next_section(next_words(diagnosis)) + diagnosis_body(diagnosis, run)
    body += f"<section><h2>Noise</h2><p>{audit_words(diagnosis)}</p></section>"
    body += f"<section><h2>What could have hidden</h2>{VERDICT_WORDS}{power_table(diagnosis.candidates)}</section>"
    body += f"<footer>In the terms of the commands: {verdict_sentence(diagnosis)}</footer>"
    return page(f"{name}: diagnosis", body)


@dataclass(frozen=True)
class Chapter:
    """A diagnosis and what was done about it; `run` is the one that it is of, `added` whether its effect was put in."""

    diagnosis: "Diagnosis"
    done: str
    run: Run | None = None
    added: bool = False


def story_page(chapters: Sequence[Chapter], rungs: Sequence[Rung], name: str) -> str:
    """explain.html: what was missing, every diagnosis and what was done about it, and the ladder."""
    still = escape(left_open(one.diagnosis.candidates[0] for one in chapters if one.diagnosis.candidates))
    added = [one.diagnosis.candidates[0].effect for one in chapters if one.added]
    listed = [c for one in chapters for c in one.diagnosis.candidates]
    found = f"What the model lacked: {titles(added, listed, 'and')}" if added else "Nothing was added to the model"
    last = chapters[-1]
    trust = "" if last.run is None else with_commands(last.run.trust)
    lead = "".join(f"<p>{line}</p>" for line in (escape(headline(last.diagnosis)), trust, still) if line)
    body = f"<header><p>{escape(name)} · diagnosed, added, and diagnosed again</p><h1>{escape(found)}</h1>"
    body += f'<div class="lead">{lead}</div></header>{next_section(next_words(chapters[-1].diagnosis))}'
    body += ladder_body(rungs)
    for number, chapter in enumerate(chapters, 1):
        diagnosis = chapter.diagnosis
        lines = "".join(f"<p>{escape(line)}</p>" for line in (*details(diagnosis), chapter.done))
        pair = None if chapter.run is None else before_after(chapter.run, diagnosis)
        pictures = {} if pair is None else signatures(pair, diagnosis)
        body += f"<section><h2>{number}. {escape(headline(diagnosis))}</h2>{lines}"
        body += table(diagnosis.candidates[:6], pictures)
        body += f"<p>In the terms of the commands: {verdict_sentence(diagnosis)}</p></section>"
        if pair is not None:
            body += wave_section(pair, diagnosis.candidates[0].title)
    if still:
        body += f"<section><h2>What is still open</h2><p>{still}</p></section>"
    body += f"<section><h2>How to read the tables</h2>{VERDICT_WORDS}{COLUMN_WORDS}</section>"
    return page(f"{name}: what the model lacked", body)
