"""diagnosis.json, ladder.json and the pages beside them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from solver.criticism.diagnosis import Diagnosis
from solver.criticism.growth import Rung
from solver.criticism.pages import Chapter, diagnosis_page, ladder_page, story_page
from solver.run.facts import strict
from vision.contract import InputError, writing_into

DIAGNOSIS, LADDER = "diagnosis.json", "ladder.json"


def diagnosis_facts(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json."""
    facts: dict[str, Any] = strict(asdict(diagnosis))
    return {"format": "roadfiber diagnosis 1", **facts}


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder, all or none."""
    with writing_into(folder) as scratch:
        for name, text in texts.items():
            (scratch / name).write_text(text, encoding="utf-8")


def write_diagnosis(folder: Path, diagnosis: Diagnosis, name: str) -> None:
    """Write diagnosis.json and diagnosis.html into a run folder."""
    facts = json.dumps(diagnosis_facts(diagnosis), allow_nan=False, indent=1)
    write_texts(folder, {DIAGNOSIS: facts, "diagnosis.html": diagnosis_page(diagnosis, name)})


def write_ladder(folder: Path, rungs: Sequence[Rung], name: str) -> None:
    """Write ladder.json and ladder.html into a run folder."""
    facts = strict({"format": "roadfiber ladder 1", "rungs": [asdict(rung) for rung in rungs]})
    texts = {LADDER: json.dumps(facts, allow_nan=False, indent=1), "ladder.html": ladder_page(rungs, name)}
    write_texts(folder, texts)


def read_ladder(folder: Path) -> list[Rung]:
    """Rungs of a run folder; none where no effect was added.

    Raises
    ------
    InputError
        If ladder.json is not what `write_ladder` wrote.
    """
    path = Path(folder) / LADDER
    if not path.is_file():
        return []
    try:
        rungs = json.loads(path.read_text(encoding="utf-8"))["rungs"]
        return [Rung(**rung | {name: tuple(rung[name]) for name in ("effects", "words")}) for rung in rungs]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: no ladder of a run ({error}); add the effect again") from error


def write_story(folder: Path, chapters: Sequence[Chapter], rungs: Sequence[Rung], name: str) -> None:
    """Write explain.html: each diagnosis, what was added, and the ladder."""
    write_texts(folder, {"explain.html": story_page(chapters, rungs, name)})
