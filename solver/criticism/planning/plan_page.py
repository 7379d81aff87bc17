"""The page of a plan: what the survey would know, what to add, which effects it could see. It opens offline."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from solver.catalogue.plain_words import rounded
from solver.run.report.parts import next_section, page
from vision.contract.figures import svg

if TYPE_CHECKING:
    from solver.criticism.planning.additions import Addition
    from solver.criticism.planning.detectable import Detectable
    from solver.criticism.planning.plan import Plan

#: Single additions that the page lists.
LISTED = 8
SURVEYED = (
    "`roadfiber start FOLDER` makes site.toml once the survey is done, `roadfiber locate FOLDER --out run` finds "
    "the fiber."
)
VISIBLE = {"yes": "yes", "large": "only where it is large", "no": "no"}


def plan_page(plan: "Plan") -> str:
    """The whole page."""
    body = (
        f"<header><p>{escape(plan.name)} · planned survey</p><h1>{escape(plan.headline)}</h1></header>"
        f"{next_steps(plan)}"
        "<section><h2>What the survey would know</h2><p>The corridor that the fit of such a survey would report, if "
        "the model holds, the vehicles are as heavy as their classes and the noise is white. Of fifty simulated "
        "surveys, 48 had sigmas within 15 % of it (<code>benchmarks/plan.py</code>); where the fiber's "
        "offset was only guessed, within 1.6 times.</p>"
        f"{svg(plan.plot())}{notes(plan.warnings)}</section>"
        f"{additions(plan)}{effects(plan.effects)}{assumed(plan)}{next_section([SURVEYED])}"
    )
    return page(f"{plan.name}: plan", body)


def next_steps(plan: "Plan") -> str:
    """What to add, before all else."""
    title = "What reaches the wanted accuracy: any one of these" if plan.ways else "What would help most"
    return f'<section class="next"><h2>{title}</h2>{notes(plan.advice)}</section>'


def notes(lines: Sequence[str]) -> str:
    """Lines as a list; nothing where there are none."""
    items = "".join(f"<li>{escape(line[:1].upper() + line[1:])}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def additions(plan: "Plan") -> str:
    """What one more pass or anchor would do, and each step of the ways to the wanted accuracy."""
    now = row("as planned", plan.expected.across, plan.expected.depth)
    tables = [f"<h3>One more, by itself</h3>{sigma_table(now + rows(best(plan.alone)))}"]
    for way in plan.ways:
        if way.additions:
            end = "reached" if way.reached else "not reached"
            tables.append(f"<h3>By {escape(way.kind)}: {end}</h3>{sigma_table(now + rows(way.additions))}")
    return (
        "<section><h2>What to add</h2><p>Largest standard deviation in view, m, once it is there. A pass counts as one "
        f"of middle speed, whose track errs by itself.</p>{''.join(tables)}</section>"
    )


def best(alone: "Sequence[Addition]") -> "list[Addition]":
    """The best of each kind, so that neither crowds the other out."""
    half = LISTED // 2
    kept = [[one for one in alone if one.kind == kind][:half] for kind in ("pass", "anchor")]
    return [one for one in alone if one in kept[0] or one in kept[1]]


def rows(listed: "Sequence[Addition]") -> str:
    """A row for each addition."""
    return "".join(row(one.words, one.after.across, one.after.depth) for one in listed)


def row(words: str, across: float, depth: float) -> str:
    """One row of a table of sigmas."""
    return f"<tr><td>{escape(words)}</td><td>{across:.3f}</td><td>{depth:.3f}</td></tr>"


def sigma_table(body: str) -> str:
    """A table of sigmas."""
    head = "<tr><th></th><th>across, m</th><th>in depth, m</th></tr>"
    return f'<div class="wide-table"><table>{head}{body}</table></div>'


def effects(found: "Sequence[Detectable]") -> str:
    """The smallest size of each effect that would show."""
    if not found:
        return ""
    body = "".join(
        f"<tr><td>{escape(one.title)}</td><td>{escape(one.stage)}</td><td>{size(one.size, one.unit)}</td>"
        f"<td>{size(one.plausible, one.unit)}</td><td>{VISIBLE[one.visible]}</td></tr>"
        for one in found
    )
    seen = sum(one.visible == "yes" for one in found)
    return (
        f"<section><h2>Which missing effects it could see: {seen} of {len(found)}</h2><p>The smallest size that would "
        "stand out of the noise by 5 sigma, once the route has moved as far as it can to imitate it; where an effect "
        "has a place or a frequency, for the middle one of those tried. <i>Yes</i>: half the usual size would show. A "
        "dash: no size would. An effect that does not show may still move the route.</p>"
        '<div class="wide-table"><table class="checks"><tr><th>effect</th><th>stage</th>'
        f"<th>smallest that shows</th><th>usual size</th><th>would it show?</th></tr>{body}</table></div></section>"
    )


def size(value: float, unit: str) -> str:
    """A size with its unit; a dash where no size would show."""
    return f"{rounded(value, most=2)} {escape(unit.replace('^2', '²'))}" if np.isfinite(value) else "—"


def assumed(plan: "Plan") -> str:
    """What the plan takes for granted."""
    site, section = plan.planned.site, plan.planned.site.plan
    said = f" ({section.snr_db:g} dB over the passes' maps)" if section.snr_db is not None else ""
    pairs = [
        ("Fiber", f"straight, at y = {section.offset:g} m, {site.ground.depth[0]:g} ± {site.ground.depth[1]:g} m deep"),
        (
            "Interrogator",
            f"gauge length {site.das.gauge_length:g} m, channels in view every {site.das.channel_spacing:g} m",
        ),
        ("Noise", f"{plan.planned.noise:.2g} 1/s per sample at {plan.planned.record.sampling_rate:g} Hz{said}, white"),
        ("Vehicles", f"{section.speeds[0]:g} to {section.speeds[1]:g} km/h, seen over {section.length:g} m"),
        ("Tracks", f"fixes of {section.fix_sigma:g} m at {section.frame_rate:g} Hz"),
        ("Anchors", f"{section.anchor_sigma:g} m"),
        ("Ground", f"shear modulus {section.shear_modulus:.2g} Pa, Poisson ratio {site.ground.poisson_ratio:g}"),
    ]
    rows = "".join(f"<dt>{name}</dt><dd>{escape(words)}</dd>" for name, words in pairs)
    return f'<section><h2>What is assumed</h2><dl class="facts">{rows}</dl></section>'
