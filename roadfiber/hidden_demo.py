"""The demo with something hidden in its record: which physics, what the commands make of it, and the envelope."""

import json
import shlex
from collections.abc import Callable, Mapping
from dataclasses import asdict
from html import escape
from math import isfinite
from pathlib import Path
from typing import Any

from solver.catalogue.catalogue import title_of
from solver.run.ladder_file import read_ladder
from solver.run.report.joined import PAGES
from solver.run.report.ladder_page import headline as ladder_headline
from solver.run.report.ladder_page import ladder_figure, thumbnails
from solver.run.report.parts import next_section, page, with_commands
from solver.run.strict_json import strict
from solver.run.titles import lower
from solver.simulator import route_error
from solver.simulator.check import RouteError
from solver.simulator.effects import EFFECTS, SHOWN, effect_rng
from solver.simulator.survey_files import TRUTH
from vision.contract import InputError, writing
from vision.contract.figures import svg

#: Asks for an effect by chance, one of `solver.simulator.effects.SHOWN`.
ANY = "any"
#: Of the range of plausible amounts, the part that amounts are drawn from: what is too small shows nothing.
LEAST = 0.6
#: Run folders: as located, and with what was found.
FIRST, SECOND = "run", "run-2"
#: What each page shows.
SHOWN_BY = {
    "report.html": "route on the map and in the street",
    "compare.html": "measurement, the model and what is left",
    "diagnosis.html": "diagnosis",
    "ladder.html": "error ladder",
}


def hidden(wanted: str, seed: int) -> dict[str, float]:
    """What to hide: name and amount.

    Parameters
    ----------
    wanted : NAME, NAME=AMOUNT, or "any", which the seed chooses and nobody is told
    seed : draws what is not given

    Raises
    ------
    InputError
        If the simulator knows no such effect, or the amount is no number.

    >>> hidden("gauge_length=0.15", 4)
    {'gauge_length': 0.15}
    """
    name, given, number = wanted.partition("=")
    rng = effect_rng(seed, "hidden demo")
    if name == ANY:
        name = str(rng.choice(SHOWN))
    if name not in EFFECTS:
        raise InputError(f"--hide {wanted}: no such effect; give one of {', '.join(EFFECTS)}, or {ANY}")
    if given:
        try:
            return {name: float(number)}
        except ValueError as error:
            raise InputError(f"--hide {wanted}: must be NAME or NAME=NUMBER, such as gauge_length=0.15") from error
    low, high = EFFECTS[name].plausible
    return {name: round(float(rng.uniform(low + LEAST * (high - low), high)), 3)}


def facts_in(path: Path) -> dict[str, Any]:
    """What a JSON file that a command wrote says."""
    facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return facts


def question(out: Path, run: Callable[..., None]) -> str:
    """Compare, diagnose, add what is found, and draw the ladder, each by its command; what was not done, in words.

    Parameters
    ----------
    out : folder of the demo, whose `run` is located
    run : runs a command, given its words
    """
    first, second = out / FIRST, out / SECOND
    run("compare", first)
    run("diagnose", first)
    found = facts_in(first / "diagnosis.json")
    if found["verdict"] != "missing-effect":
        return f"Nothing was added: the verdict is {found['verdict']}."
    try:
        run("add", first, found["candidates"][0]["effect"], "--out", second)
    except InputError as error:
        return f"Nothing was added: {error}."
    run("ladder", second)
    return ""


def errors(out: Path) -> dict[str, RouteError]:
    """How far the route of each rung is from the true one, by what its model has."""
    found = {"as located": route_error(out / FIRST / "route.csv", out / TRUTH)}
    if (out / SECOND / "route.csv").is_file():
        names = ", ".join(map(title_of, read_ladder(out / SECOND)[-1].effects[-1:]))
        found[f"with {names}"] = route_error(out / SECOND / "route.csv", out / TRUTH)
    return found


def answer(out: Path) -> str:
    """What was hidden, and how far from the truth each rung was, in a sentence."""
    effects = facts_in(out / TRUTH)["switches"]
    names = ", ".join(f"{lower(title_of(name))} ({name} = {effects[name]:g})" for name in effects if name in EFFECTS)
    far = "; ".join(f"{where}, {one.words}" for where, one in errors(out).items())
    return f"hidden was: {names}. The route was off by: {far}. {outcome(out)}"


def outcome(out: Path) -> str:
    """Whether the true error fell with what was added; empty where nothing was."""
    first, *more = errors(out).values()
    if not more:
        return ""
    if not (first.channels and more[-1].channels):
        before, after = (f"{one.in_view:.2f} m at most in view" for one in (first, more[-1]))
        return f"A fit that locates no place claims none; it was {before} before, {after} after."
    fell = "fell" if more[-1].mean < first.mean else "did not fall"
    return f"The true error {fell}: {first.mean:.2f} m on average before, {more[-1].mean:.2f} m after."


def told(out: Path, undone: str) -> dict[str, Any]:
    """The same for machines."""
    diagnosis, known = facts_in(out / FIRST / "diagnosis.json"), facts_in(out / TRUTH)
    named = diagnosis["candidates"][0]["effect"] if diagnosis["candidates"] else None
    return {
        "hidden": {name: known["switches"][name] for name in known["switches"] if name in EFFECTS},
        "verdict": diagnosis["verdict"],
        "named": named,
        "undone": undone,
        "errors": {name: strict({"unit": "m", **asdict(one)}) for name, one in errors(out).items()},
        "story": str(out / "index.html"),
    }


def section(number: int, heading: str, text: str, link: str = "", more: str = "") -> str:
    """A chapter of the story."""
    there = f'<p><a href="{link}">Look at the {SHOWN_BY[link.rpartition("/")[2]]}</a></p>' if link else ""
    return f"<section><h2>{number}. {escape(heading)}</h2><p>{text}</p>{more}{there}</section>"


def cells(error: RouteError) -> str:
    """Lengths of an error, m, as cells of a table; "-" where no place is located."""
    lengths = (error.mean, error.largest, error.largest_lateral, error.largest_depth, error.in_view)
    return "".join(f"<td>{one:.2f}</td>" if isfinite(one) else "<td>-</td>" for one in lengths)


def envelope(out: Path) -> str:
    """What was hidden, and the true error of each rung; closed until it is opened."""
    known = facts_in(out / TRUTH)
    lines = "".join(
        f"<p><b>{escape(title_of(name))}</b>: <code>{escape(name)} = {known['switches'][name]:g}</code> "
        f"({escape(EFFECTS[name].meaning)}).</p>"
        for name in known["switches"]
        if name in EFFECTS
    )
    rows = "".join(
        f"<tr><td>{escape(name)}</td>{cells(one)}<td>{one.inside} of {one.channels}</td></tr>"
        for name, one in errors(out).items()
    )
    columns = ("route", "mean", "largest", "on the map", "in depth", "largest in view", "in the 95 % corridor")
    head = "".join(f"<th>{name}</th>" for name in columns)
    return (
        "<section><h2>The envelope</h2><p>Only the simulator knew this. Guess first.</p><details><summary>Open it"
        f"</summary>{lines}<p>How far the route was from the true one, over all channels that it locates, m:</p>"
        f"<table><tr>{head}</tr>{rows}</table><p>{outcome(out)}</p></details></section>"
    )


def story_page(out: Path, undone: str) -> str:
    """index.html of a demo with something hidden."""
    fit, found = facts_in(out / FIRST / "fit.json"), facts_in(out / FIRST / "diagnosis.json")
    compared: Mapping[str, Any] = facts_in(out / FIRST / "compare.json")
    trust = with_commands(fit["trust"]["sentence"].replace("RUN", FIRST))
    said = f"{escape(found['headline'])} {found_words(found)}"
    parts = [
        section(
            1,
            "A street was filmed, and its fiber recorded",
            "A camera saw vehicles go by, a fiber under the street recorded them. Into the record went physics that "
            "the model does not have; which is in the envelope at the end.",
        ),
        section(2, "The fiber was located", f"{escape(fit['headline'])} {trust}", f"{FIRST}/report.html"),
        section(3, "Model and measurement were compared", escape(compared["verdict"]), f"{FIRST}/compare.html"),
        section(4, "What is missing was asked", said, f"{FIRST}/diagnosis.html"),
    ]
    if undone:
        parts.append(section(5, "It was left at that", escape(undone)))
    else:
        rungs, second = read_ladder(out / SECOND), facts_in(out / SECOND / "fit.json")
        figure, fell = svg(ladder_figure(rungs)), rungs[-1].chi2_per_dof < rungs[-2].chi2_per_dof
        trust = with_commands(second["trust"]["sentence"].replace("RUN", SECOND))
        text = f"{escape(ladder_headline(rungs))}. {trust}"
        done = "It was put in, and the misfit fell" if fell else "It was put in, and the misfit did not fall"
        parts.append(section(5, done, text, f"{SECOND}/ladder.html", figure))
        parts.append(thumbnails(rungs))
    head = (
        "<header><p>roadfiber demo</p><h1>A street with something hidden in it</h1><p>The same commands that work on a "
        "real street, on one whose answer is known.</p></header>"
    )
    body = page_links(out) + head + "".join(parts) + envelope(out) + next_section(next_lines(out))
    return page("roadfiber demo: something hidden", body)


def page_links(out: Path) -> str:
    """Links to all pages of both runs, beside this one."""
    there = [
        (f"{run}/{file}", f"{name}{again}")
        for run, again in ((FIRST, ""), (SECOND, ", with what was added"))
        for file, name, _ in PAGES
        if file in SHOWN_BY and (out / run / file).is_file()
    ]
    items = "".join(f'<a href="{file}">{name}</a>' for file, name in there)
    return f'<nav class="pages" aria-label="Pages of this demo"><b>Story</b>{items}</nav>'


def next_lines(out: Path) -> list[str]:
    """What to do after the demo."""
    last = out / (SECOND if (out / SECOND / "fit.json").is_file() else FIRST)
    return [
        f"`roadfiber workbench {shlex.quote(str(last)).replace('`', '')}` does the same by hand, in the browser.",
        "`roadfiber demo --hide pulse_width --out demo-2` hides something else; `roadfiber effects` lists what.",
        "`roadfiber start FOLDER` makes the site.toml of a street of your own.",
    ]


def found_words(found: Mapping[str, Any]) -> str:
    """What ignoring the first candidate does to the route."""
    first = found["candidates"][0] if found["candidates"] else {}
    moved = first.get("route_change")
    named = found["verdict"] == "missing-effect" and moved is not None
    return f"Ignored, it moves the route by up to {moved:.2f} m." if named else ""


def write_story(out: Path, undone: str) -> None:
    """Write index.html into the folder of a demo."""
    text = story_page(out, undone)
    with writing(out / "index.html") as temporary:
        temporary.write_text(text, encoding="utf-8")
