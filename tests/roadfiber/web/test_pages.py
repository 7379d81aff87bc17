"""Every page of a run: what others wrote is text on it, it loads nothing from a network, and is 8 MB at most."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import roadfiber as rf
from solver.criticism.comparison.compare import compare
from solver.criticism.comparison.comparison_page import render as comparison_page
from solver.criticism.finding import Diagnosis
from solver.criticism.pages import Chapter, diagnosis_page, story_page
from solver.run.report.joined import PAGES as JOINED
from solver.run.report.joined import index_page, join
from solver.run.report.ladder_page import ladder_page
from solver.run.report.report_page import render as report_page
from solver.run.run import Run
from solver.run.rung import Glimpse, Rung
from tests.offline_pages import EVIL, LOADED, is_whole, tells
from tests.solver.criticism.test_plain_verdict import candidate, diagnosis


def suspected() -> Diagnosis:
    """A diagnosis whose every word is a user's."""
    one = candidate("gauge_length", confounded_with=(EVIL,), route_change=0.4)
    return diagnosis("missing-effect", replace(one, told=replace(one.told, title=EVIL, sentence=EVIL, unit=EVIL)))


def rungs() -> list[Rung]:
    route = ((7.0, 0.1, 4.2, 1.0), (8.0, 1.1, 4.2, 1.0))
    glimpse = Glimpse(EVIL, ((1.0, None), (0.5, -2.0)), ((EVIL, 0.1, 2.0),))
    first = Rung((), 1.4, 1.5, 1.0, 0.0, 0.0, None, route, (), glimpse)
    return [first, replace(first, effects=(EVIL,), chi2_per_dof=1.1, folder=Path(EVIL), words=(EVIL,))]


def index(run: Run) -> str:
    assert run.folder is not None
    return index_page(run.folder, ["report.html", "compare.html"], EVIL)


PAGES: dict[str, Callable[[Run], str]] = {
    "report": report_page,
    "comparison": lambda run: comparison_page(compare(run), run),
    "diagnosis": lambda run: diagnosis_page(suspected(), EVIL),
    "diagnosis of a run": lambda run: diagnosis_page(suspected(), EVIL, run),
    "ladder": lambda run: ladder_page(rungs(), EVIL),
    "story": lambda run: story_page([Chapter(suspected(), EVIL)], rungs(), EVIL),
    "index": index,
}


@pytest.fixture(scope="module")
def evil(hidden: Path) -> Run:
    """A run whose names are all markup."""
    run = rf.open(hidden)
    facts: dict[str, Any] = run.facts | {"name": EVIL, "warnings": [EVIL], "headline": EVIL, "effects": [EVIL]}
    facts |= {"trust": run.facts["trust"] | {"sentence": EVIL}}
    passes = [replace(one, track_id=EVIL, vehicle_class=EVIL) for one in run.passes]
    return replace(run, facts=facts, passes=passes, anchors=[replace(one, name=EVIL) for one in run.anchors])


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_one_small_file_on_which_names_are_text(name, evil):
    text = PAGES[name](evil)
    assert tells(text) and is_whole(text) and '<details class="terms">' in text


def test_every_page_of_a_run_folder_names_what_comes_next_and_links_to_all_others(hidden, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(hidden, folder)
    run = rf.open(folder)
    written = {"compare.html": "comparison", "diagnosis.html": "diagnosis of a run", "ladder.html": "ladder"}
    for file, name in (written | {"explain.html": "story"}).items():
        (folder / file).write_text(PAGES[name](run), encoding="utf-8")
    join(folder)
    pages = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.html")}
    assert set(pages) == {file for file, *_ in JOINED} - {"stretches.html"}
    for file, text in pages.items():
        assert is_whole(text), file
        assert set(re.findall(r'href="([^"]+[.]html)"', text)) >= set(pages) - {file}, file


def test_what_is_fetched_is_found():
    assert LOADED.search('<script src="https://cdn.example/x.js">') and LOADED.search("url(//fonts.example/a)")
    assert not LOADED.search('<a href="https://example.org">a link</a>')
