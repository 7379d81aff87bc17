"""stretches.html: what each stretch of a long fiber lacks, and all of them together."""

from collections.abc import Mapping
from html import escape
from typing import Any

from matplotlib.figure import Figure

from solver.criticism.pages import VERDICTS
from solver.run.report.parts import next_section, page
from solver.run.titles import probability_words
from vision.contract.figures import svg


def stretch_page(name: str, facts: Mapping[str, Any], bars: Figure) -> str:
    """The page of what stretches.json holds, with bars of how probable each common cause is."""
    body = f"<header><p>{escape(name)} · {VERDICTS[facts['verdict']]}</p><h1>{escape(facts['headline'])}</h1></header>"
    body += next_section(
        [
            "`roadfiber add RUN/channels-A-B EFFECT --out PART` puts an effect into the model of one stretch.",
            "`roadfiber compare RUN/channels-A-B` shows where, when and how model and measurement differ there.",
        ]
    )
    rows = "".join(row(one) for one in facts["stretches"])
    body += (
        "<section><h2>Stretch by stretch</h2><p>A model is criticized over short stretches: each is fitted by itself, "
        'from the whole route on.</p><table class="words"><thead><tr><th>channels</th><th>verdict</th>'
        f"<th>what is missing there</th></tr></thead><tbody>{rows}</tbody></table></section>"
    )
    alike = probability_words(facts["alike"])
    body += (
        "<section><h2>One cause along all of it</h2><p>The stretches' records are independent, so what each says of a "
        f"cause multiplies. That one cause, or none, acts along all of the fiber is {alike} probable, if it was as "
        f"likely as not before; each cause is then as probable as its bar says.</p>{svg(bars)}</section>"
    )
    return page(f"{name}: stretches", body)


def row(one: Mapping[str, Any]) -> str:
    """A line of the table of stretches."""
    link = f'<a href="{escape(one["folder"])}/diagnosis.html">{one["first"]} to {one["last"]}</a>'
    return f"<tr><td>{link}</td><td>{VERDICTS[one['verdict']]}</td><td>{escape(one['headline'])}</td></tr>"
