"""The error ladder's file: it holds all that the next rung needs, and leads nowhere else."""

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import roadfiber.command
from solver.catalogue.catalogue import built_in
from solver.criticism.diagnosis_files import check_out
from solver.criticism.growth import check_names
from solver.run.folder import read_run
from solver.run.ladder import climbed
from solver.run.ladder_file import ladder_facts, read_ladder, write_ladder
from solver.run.run import run_of
from solver.run.rung import Rung
from vision.contract import InputError


def moved(run, meters: float):
    """A run whose route is so far to the right."""
    return replace(run, result=replace(run.result, route=run.result.route + np.array([0.0, meters, 0.0])))


@pytest.fixture
def runs(survey, tmp_path, monkeypatch) -> Path:
    """Folder with the runs a, b and c: b is 0.5 m beside a, c 0.8 m; c has the ladder of all."""
    monkeypatch.setattr("solver.run.report.report_page.render", lambda run: "<!doctype html>")
    run_of(survey.result, **survey.arguments).save(tmp_path / "a")
    for before, after, meters in (("a", "b", 0.5), ("b", "c", 0.3)):
        run = read_run(tmp_path / before)
        grown = moved(run, meters)
        replace(grown, rungs=climbed(run, grown)).save(tmp_path / after)
    return tmp_path


def test_the_ladder_is_kept_whole_in_its_file(runs, monkeypatch):
    """Also where the working directory is another, and the runs below have gone elsewhere."""
    (runs / "a").rename(runs / "gone")
    (runs / "elsewhere").mkdir()
    monkeypatch.chdir(runs / "elsewhere")
    rungs = read_ladder(Path("../c"))
    assert [rung.folder for rung in rungs] == [runs / "a", runs / "b", runs / "c"]
    assert [row["run"] for row in json.loads((runs / "c" / "ladder.json").read_text())["rungs"]] == [
        "../a",
        "../b",
        ".",
    ]
    assert [round(rung.route_change, 6) for rung in rungs] == [0.0, 0.5, 0.3]
    assert [round(rung.route_change_from_first, 6) for rung in rungs] == [0.0, 0.5, 0.8]
    run = read_run(Path("../c"))
    further = climbed(run, moved(run, 1.0))
    rows = ladder_facts(further, Path("new/d"))["rungs"]
    assert [row["run"] for row in rows] == ["../../../a", "../../../b", "../../../c", "."]
    assert further[-1].route_change_from_first == pytest.approx(1.8)


def test_nothing_but_the_ladder_s_own_file_is_opened(runs, tmp_path):
    """Though it names other places."""
    path = runs / "c" / "ladder.json"
    facts = json.loads(path.read_text())
    for rung, place in zip(facts["rungs"], ("/etc", "../../secret", "."), strict=True):
        rung["run"] = place
    path.write_text(json.dumps(facts))
    opened = []
    watching = [True]
    sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" and watching[0] else None)
    read_run(runs / "c")
    watching[0] = False
    mine = {Path(name) for name in opened if str(runs) in name or "etc" in name or "secret" in name}
    assert mine == {path, runs / "c" / "fit.json", runs / "c" / "data.npz"}


def test_several_ladders_are_one_document(runs):
    def printed(*names: str):
        words = ["-q", "ladder", *(str(runs / name) for name in names), "--json"]
        return json.loads(CliRunner().invoke(roadfiber.command.app, words, catch_exceptions=False).stdout)

    one, other = printed("a", "c")
    assert (len(one["rungs"]), len(other["rungs"])) == (1, 3)
    assert printed("c") == other == json.loads((runs / "c" / "ladder.json").read_text())


@pytest.mark.parametrize("out", ["c", "c/../c", "link", "above", "b", "a"])
def test_a_run_is_not_written_over_what_it_grew_from(runs, out):
    """Nor over a folder above it, or a rung of its ladder, however it is spelled."""
    (runs / "link").symlink_to(runs / "c")
    (runs / "above").symlink_to(runs)
    (runs / "fit.json").write_text((runs / "a" / "fit.json").read_text())
    before = {path: path.stat().st_mtime_ns for path in runs.rglob("*")}
    with pytest.raises(InputError, match=r"--out .*; give the name of a new folder"):
        check_out(runs / out, read_run(runs / "c"))
    for words in (("explain",), ("add", "camber")):
        with pytest.raises(InputError, match=r"holds the run you start from|is a rung of the ladder"):
            CliRunner().invoke(
                roadfiber.command.app,
                [words[0], str(runs / "link"), *words[1:], "--out", os.path.join(runs, out)],  # noqa: PTH118
                catch_exceptions=False,
                standalone_mode=False,
            )
    assert {path: path.stat().st_mtime_ns for path in runs.rglob("*")} == before
    check_out(runs / "new", read_run(runs / "c"))


def rung(**changes) -> dict:
    whole = {
        "effects": ["camber"],
        "chi2_per_dof": 1.0,
        "held_out_chi2_per_dof": None,
        "noise_floor": 1.0,
        "route_change": 0.0,
        "route_change_from_first": None,
        "run": ".",
        "route": [[7.0, 0.0, 4.0, 1.0]],
        "words": [],
    }
    return {name: value for name, value in (whole | changes).items() if value != "delete"}


@pytest.mark.parametrize(
    "rungs",
    [
        *([rung(**{name: "delete"})] for name in rung()),
        *([rung(**{name: {}})] for name in rung()),
        [rung(route=[[7.0, 0.0, 4.0]])],
        [rung(route=[[7.0, 0.0, 4.0, None]])],
        [rung(chi2_per_dof=float("nan"))],
        [rung(run="\x1b[2J")],
        [rung(more=1)],
        [],
        {},
        "x" * 10,
    ],
)
def test_a_tampered_ladder_is_a_line(tmp_path, rungs):
    (tmp_path / "ladder.json").write_text(json.dumps({"format": "roadfiber ladder 2", "rungs": rungs}))
    with pytest.raises(InputError, match=r"ladder\.json: .*; delete it, and the ladder begins anew") as caught:
        read_ladder(tmp_path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_deep_and_broken_json_is_a_line(tmp_path):
    for text in ("[" * 100000 + "]" * 100000, '{"rungs": ' * 100000, "", "\x00", "{"):
        (tmp_path / "ladder.json").write_text(text)
        with pytest.raises(InputError, match=r"invalid JSON"):
            read_ladder(tmp_path)


def test_a_ladder_comes_back(tmp_path):
    one = Rung(("wheel_layout",), 1.2, None, 0.9, 0.0, 0.25, None, ((7.0, 0.1, 4.2, 1.0), (8.0, 1.1, 4.2, 1.0)))
    write_ladder(tmp_path, [one], "Elm <b>Street</b>")
    assert read_ladder(tmp_path) == [replace(one, folder=tmp_path)]
    assert "<b>" not in (tmp_path / "ladder.html").read_text(encoding="utf-8")


def test_a_name_that_is_not_known_is_reported_in_a_line_before_anything_is_fitted():
    problem = SimpleNamespace(effects=())
    with pytest.raises(InputError) as caught:
        check_names(["camber", "nosuch"], problem, built_in())
    assert str(caught.value) == "effect nosuch: not known; `roadfiber effects` lists all"
    with pytest.raises(InputError, match="did you mean camber"):
        check_names(["cambre"], problem, built_in())
    with pytest.raises(InputError, match="camber: is in the model already"):
        check_names(["camber", "camber"], problem, built_in())
    check_names(["cycle_skips", "camber"], problem, built_in())
