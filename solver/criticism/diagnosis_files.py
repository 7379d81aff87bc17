"""diagnosis.json, ladder.json and the pages beside them."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from solver.criticism.diagnosis import Diagnosis
from solver.criticism.growth import Rung, first_rung
from solver.criticism.pages import Chapter, diagnosis_page, ladder_page, story_page
from solver.run.facts import strict
from solver.run.folder import check_target
from solver.run.run import Run
from solver.run.stored import Maybe, Stored, Text, read_model
from vision.contract import InputError, writing_into

DIAGNOSIS, LADDER = "diagnosis.json", "ladder.json"
Format = Literal["roadfiber ladder 2"]
(LADDER_FORMAT,) = get_args(Format)


class RungFile(Stored):
    """A rung in ladder.json; fields as those of `Rung`."""

    effects: tuple[Text, ...]
    chi2_per_dof: Maybe
    held_out_chi2_per_dof: float | None
    noise_floor: float | None
    route_change: Maybe
    route_change_from_first: Maybe
    run: Text | None
    route: tuple[tuple[float, float, float, float], ...]
    words: tuple[Text, ...]


class LadderFile(Stored):
    """ladder.json."""

    format: Format
    rungs: Annotated[tuple[RungFile, ...], Field(min_length=1, max_length=1000)]


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


def ladder_facts(rungs: Sequence[Rung]) -> dict[str, Any]:
    """The content of ladder.json."""
    facts: dict[str, Any] = strict({"format": LADDER_FORMAT, "rungs": [asdict(rung) for rung in rungs]})
    return facts


def write_ladder(folder: Path, rungs: Sequence[Rung], name: str) -> None:
    """Write ladder.json and ladder.html into a run folder."""
    facts = json.dumps(ladder_facts(rungs), allow_nan=False, indent=1)
    write_texts(folder, {LADDER: facts, "ladder.html": ladder_page(rungs, name)})


def read_ladder(folder: Path) -> list[Rung]:
    """Rungs of a run folder; none where no effect was added. Nothing but ladder.json is looked at.

    Raises
    ------
    InputError
        If ladder.json is not what `write_ladder` wrote.
    """
    path = Path(folder) / LADDER
    if not path.exists():
        return []
    ladder = read_model(path, LadderFile, "delete it, and the ladder begins anew")
    return [Rung(**rung.model_dump()) for rung in ladder.rungs]


def ladder_from(folder: Path, run: Run, out: Path) -> list[Rung]:
    """The ladder that a run has or begins, with its rungs' folders as they are seen from the folder `out`."""
    here = Path(os.path.relpath(Path(folder).resolve(), Path(out).resolve()))
    rungs = read_ladder(folder) or [first_rung(run)]
    return [replace(r, run=None if r.run is None else os.path.normpath(here / r.run)) for r in rungs]


def check_out(out: Path, folder: Path) -> None:
    """Refuse a folder to write a grown run into, where it holds the run to start from, or a rung below that.

    Raises
    ------
    InputError
        If `out` is `folder`, however spelled, a folder above it, a rung of its ladder, or holds something else than a
        run.
    """
    source, target = Path(folder).resolve(), Path(out).resolve()
    if target.exists() and any(above.exists() and above.samefile(target) for above in (source, *source.parents)):
        raise InputError(f"--out {out}: holds the run you start from, {folder}; give the name of a new folder")
    if target in {Path(os.path.normpath(source / rung.run)) for rung in read_ladder(folder) if rung.run is not None}:
        raise InputError(f"--out {out}: is a rung of the ladder of {folder}; give the name of a new folder")
    check_target(out)


def story_facts(chapters: Sequence[Chapter], rungs: Sequence[Rung]) -> dict[str, Any]:
    """What `explain --json` prints: each diagnosis, what was done about it, and the ladder."""
    told = [diagnosis_facts(chapter.diagnosis) | {"done": chapter.done} for chapter in chapters]
    return {"format": "roadfiber story 1", "chapters": told, "ladder": ladder_facts(rungs)}


def write_story(folder: Path, chapters: Sequence[Chapter], rungs: Sequence[Rung], name: str) -> None:
    """Write explain.html: each diagnosis, what was added, and the ladder."""
    write_texts(folder, {"explain.html": story_page(chapters, rungs, name)})
