"""Pages of a run folder are joined: each links to its siblings; index.html says what there is and what comes next."""

import json
import re
import shlex
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from solver.run.report.parts import EXPORT, next_section, page, with_commands
from solver.run.trust import DIAGNOSE
from vision.contract import writing_into

INDEX = "index.html"
#: Pages of a run folder in the order of reading: file, what links call it, what it shows.
PAGES = (
    (INDEX, "Overview", ""),
    ("report.html", "Route", "Where the fiber is, how sure that is, and whether the model explains the measurement."),
    ("compare.html", "Comparison", "Model against measurement: where, when and how they differ."),
    ("diagnosis.html", "Diagnosis", "Which physical effect the model lacks, if any, and what that does to the route."),
    ("stretches.html", "Stretches", "What each stretch of a long fiber lacks, and all of them together."),
    ("ladder.html", "Ladder", "How the error fell and the route moved with each effect that was added."),
    ("explain.html", "Story", "What the model lacked, step by step."),
)
#: Pages that say what the model lacks.
DIAGNOSED = {"diagnosis.html", "stretches.html"}
MARKED = re.compile("<!-- pages -->.*?<!-- /pages -->", re.DOTALL)
#: How the format of a drive's run begins; it has one car, and no effects to compare.
OF_A_DRIVE = "roadfiber drive"
#: Bytes of a JSON file that is looked at for a sentence.
LARGEST = 2**26


def links(here: str, there: list[str]) -> str:
    """Links to all pages of a folder, on one of them."""
    items = "".join(
        f"<b>{name}</b>" if file == here else f'<a href="{file}">{name}</a>' for file, name, _ in PAGES if file in there
    )
    return f'<!-- pages --><nav class="pages" aria-label="Pages of this run">{items}</nav><!-- /pages -->'


def join(folder: Path, called: str | None = None) -> None:
    """Write index.html into a run folder, and links between its pages into each of them, all or none.

    Parameters
    ----------
    folder : with fit.json of a run
    called : what the folder will be called, where it has another name yet
    """
    texts = {
        file: (folder / file).read_text(encoding="utf-8")
        for file, _, _ in PAGES
        if file != INDEX and (folder / file).is_file()
    }
    texts[INDEX] = index_page(folder, list(texts), called or Path(folder).resolve().name)
    there = [file for file, _, _ in PAGES if file in texts]
    with writing_into(folder) as scratch:
        for file, text in texts.items():
            joined = links(file, there).join(MARKED.split(text, maxsplit=1))
            (scratch / file).write_text(joined, encoding="utf-8")


def facts_in(folder: Path, name: str) -> Mapping[str, Any]:
    """What a JSON file of the folder says; nothing where it is not there or cannot be read."""
    path = folder / name
    try:
        if path.stat().st_size > LARGEST:
            return {}
        facts = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return facts if isinstance(facts, dict) else {}


def text_in(facts: Mapping[str, Any], *names: str) -> str:
    """A text of facts, within tables of them; "" where there is none."""
    value: Any = facts
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    return value if isinstance(value, str) else ""


def said(folder: Path) -> dict[str, str]:
    """The sentence of each page that has one."""
    rungs = rows_in(facts_in(folder, "ladder.json"), "rungs")
    ends = [one.get("chi2_per_dof") for one in (rungs[0], rungs[-1])] if rungs else []
    fell = all(isinstance(one, int | float) for one in ends)
    return {
        "compare.html": text_in(facts_in(folder, "compare.json"), "verdict").partition(". ")[0].rstrip(".") + ".",
        "diagnosis.html": text_in(facts_in(folder, "diagnosis.json"), "headline"),
        "stretches.html": text_in(facts_in(folder, "stretches.json"), "headline"),
        "ladder.html": f"{len(rungs)} rungs: misfit from {ends[0]:.3f} to {ends[1]:.3f}." if ends and fell else "",
    }


def rows_in(facts: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    """A list of tables; none where it is anything else."""
    rows = facts.get(name)
    return rows if isinstance(rows, list) and all(isinstance(one, dict) for one in rows) else []


def next_lines(folder: Path, there: list[str], run: str) -> list[str]:
    """The commands that come next, for a run folder of some name."""
    if text_in(facts_in(folder, "fit.json"), "format").startswith(OF_A_DRIVE):
        return [EXPORT.replace("RUN", run)]
    found = facts_in(folder, "diagnosis.json")
    lines = []
    if "compare.html" not in there:
        lines.append(f"`roadfiber compare {run}` shows where, when and how model and measurement differ.")
    if not DIAGNOSED & set(there):
        lines.append(f"`roadfiber diagnose {run}` says which physical effect the model lacks, if any.")
    first = rows_in(found, "candidates")
    if found.get("verdict") == "missing-effect" and first:
        effect = shlex.quote(text_in(first[0], "effect")).replace("`", "")
        lines.append(f"`roadfiber add {run} {effect} --out {run}-2` puts it into the model and fits everything again.")
    if found.get("verdict") == "adequate":
        lines.append(EXPORT.replace("RUN", run))
    return [
        *lines,
        f"`roadfiber workbench {run}` shows all of it in the browser, to question and to add effects by hand.",
    ]


def rung_links(folder: Path) -> str:
    """Links to the run folders of the rungs below, those that are there."""
    from solver.catalogue.catalogue import title_of

    items = []
    for rung in rows_in(facts_in(folder, "ladder.json"), "rungs")[:-1]:
        at, effects = rung.get("run"), rung.get("effects")
        if isinstance(at, str) and not Path(at).is_absolute() and "\0" not in at:
            names = [title_of(str(one)) for one in effects] if isinstance(effects, list) else []
            label = escape(", ".join(names) or "the start")
            items.append(f'<li><a href="./{quote(at)}/{INDEX}">{label}</a></li>')
    return f"<section><h2>Rungs below</h2><ul>{''.join(items)}</ul></section>" if items else ""


def index_page(folder: Path, there: list[str], called: str) -> str:
    """index.html of a run folder with these pages, one that is called so."""
    facts, words = facts_in(folder, "fit.json"), said(folder)
    name, run = text_in(facts, "name"), shlex.quote(called).replace("`", "")
    grade = text_in(facts, "trust", "grade")
    sentence = text_in(facts, "trust", "sentence")
    if DIAGNOSED & set(there):
        sentence = sentence.replace(DIAGNOSE, "the diagnosis says what the model lacks")
    trust = with_commands(sentence.replace("RUN", run))
    cards = "".join(
        f'<a class="card" href="{file}"><b>{title}</b><span>{escape(words.get(file) or about)}</span></a>'
        for file, title, about in PAGES
        if file in there
    )
    body = (
        f"<header><p>{escape(name)} · run folder {escape(called)}</p><h1>{escape(text_in(facts, 'headline'))}</h1>"
        f'<p class="grade {escape(grade)}" style="color: var(--ink)">{trust}</p></header>'
        f'<div class="cards">{cards}</div>{next_section(next_lines(folder, there, run))}{rung_links(folder)}'
        "<section><h2>Files</h2><p><code>route.csv</code> has one row per channel with sigmas, latitude and longitude, "
        "<code>route.geojson</code> the route and its corridor, <code>fit.json</code> every fitted number.</p>"
        "</section>"
    )
    return page(f"{name}: run {called}", body)
