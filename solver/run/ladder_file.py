"""ladder.json: the rungs below a run, and the page beside it. It holds all that the next rung needs."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from solver.run.read_stored import read_model
from solver.run.rung import Glimpse, Rung
from solver.run.stored_types import Maybe, Stored, Text
from solver.run.strict_json import strict
from vision.contract import writing_into

LADDER = "ladder.json"
Format = Literal["roadfiber ladder 2"]
(FORMAT,) = get_args(Format)


class GlimpseFile(Stored):
    """`glimpse`; fields as those of `Glimpse`."""

    track: Text
    residual: Annotated[tuple[Annotated[tuple[float | None, ...], Field(max_length=64)], ...], Field(max_length=64)]
    anchors: tuple[tuple[Text, float, float], ...]


class RungFile(Stored):
    """A rung in ladder.json; fields as those of `Rung`, but `run`.

    Attributes
    ----------
    effects : in the model
    chi2_per_dof, held_out_chi2_per_dof : misfit, and that of passes held out
    noise_floor : what noise alone would leave
    route_change, route_change_from_first : largest way that the route moved from the rung below, and from the first, m
    run : its folder, seen from that of the ladder; null where it was not kept
    route : channel, x, y, z (m) of some channels
    words : what was added and what came of it
    glimpse : one vehicle's residual and the anchors
    """

    effects: tuple[Text, ...]
    chi2_per_dof: Maybe
    held_out_chi2_per_dof: float | None
    noise_floor: float | None
    route_change: Maybe
    route_change_from_first: Maybe
    run: Text | None
    route: tuple[tuple[float, float, float, float], ...]
    words: tuple[Text, ...]
    glimpse: GlimpseFile | None = None


class LadderFile(Stored):
    """ladder.json: the error ladder of a run, its model growing effect by effect.

    Attributes
    ----------
    format : of the file
    rungs : lowest first
    """

    format: Format
    rungs: Annotated[tuple[RungFile, ...], Field(min_length=1, max_length=1000)]


def label(folder: Path | None, seen_from: Path) -> str | None:
    """A rung's folder as ladder.json names it; None where it was not kept, or the new run takes its place."""
    label = None if folder is None else os.path.relpath(folder, seen_from)
    return None if label == "." else label


def ladder_facts(rungs: Sequence[Rung], seen_from: Path) -> dict[str, Any]:
    """The content of ladder.json in a folder, that of the last rung."""
    *below, last = rungs
    there = seen_from.resolve()
    runs = [*(label(one.folder, there) for one in below), "."]
    rows = [
        {name: value for name, value in asdict(one).items() if name != "folder"} | {"run": run}
        for one, run in zip([*below, last], runs, strict=True)
    ]
    facts: dict[str, Any] = strict({"format": FORMAT, "rungs": rows})
    return facts


def write_ladder(folder: Path, rungs: Sequence[Rung], name: str, seen_from: Path | None = None) -> None:
    """Write ladder.json and ladder.html, both or none.

    Parameters
    ----------
    folder : to write into
    rungs : lowest first
    name : of the survey
    seen_from : the folder that they end in, where that is another
    """
    from solver.run.report.joined import join
    from solver.run.report.ladder_page import ladder_page

    facts = json.dumps(ladder_facts(rungs, seen_from or folder), allow_nan=False, indent=1)
    with writing_into(folder) as scratch:
        (scratch / LADDER).write_text(facts, encoding="utf-8")
        (scratch / "ladder.html").write_text(ladder_page(rungs, name), encoding="utf-8")
    if (folder / "fit.json").is_file():
        join(folder)


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
    here = Path(folder).resolve()
    rows = [rung.model_dump() for rung in ladder.rungs]
    runs = [row.pop("run") for row in rows]
    for row in rows:
        row["glimpse"] = None if row["glimpse"] is None else Glimpse(**row["glimpse"])
    folders = [None if run is None else Path(os.path.normpath(here / run)) for run in runs]
    return [Rung(**row, folder=there) for row, there in zip(rows, folders, strict=True)]
