"""JSON Schemas (draft 2020-12) of the files that roadfiber reads and writes, made from the code that does so.

What a key means is told where the code declares it: a field's line in the docstring of its class.
"""

import re
from inspect import cleandoc, getdoc
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from roadfiber.table_rows import AnchorRow, ChannelRow, FileRow, PointRow, RouteRow, TrajectoryRow
from roadfiber.written_files import CompareFile, DiagnosisFile, RouteFeatures, Written
from roadfiber.written_quality import HeardFile, QualityFile
from roadfiber.written_stretches import StretchesFile
from solver.drive.drive_folder import DriveFile
from solver.run.combined import CombinedFile
from solver.run.ladder_file import LadderFile
from solver.run.stored import FitFile
from solver.survey.das.store import StoreFile
from solver.survey.site import Site
from vision.camera import Calibration
from vision.contract.errors import InputError

DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: File -> what it holds. Of a csv file, a row: what is empty is absent.
FILES: dict[str, Any] = {
    "site.toml": Site,
    "trajectories.csv": TrajectoryRow,
    "anchors.csv": AnchorRow,
    "points.csv": PointRow,
    "calibration.json": Calibration,
    "fit.json": FitFile,
    "drive-fit.json": DriveFile,
    "route.csv": RouteRow,
    "route.geojson": RouteFeatures,
    "ladder.json": LadderFile,
    "compare.json": CompareFile,
    "diagnosis.json": DiagnosisFile,
    "stretches.json": StretchesFile,
    "combined.json": CombinedFile,
    "heard.json": HeardFile,
    "quality.json": QualityFile,
    "store.json": StoreFile,
    "channels.csv": ChannelRow,
    "files.csv": FileRow,
}


def schema(file: str) -> dict[str, Any]:
    """The JSON Schema of a file that roadfiber reads or writes.

    Parameters
    ----------
    file : "site.toml", "fit.json", "route.csv" ...; of a csv file it is the schema of a row, in which what is empty is
        absent. `heard.json` is what `roadfiber vehicles --json` prints, `drive-fit.json` the fit.json of a drive

    Returns
    -------
    schema : draft 2020-12

    Raises
    ------
    InputError
        If there is no schema of that name; the message lists them.

    Examples
    --------
    >>> rf.schema("route.csv")["properties"]["sigma_y"]["description"]
    'standard deviations, m, with what the model may lack; empty where the method gives none'
    """
    if file not in FILES:
        raise InputError(f"no schema of {file!r}; there are {', '.join(FILES)}")
    made = TypeAdapter(FILES[file]).json_schema(schema_generator=Described)
    return {"$schema": DIALECT, "title": file, **{key: value for key, value in made.items() if key != "title"}}


class Described(GenerateJsonSchema):
    """Schemas whose properties say what they are, in the words of the docstrings; patterns that every reader knows."""

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        """A pydantic model's; numbers that are not finite are written as null where nothing is read back."""
        return described(super().model_schema(schema), schema["cls"])

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> JsonSchemaValue:
        """A dataclass's; it is only written."""
        return nullable(described(super().dataclass_schema(schema), schema["cls"]))

    def str_schema(self, schema: core_schema.StringSchema) -> JsonSchemaValue:
        r"""A text's: control characters by their numbers, as not every reader knows \p."""
        made = super().str_schema(schema)
        if "pattern" in made:
            made["pattern"] = made["pattern"].replace(r"\p{Cc}", r"\u0000-\u001f\u007f-\u009f")
        return made


def described(made: JsonSchemaValue, of: type) -> JsonSchemaValue:
    """The schema of a class with its docstring's first sentence, and its fields' lines."""
    text = getdoc(of) or ""
    known = fields_of(text)
    for name, field in getattr(of, "model_fields", {}).items():
        if field.alias and name in known:
            known[field.alias] = known[name]
    made["description"] = text.split("\n\n")[0].replace("\n", " ")
    for name, one in made.get("properties", {}).items():
        one.pop("title", None)
        if name in known:
            one["description"] = known[name]
    return nullable(made) if issubclass(of, Written) else made


def nullable(made: JsonSchemaValue) -> JsonSchemaValue:
    """The schema with null wherever a number may stand: what is not finite is written so."""
    made["properties"] = {name: with_null(one) for name, one in made.get("properties", {}).items()}
    return made


def with_null(one: Any) -> Any:
    """A schema in which every number may be null.

    >>> with_null({"type": "array", "items": {"type": "number"}})
    {'type': 'array', 'items': {'type': ['number', 'null']}}
    """
    if isinstance(one, list):
        return [with_null(part) for part in one]
    if not isinstance(one, dict):
        return one
    changed = {key: with_null(value) for key, value in one.items()}
    return changed | ({"type": ["number", "null"]} if one.get("type") == "number" else {})


def fields_of(text: str) -> dict[str, str]:
    """What a docstring's Parameters or Attributes say of each field.

    >>> fields_of('''Place.
    ...
    ... Parameters
    ... ----------
    ... x, y : along the road and across it,
    ...     m
    ... ''')
    {'x': 'along the road and across it, m', 'y': 'along the road and across it, m'}
    """
    section = re.search(r"(?:Parameters|Attributes)\n-{3,}\n(.*?)(?=\n\n|\Z)", cleandoc(text), re.S)
    found = dict[str, str]()
    names: list[str] = []
    for line in section[1].splitlines() if section else []:
        if start := re.match(r"([\w, ]+?) : (.*)", line):
            names = start[1].split(", ")
            found |= dict.fromkeys(names, start[2].strip())
        else:
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
    return found
