"""The JSON Schemas of files hold of the files that roadfiber writes, and refuse others."""

import csv
import json
import tomllib
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from jsonschema import Draft202012Validator, ValidationError

import roadfiber as rf
from calib.point_tables import COLUMNS as POINTS
from roadfiber.schemas import FILES
from solver.survey.anchors import COLUMNS as ANCHORS
from vision.contract import COLUMNS, InputError


def validate(file: str, content: Any) -> None:
    """Raise ValidationError unless the content is what the file's schema says."""
    Draft202012Validator(rf.schema(file), format_checker=Draft202012Validator.FORMAT_CHECKER).validate(content)


def rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a csv file, numbers and flags as such; what is empty is absent."""
    with path.open(newline="", encoding="utf-8") as stream:
        return [{k: value(v) for k, v in row.items() if v != ""} for row in csv.DictReader(stream)]


def value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def plain(content: Any) -> Any:
    """TOML as JSON: times as text."""
    if isinstance(content, dict):
        return {key: plain(one) for key, one in content.items()}
    return content.isoformat() if isinstance(content, datetime) else content


@pytest.mark.parametrize("file", FILES)
def test_a_schema_is_one_and_says_what_every_key_means(file: str) -> None:
    schema = rf.schema(file)
    Draft202012Validator.check_schema(schema)
    assert schema["title"] == file and len(schema["description"]) > 10
    assert [key for key, one in schema["properties"].items() if len(one.get("description", "")) < 3] == []


def test_a_survey_is_as_its_schemas_say(example: dict[str, Any]) -> None:
    folder = example["folder"] / "survey"
    site = plain(tomllib.loads((folder / "site.toml").read_text(encoding="utf-8")))
    validate("site.toml", site)
    filmed = {"video": "street.mp4", "calibration": "c.json", "start": "2025-08-11T06:00:00+00:00"}
    validate("site.toml", site | {"camera": filmed})
    for wrong in ({"frame": {}}, {"das": {"files": 3}}, {"cam": {}}):
        with pytest.raises(ValidationError):
            validate("site.toml", site | wrong)
    for row in rows(folder / "trajectories.csv")[:50]:
        validate("trajectories.csv", row | {"track_id": str(row["track_id"])})
    for row in rows(folder / "anchors.csv"):
        validate("anchors.csv", row)
    assert set(COLUMNS) <= set(rf.schema("trajectories.csv")["properties"])
    assert set(ANCHORS) <= set(rf.schema("anchors.csv")["properties"])
    assert set(POINTS) <= set(rf.schema("points.csv")["properties"])


def test_a_run_is_as_its_schemas_say(example: dict[str, Any], tmp_path: Path) -> None:
    run = rf.add(example["run"], "camber", force=True)
    run.save(tmp_path / "run")
    rf.compare(run).save(tmp_path / "run")
    for name in ("fit.json", "ladder.json", "compare.json", "route.geojson"):
        validate(name, json.loads((tmp_path / "run" / name).read_text(encoding="utf-8")))
    table = rows(tmp_path / "run" / "route.csv")
    assert len(table) == len(run.route)
    for row in table:
        validate("route.csv", row)
    with pytest.raises(ValidationError, match="was expected"):
        validate("fit.json", run.facts | {"format": "roadfiber run 1"})
    validate("heard.json", rf.vehicles(example["survey"]).facts)


def test_a_store_is_as_its_schemas_say(example: dict[str, Any], tmp_path: Path) -> None:
    rf.ingest(example["folder"] / "survey", tmp_path / "store")
    validate("store.json", json.loads((tmp_path / "store" / "store.json").read_text(encoding="utf-8")))
    for name in ("channels.csv", "files.csv"):
        found = rows(tmp_path / "store" / name)
        assert found
        for row in found:
            validate(name, row)


def test_files_of_the_camera_are_as_their_schemas_say(example: dict[str, Any], tmp_path: Path) -> None:
    marks = {"px": [100, 1180, 900, 380, 640], "py": [700, 700, 300, 300, 420], "x": [0, 0, 40, 40, 15]}
    marks = pd.DataFrame(marks | {"y": [-4, 4, 4.6, -4.6, 0]}).assign(name=list("abcde"))
    marks.to_csv(tmp_path / "points.csv", index=False)
    for row in rows(tmp_path / "points.csv"):
        validate("points.csv", row)
    view = rf.calibrate(tmp_path / "points.csv", image_size=(1280, 720), model="homography", threshold=500)
    view.save(tmp_path / "calibration.json")
    validate("calibration.json", json.loads((tmp_path / "calibration.json").read_text(encoding="utf-8")))
    table = example["table"]
    tracks = table.assign(frame=table.groupby("time").ngroup())
    validate("quality.json", rf.quality(tracks, tracks.assign(y=tracks["y"] + 0.1), names=["a", "b"]).facts)


def test_a_number_that_is_not_finite_is_null_where_nothing_is_read_back() -> None:
    row = rf.schema("compare.json")["$defs"]["PowerFile"]["properties"]["chi2"]
    assert row["type"] == ["number", "null"]
    assert rf.schema("route.csv")["properties"]["x"]["type"] == "number"


def test_an_unknown_file_is_one_line() -> None:
    with pytest.raises(InputError, match=r"no schema of 'thesis.tex'; there are site.toml"):
        rf.schema("thesis.tex")
