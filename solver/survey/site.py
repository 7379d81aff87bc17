"""`site.toml`: the one file that describes a survey."""

from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import (
    BaseModel,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from solver.survey.plan_maps import with_maps
from solver.survey.plan_section import PlanSection
from solver.survey.site_sections import (
    AnchorsSection,
    CameraSection,
    DASSection,
    FrameSection,
    GroundSection,
    Name,
    RouteSection,
    Section,
    TrajectoriesSection,
)
from vision.contract import InputError, LocalFrame, read_toml


class Site(Section):
    """One survey.

    Attributes
    ----------
    name : of the survey; by default the folder's
    frame : the local frame
    das, camera, trajectories, route, anchors, ground : the sections; at least one of `camera` and `trajectories` is
        given, and `trajectories` where there is a `route`
    plan : of the survey before it was driven
    """

    name: Name = ""
    frame_section: FrameSection = Field(alias="frame")
    das: DASSection
    camera: CameraSection | None = None
    trajectories: TrajectoriesSection | None = None
    route: RouteSection | None = None
    anchors: AnchorsSection | None = None
    ground: GroundSection = GroundSection()
    plan: PlanSection | None = None

    @cached_property
    def frame(self) -> LocalFrame:
        """The local frame."""
        return LocalFrame(self.frame_section.origin, self.frame_section.x_azimuth)

    @model_validator(mode="after")
    def moving(self, info: ValidationInfo) -> "Site":
        """Refuse a survey without any source of trajectories, if they are needed."""
        needed = (info.context or {}).get("moving", True)
        if needed and self.camera is None and self.trajectories is None:
            raise ValueError("neither [camera] nor [trajectories]; give one of them")
        if needed and self.route is not None and self.trajectories is None:
            raise ValueError("[route] without [trajectories]; give the GPS track of the car that drove along it")
        return self


SECTIONS: dict[str, type[BaseModel]] = {
    "frame": FrameSection,
    "das": DASSection,
    "camera": CameraSection,
    "trajectories": TrajectoriesSection,
    "route": RouteSection,
    "anchors": AnchorsSection,
    "ground": GroundSection,
    "plan": PlanSection,
}


def unknown_key(location: tuple[Any, ...]) -> str:
    """Say which key of which section is unknown, and the closest known one."""
    *section, key = (str(part) for part in location)
    known = list(SECTIONS[section[0]].model_fields) if section else ["name", *SECTIONS]
    close = get_close_matches(key, known, n=1)
    place = f"in [{section[0]}]" if section else "at the top"
    hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
    return f"unknown key {key} {place}; {hint}"


def first_problem(error: ValidationError) -> str:
    """Return one line on the problem to mend first: a misspelt key also shows as a missing one."""
    problems = error.errors()
    unknown = [problem for problem in problems if problem["type"] == "extra_forbidden"]
    if unknown:
        return unknown_key(unknown[0]["loc"])
    problem = problems[0]
    place = ".".join(map(str, problem["loc"]))
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "missing":
        return f"no {place}; add it"
    message = message[0].lower() + message[1:]
    return f"{place}: {message}" if place else message


def read_site(path: Path, *, moving: bool = True) -> Site:
    r"""Read and check `site.toml`.

    Parameters
    ----------
    path : the file; the paths in it are relative to its folder and may be patterns for `files`
    moving : whether it must name a source of trajectories

    Returns
    -------
    site : with every path resolved and every file found

    Raises
    ------
    InputError
        If the file is missing or not TOML, a key is unknown or missing, a value is out of range or a file is missing.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "site.toml"
    >>> _ = path.write_text("[frame]\norigin = [32.1, 34.8]\nx_azimut = 78.0\n")
    >>> try: read_site(path)
    ... except InputError as error: print(str(error).partition("site.toml: ")[2])
    unknown key x_azimut in [frame]; did you mean x_azimuth?
    """
    path = Path(path)
    content = read_toml(path, "the path of a survey's site.toml")
    folder = path.resolve().parent
    content = with_maps(content, folder)
    try:
        site = Site.model_validate(content, context={"folder": folder, "moving": moving})
    except ValidationError as error:
        raise InputError(f"{path}: {first_problem(error)}") from error
    return site if site.name else site.model_copy(update={"name": folder.name})
