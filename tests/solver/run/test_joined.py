"""Pages of a run folder link to one another, and index.html joins them."""

import json
from pathlib import Path

import pytest

from solver.run.report.joined import INDEX, join
from solver.run.report.parts import page
from solver.run.trust import DIAGNOSE

EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run folder with a report and a diagnosis."""
    facts = {
        "name": "Elm Street",
        "headline": "The fiber runs.",
        "trust": {"grade": "good", "sentence": "See `x RUN`."},
    }
    (tmp_path / "fit.json").write_text(json.dumps(facts))
    for name in ("report.html", "diagnosis.html"):
        (tmp_path / name).write_text(page("a page", "<h1>here</h1>"))
    found = {"verdict": "missing-effect", "headline": "Gauge length.", "candidates": [{"effect": "gauge_length"}]}
    (tmp_path / "diagnosis.json").write_text(json.dumps(found))
    return tmp_path


def read(folder: Path, name: str = INDEX) -> str:
    return (folder / name).read_text(encoding="utf-8")


def test_each_page_links_to_those_that_are_there_and_to_no_other(folder: Path) -> None:
    join(folder, called="run")
    for name in ("report.html", "diagnosis.html", INDEX):
        text = read(folder, name)
        others = {"report.html", "diagnosis.html", INDEX} - {name}
        assert all(f'href="{other}"' in text for other in others)
        assert f'href="{name}"' not in text.split("</nav>")[0] and "compare.html" not in text
    (folder / "compare.html").write_text(page("later", ""))
    join(folder)
    assert 'href="compare.html"' in read(folder, "report.html") and read(folder, "report.html").count("<nav") == 1


def test_the_index_says_what_was_found_and_what_comes_next(folder: Path) -> None:
    join(folder, called="run")
    text = read(folder)
    assert "The fiber runs." in text and "Gauge length." in text and "<code>x run</code>" in text
    assert "<code>roadfiber add run gauge_length --out run-2</code>" in text
    assert "roadfiber compare run" in text and "roadfiber diagnose run" not in text


def test_what_a_diagnosis_says_is_not_asked_for_once_it_is_there(folder: Path) -> None:
    facts = json.loads((folder / "fit.json").read_text())
    facts["trust"]["sentence"] = f"Do not rely on it. Next: {DIAGNOSE}; check tracks."
    (folder / "fit.json").write_text(json.dumps(facts))
    join(folder, called="run")
    assert "Next: the diagnosis says what the model lacks; check tracks." in read(folder)
    (folder / "diagnosis.html").unlink()
    join(folder, called="run")
    assert "Next: <code>roadfiber diagnose run</code> says what the model lacks; check tracks." in read(folder)


def test_rungs_below_are_linked_within_the_disk_alone(folder: Path) -> None:
    places = ["../a", "javascript:alert(1)//", "/etc", None, 7, '"><script>', "."]
    rungs = [{"run": place, "effects": [EVIL], "chi2_per_dof": 1.2} for place in places]
    (folder / "ladder.json").write_text(json.dumps({"rungs": rungs}))
    (folder / "ladder.html").write_text(page("l", ""))
    join(folder)
    text = read(folder)
    assert 'href="./../a/index.html"' in text and "7 rungs: misfit from 1.200 to 1.200." in text
    assert 'href="javascript' not in text and 'href="/etc' not in text and "<script>" not in text and EVIL not in text


@pytest.mark.parametrize("text", ["", "[]", "{", '{"name": 3, "trust": [], "headline": null}', "[" * 100000])
def test_damaged_facts_leave_their_sentence_out(folder: Path, text: str) -> None:
    for name in ("fit.json", "diagnosis.json", "ladder.json", "compare.json"):
        (folder / name).write_text(text)
    join(folder)
    assert 'href="report.html"' in read(folder)


def test_markup_in_facts_is_text(folder: Path) -> None:
    facts = {"name": EVIL, "headline": EVIL, "trust": {"grade": EVIL, "sentence": f"`{EVIL}`"}}
    (folder / "fit.json").write_text(json.dumps(facts))
    evil = {"verdict": "missing-effect", "headline": EVIL, "candidates": [{"effect": f"`{EVIL}`"}]}
    (folder / "diagnosis.json").write_text(json.dumps(evil))
    join(folder, called=EVIL)
    assert EVIL not in read(folder) and "&lt;img" in read(folder)
