"""The report as one page that opens offline, on a phone, in the dark, and prints."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from vision.contract.figures import data_uri, svg
from vision.jitter import LIMIT, WINDOW
from vision.quality.classes import listed, tracks_by_class
from vision.quality.figures import NARROW, WIDE, class_figure, jitter_figure, route_figure
from vision.quality.measures import Measures, apart, mean_over
from vision.quality.verdict import Verdict, grade, typical_effect

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Truth:
    """What is true.

    Parameters
    ----------
    tracks, others : [fix] of the classes that are compared, and of the rest, parked vehicles among it
    left_out : tracks of the rest by class
    """

    tracks: "pd.DataFrame"
    others: "pd.DataFrame"
    left_out: dict[str, int]


@dataclass(frozen=True)
class Content:
    """What the page shows.

    Parameters
    ----------
    found : figures of every setting
    verdict : which to use
    truth : where it is known
    left_out : a line on each table that could not be compared
    heat : PNG of every setting's heat map, by name; empty where there are no boxes
    inputs : (role, file name, SHA-256) of what was read
    title : of the video or the tables
    created : when, as text
    version : of roadfiber
    """

    found: Sequence[Measures]
    verdict: Verdict
    truth: Truth | None
    left_out: Sequence[str]
    heat: dict[str, bytes]
    inputs: Sequence[tuple[str, str, str]]
    title: str
    created: str
    version: str

    def notes(self) -> list[str]:
        """Sentences on what was compared, and what was not."""
        notes = [f"Left out: {line}" for line in self.left_out]
        if self.truth:
            compared = listed(tracks_by_class(self.truth.tracks))
            rest = f"; left out of it: {listed(self.truth.left_out)}" if self.truth.left_out else ""
            notes.append(f"Compared with {compared} of the truth{rest}")
            strange = [
                one.setting.name for one in self.found if one.scores and one.scores.misses == one.scores.boxes > 0
            ]
            if strange:
                notes.append(
                    f"No fix of {', '.join(strange)} meets one of the truth: are frames counted from the same one, "
                    "places in one frame, and boxes stated by the same corner?"
                )
        for setting in (one.setting for one in self.found):
            if setting.others:
                notes.append(f"{setting.name}: left out {listed(setting.others)}")
        use = next(one.setting for one in self.found if one.setting.name == self.verdict.use)
        for other in (one.setting for one in self.found if one.setting is not use):
            if ahead := apart(use, other):
                ways = " and ".join(f"{meters:+.2f} m where they drive {way}" for way, meters in ahead.items())
                notes.append(f"{use.name} puts the vehicles ahead of where {other.name} does by {ways}")
        clipped = {one.setting.name: one.setting.clipped for one in self.found if one.setting.clipped}
        if clipped:
            numbers = ", ".join(f"{count} of {name}" for name, count in clipped.items())
            notes.append(f"Boxes that reached beyond the picture and were clipped to it: {numbers}")
        return notes


def number(value: float | None, unit: str = "", digits: int = 2) -> str:
    """Text of a number with its unit; a dash where it is not known.

    >>> number(0.1234, "m"), number(float("nan"), "m"), number(3.0, digits=0)
    ('0.12 m', '–', '3')
    """
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}f} {unit}".strip()


def rows(found: Sequence[Measures]) -> list[tuple[str, str, Callable[[Measures], str]]]:
    """Rows of the comparison: heading, what it means, text of a setting."""
    unit = found[0].setting.unit
    always: list[tuple[str, str, Callable[[Measures], str]]] = [
        ("Vehicles", "tracks, of one class each", lambda m: str(m.tracks)),
        ("by class", "after class interpolation", lambda m: listed(m.by_class)),
        ("by detected class", "before; a track counts for all it showed", lambda m: listed(m.by_detected_class)),
        ("Frames per track", "mean", lambda m: number(m.frames_per_track, digits=1)),
        ("Longest unbroken fragment", "frames without a miss", lambda m: str(m.fragment)),
        ("Unbroken per track", "mean of the longest, frames", lambda m: number(m.mean_fragment, digits=1)),
        ("Breaks", "runs of missed frames inside tracks", lambda m: str(m.breaks)),
        ("Missed", "share of frames inside tracks", lambda m: number(100 * m.missed, "%", 1)),
        ("Class switches", "and tracks that have any", lambda m: f"{m.switches} in {m.switching}"),
        ("Jitter before", "mean of moving vehicles", lambda m: number(mean_over(m.before), unit)),
        ("Jitter after", "frames interpolated", lambda m: number(m.jitter, unit)),
    ]
    metric: list[tuple[str, str, Callable[[Measures], str]]] = [
        *not_placed(found),
        ("Jitter floor", "of parked vehicles", lambda m: f"{number(m.floor, 'm')} ({m.parked})" if m.parked else "–"),
        ("Worth for the fiber", "35 cm rule, and the route", grade),
        ("Effect on the route", "1 sigma sideways, as stated", lambda m: number(typical_effect(m), "m", 3)),
    ]
    scored: list[tuple[str, str, Callable[[Measures], str]]] = [
        (name, meaning, lambda m, key=key: number(getattr(m.scores, key), digits=3))  # type: ignore[misc]
        for name, meaning, key in (
            ("MOTA", "misses, false alarms, switches", "mota"),
            ("IDF1", "boxes under the right number", "idf1"),
            ("HOTA", "detection and association", "hota"),
        )
        if all(m.scores for m in found)
    ]
    speed = [("Speed", "frames per second, all steps", lambda m: number((m.setting.speed or {}).get("all"), digits=0))]
    known = any(m.setting.speed for m in found)
    return always + (metric if unit == "m" else []) + scored + (speed if known else [])


def not_placed(found: Sequence[Measures]) -> list[tuple[str, str, Callable[[Measures], str]]]:
    """Rows of how many detected fixes were not placed on the road, in all and by cause; none where none are known."""
    causes = list(dict.fromkeys(cause for m in found for cause in m.not_placed))
    if not causes:
        return []

    def text(wanted: Sequence[str]) -> Callable[[Measures], str]:
        return lambda m: "–" if m.setting.dropped is None else str(sum(m.not_placed.get(cause, 0) for cause in wanted))

    total = ("Not placed", "detected fixes; they are not misses", text(causes))
    return [total, *(("", cause, text([cause])) for cause in causes)]


def breakable(name: str) -> str:
    """HTML of a name that may break after a sign.

    >>> breakable("yolo_11.n")
    'yolo_<wbr>11.<wbr>n'
    """
    return re.sub(r"([_.-])", r"\1<wbr>", escape(name))


def comparison(content: Content) -> str:
    """Table of all settings side by side, the one to use marked and first: on the screen, however many there are."""
    found = sorted(content.found, key=lambda m: m.setting.name != content.verdict.use)
    heads = "".join(
        f"<th{' class=use' if m.setting.name == content.verdict.use else ''}>{breakable(m.setting.name)}</th>"
        for m in found
    )
    body = "".join(
        f"<tr><td>{escape(head)} <small>{escape(meaning)}</small></td>"
        + "".join(f"<td>{escape(text(m))}</td>" for m in found)
        + "</tr>"
        for head, meaning, text in rows(found)
    )
    return f"<table><tr><th></th>{heads}</tr>{body}</table>"


def headline(content: Content) -> str:
    """One sentence: what to use and what it is worth."""
    only = len(content.found) == 1
    answer = {
        "good": "good enough for the fiber",
        "fair": "good enough for the fiber",
        "weak": "usable in part",
        "poor": "not good enough for the fiber",
        "unknown": "in pixels only" if content.found[0].setting.unit == "px" else "too few fixes to judge",
    }[content.verdict.grade]
    name = content.verdict.use
    return f"{name}: {answer}" if only else f"Use {name}: {answer}"


def key_figures(content: Content) -> list[tuple[str, str, str]]:
    """Figures at the top: label, value, what it means."""
    best = next(m for m in content.found if m.setting.name == content.verdict.use)
    unit = best.setting.unit
    worst = best.after[best.after["fixes"] > 0]["mean"].max()
    figures = [
        ("Vehicles followed", str(best.tracks), f"{best.frames_per_track:.0f} frames each"),
        ("Jitter", number(best.jitter, unit, 2 if unit == "m" else 1), f"worst bin {number(worst, unit)}"),
    ]
    if unit == "m":
        effect = "of the route, sideways, before any fit"
        figures.append(("Predicted 1 sigma", number(typical_effect(best), "m", 3), effect))
    else:
        figures.append(("Unbroken", f"{best.mean_fragment:.0f}", "frames per track, mean of the longest"))
    if best.scores:
        figures.append(("HOTA", number(best.scores.hota, digits=3), f"MOTA {best.scores.mota:.3f}"))
    else:
        figures.append(("Missed", f"{100 * best.missed:.1f} %", f"{best.breaks} runs of missed frames"))
    return figures


def both_sizes(draw: Callable[[int], Figure]) -> str:
    """Draw a figure for wide and for narrow screens."""
    return f'<div class="wide">{svg(draw(WIDE))}</div><div class="narrow">{svg(draw(NARROW))}</div>'


def route_section(found: Sequence[Measures]) -> str:
    """What position errors do to the route; nothing in pixels."""
    if found[0].effect is None:
        return ""
    return (
        "<section><h2>What it does to the route</h2>"
        "<p>Strain depends on where the fiber is relative to the vehicle, so an error of all positions shifts the "
        "route by itself and independent errors average: σ<sub>route</sub> = σ / √(P m), with P vehicles passing "
        "(small figures), and m independent fixes while one strains a channel. Dotted: σ from the scatter of the "
        "fixes. Full: σ as the tables state it, taken for common to a whole pass (m = 1). The truth lies between. An "
        "error of the calibration comes on top, for every vehicle alike.</p>"
        f"{both_sizes(lambda width: route_figure(found, width))}</section>"
    )


def heat_section(heat: dict[str, bytes]) -> str:
    """Heat maps side by side."""
    if not heat:
        return ""
    pictures = "".join(
        f'<figure><figcaption>{escape(name)}</figcaption><img alt="heat map of {escape(name)}" src="{data_uri(png)}">'
        "</figure>"
        for name, png in heat.items()
    )
    return (
        "<section><h2>Where vehicles are seen</h2><p>Density of the lower edges of detected boxes, its square root "
        "from dark to bright. Gaps in a lane are where vehicles are missed: behind trees, or too far off.</p>"
        f'<div class="pictures">{pictures}</div></section>'
    )


def next_words(content: Content) -> str:
    """What to do with the tracks that are to be used."""
    use = escape(content.verdict.use)
    if content.found[0].setting.unit != "m":
        return (
            "<code>roadfiber calibrate ground points.csv --video street.mp4</code> makes the calibration that turns "
            "pixels into meters; track once more with it."
        )
    return (
        f"Name the file of {use} in site.toml, as <code>files</code> under <code>[trajectories]</code>; "
        "<code>roadfiber locate site.toml --out run</code> then finds the fiber by these tracks."
    )


def render(content: Content) -> str:
    """Return the page as HTML that needs no other file."""
    template = Template(files("vision.quality").joinpath("template.html").read_text(encoding="utf-8"))
    found, unit = content.found, content.found[0].setting.unit
    figures = "".join(
        f"<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd><dd>{escape(note)}</dd></div>"
        for label, value, note in key_figures(content)
    )
    line = f" The broken line is the limit of {100 * LIMIT:.0f} cm." if unit == "m" else ""
    inputs = "".join(
        f"<dt>{escape(role)}</dt><dd>{escape(name)}, SHA-256 <code>{code}</code></dd>"
        for role, name, code in content.inputs
    )
    return template.substitute(
        title=escape(content.title),
        headline=escape(headline(content)),
        grade=content.verdict.grade,
        verdict=escape(f"{content.verdict.words} {content.verdict.because[0].upper()}{content.verdict.because[1:]}."),
        next=next_words(content),
        rule=escape(f"Chosen by {content.verdict.rule}."),
        notes="".join(f"<li>{escape(note)}</li>" for note in content.notes()),
        key_figures=figures,
        comparison=comparison(content),
        window=str(WINDOW),
        limit=line,
        jitter=both_sizes(lambda width: jitter_figure(found, width)),
        route=route_section(found),
        heat=heat_section(content.heat),
        classes=both_sizes(lambda width: class_figure([m.setting for m in found], width)),
        inputs=inputs,
        created=escape(content.created),
        version=escape(content.version),
    )
