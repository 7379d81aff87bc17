"""What a user writes of a planned survey."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from solver.survey.plan_maps import with_maps
from solver.survey.plan_section import PlanSection, Positive, Table
from solver.survey.site import first_problem
from solver.survey.site_sections import FrameSection, GroundSection
from vision.contract import InputError, read_toml

#: m between channels where the site does not say it.
SPACING = 1.0


class PlannedDAS(Table):
    """`[das]` of a planned survey: no file is needed yet; what a record's settings would be may stand there already."""

    gauge_length: Positive
    channel_spacing: Positive = SPACING
    files: Any = None
    quantity: Any = None
    scale: Any = None
    channels: Any = None
    exclude: Any = None
    store: Any = None


class PlannedSite(Table):
    """site.toml of a planned survey; sections that only a survey needs may be there, and are not read."""

    name: str = ""
    das: PlannedDAS
    plan: PlanSection
    ground: GroundSection = GroundSection()
    frame: FrameSection | None = None
    camera: Any = None
    trajectories: Any = None
    anchors: Any = None


def read_planned(source: Path | str | Mapping[str, Any]) -> PlannedSite:
    """Read a planned survey: its site.toml, the folder of one, or the same content as a mapping.

    Lanes and anchors may be files of a map, see `with_maps`; a mapping's are relative to the working directory.

    Raises
    ------
    InputError
        If a file is missing or cannot be used, a key is unknown or missing, or a value is out of range.

    >>> lane = {"y": 0.0, "toward": "+x", "vehicles": {"car": 4}}
    >>> plan = {"length": 60.0, "offset": 4.0, "snr_db": 15.0, "lanes": [lane]}
    >>> read_planned({"das": {"gauge_length": 10.0}, "plan": plan}).plan.vehicles
    4
    """
    if isinstance(source, Mapping):
        content, where, name, folder = dict(source), "plan", "plan", Path()
    else:
        path = Path(source)
        path = path / "site.toml" if path.is_dir() else path
        content = read_toml(path, "the path of a site.toml with a table [plan]")
        where, name, folder = str(path), path.resolve().parent.name, path.parent
    content = with_maps(content, folder)
    try:
        site = PlannedSite.model_validate(content, context={"folder": Path()})
    except ValidationError as error:
        raise InputError(f"{where}: {first_problem(error)}") from error
    return site if site.name else site.model_copy(update={"name": name})
