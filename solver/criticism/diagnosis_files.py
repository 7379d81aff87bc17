"""diagnosis.json, the story of a model that grew, and the pages beside them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from solver.criticism.pages import Chapter, diagnosis_page, story_page
from solver.criticism.plain_verdict import headline
from solver.run.folder import check_target, write_judged
from solver.run.ladder_file import ladder_facts
from solver.run.report.joined import facts_in, join
from solver.run.run import Run
from solver.run.rung import Rung
from solver.run.strict_json import strict
from vision.contract import InputError, writing_into

if TYPE_CHECKING:
    from solver.criticism.finding import Diagnosis

DIAGNOSIS = "diagnosis.json"


def diagnosis_facts(diagnosis: "Diagnosis") -> dict[str, Any]:
    """The content of diagnosis.json."""
    facts: dict[str, Any] = strict(asdict(replace(diagnosis, fits={}, predicted={}, corridor=None)))
    for mine in ("fits", "predicted"):
        facts.pop(mine)
    corridor = diagnosis.corridor
    if corridor is not None:
        facts["corridor"] = strict(
            {
                "channel": corridor.channel,
                "added_sigma": np.sqrt(np.diagonal(corridor.covariance, axis1=1, axis2=2)).round(4),
                "widest": corridor.widest,
                "share": corridor.share,
            }
        )
    return {"format": "roadfiber diagnosis 1", "headline": headline(diagnosis), **facts}


def write_texts(folder: Path, texts: Mapping[str, str], run: Run | None = None) -> None:
    """Write files into a folder, all or none; join the pages of a run folder.

    Where the folder holds `run`, its route, corridor and first page follow what was found.
    """
    same = run is not None and facts_in(folder, "fit.json").get("created") == run.facts["created"]
    with writing_into(folder) as scratch:
        if run is not None and same:
            write_judged(scratch, run)
        for name, text in texts.items():
            (scratch / name).write_text(text, encoding="utf-8")
    if (folder / "fit.json").is_file():
        join(folder)


def write_diagnosis(folder: Path, diagnosis: "Diagnosis", name: str, run: Run | None = None) -> None:
    """Write diagnosis.json and diagnosis.html into a run folder; `run` is the one that it is of, see `write_texts`."""
    facts = json.dumps(diagnosis_facts(diagnosis), allow_nan=False, indent=1)
    texts = {DIAGNOSIS: facts, "diagnosis.html": diagnosis_page(diagnosis, name, run)}
    write_texts(folder, texts, run)


def check_out(out: Path, run: Run) -> None:
    """Refuse a folder to write a grown run into, where it holds the run to start from, or a rung below that.

    Raises
    ------
    InputError
        If `out` is the folder that `run` was opened from, however spelled, a folder above it, a rung of its ladder, or
        holds something else than a run.
    """
    source, target = run.folder, Path(out).resolve()
    if source is None:
        check_target(out)
        return
    if target.exists() and any(above.exists() and above.samefile(target) for above in (source, *source.parents)):
        raise InputError(f"--out {out}: holds the run you start from, {source}; give the name of a new folder")
    if target in {rung.folder for rung in run.rungs}:
        raise InputError(f"--out {out}: is a rung of the ladder of {source}; give the name of a new folder")
    check_target(out)


def story_facts(chapters: Sequence[Chapter], rungs: Sequence[Rung], out: Path) -> dict[str, Any]:
    """What `explain --json` prints: each diagnosis, what was done about it, and the ladder."""
    told = [diagnosis_facts(chapter.diagnosis) | {"done": chapter.done} for chapter in chapters]
    return {"format": "roadfiber story 1", "chapters": told, "ladder": ladder_facts(rungs, out)}


def write_story(folder: Path, chapters: Sequence[Chapter], rungs: Sequence[Rung], name: str) -> None:
    """Write explain.html: each diagnosis, what was added, and the ladder."""
    write_texts(folder, {"explain.html": story_page(chapters, rungs, name)})
