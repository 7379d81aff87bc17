"""Stretches of a run are runs, and what they lack is weighed together."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

import roadfiber as rf
from roadfiber.command import app
from solver.catalogue import plugins
from solver.catalogue.catalogue import built_in
from solver.criticism.shared import Shared
from solver.run import seen
from solver.run import stretch as module
from solver.run.stretch import stretches_of
from tests.offline_pages import is_whole


@pytest.fixture(scope="module", autouse=True)
def short() -> Iterator[None]:
    """Stretches of 25 m, and a catalogue of a few effects."""
    names = ("gauge_length", "camber", "generic_neighbors")
    some = {name: one for name, one in built_in().items() if one.base_part or name in names}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(plugins, "built_in", lambda: some)
        patched.setattr(module, "ONE_STRETCH", 25.0)
        yield


@pytest.fixture(scope="module")
def run(short: None, tmp_path_factory: pytest.TempPathFactory) -> rf.Run:
    """Of forty meters whose gauges are 15 % longer than told."""
    small = {"view": (0.0, 40.0), "channels": 121, "passes": 2, "seed": 11, "laid": "winding"}
    site = rf.simulate(tmp_path_factory.mktemp("long") / "survey", effects={"gauge_length": 0.15}, **small).site
    return rf.locate(site, corridor="fit")


@pytest.fixture(scope="module")
def found(run: rf.Run) -> rf.StretchDiagnosis:
    return rf.diagnose_stretches(run)


@pytest.fixture(scope="module")
def folder(found: rf.StretchDiagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run with its diagnosis."""
    made = tmp_path_factory.mktemp("saved") / "run"
    found.run.save(made)
    found.save(made)
    return made


def test_what_all_stretches_lack_is_named_once_with_its_size(found: rf.StretchDiagnosis, folder: Path) -> None:
    assert len(found.parts) == 2 and found.verdict == "missing-effect"
    assert found.headline.startswith("Gauge length, along all 2 stretches: 11.") and found.shared.alike > 0.9
    assert found.effect == "gauge_length"
    assert found.table["effect"].tolist() == ["gauge_length"] * 2 and found.table["size"].between(11.2, 11.8).all()
    assert found.headline in (folder / "index.html").read_text(encoding="utf-8")
    written = json.loads((folder / "stretches.json").read_text(encoding="utf-8"))
    Draft202012Validator(rf.schema("stretches.json")).validate(written)
    assert is_whole((folder / "stretches.html").read_text(encoding="utf-8"))
    part = rf.open(folder / written["stretches"][0]["folder"])
    assert part.facts["active_channels"] == list(found.channels[0]) and part.facts["notes"][0].endswith("a longer run")
    assert (folder / written["stretches"][0]["folder"] / "diagnosis.html").is_file()


def test_what_a_stretch_lacks_is_told_of_the_whole_run_there(found: rf.StretchDiagnosis, run: rf.Run) -> None:
    first, second = found.parts
    far = replace(first.finding.candidates[0], route_change=9.0)
    first = replace(first, finding=replace(first.finding, candidates=(far, *first.finding.candidates[1:])))
    sound = replace(second, finding=replace(second.finding, verdict="adequate"))
    some = replace(found, run=run, parts=(first, sound))
    vars(some)["shared"] = Shared(found.shared.weighed, 0.1)
    local = some.judged()
    low, high = some.channels[0]
    there = local.route["channel"].between(low, high)
    assert not local.route.loc[there, "constrained"].any()
    assert local.route.loc[~there, "constrained"].tolist() == run.route.loc[~there, "constrained"].tolist()
    assert f"the model lacks gauge length at channels {low} to {high}" in local.trust
    assert f"RUN/channels-{low}-{high} gauge_length" in local.trust


def test_what_all_stretches_lack_is_told_of_the_whole_run(found: rf.StretchDiagnosis, folder: Path) -> None:
    said = "model lacks gauge length, along all 2 stretches: 11."
    assert said in found.run.trust and said in rf.open(folder).trust
    assert said in (folder / "index.html").read_text(encoding="utf-8")


def test_a_stretch_is_where_the_whole_run_has_it(run: rf.Run, folder: Path, tmp_path: Path) -> None:
    first, last = (int(c) for c in run.problem.channel[[4, 24]])
    words = ["-q", "stretch", str(folder), str(first), str(last), "--out", str(tmp_path / "part")]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0 and "report.html" in done.output
    part = rf.open(tmp_path / "part")
    assert part.problem.channel.tolist() == list(range(first, last + 1)) and part.rungs == ()
    known = part.route[part.route["constrained"]]
    whole = run.route.set_index("channel").loc[known["channel"]]
    sigma = np.hypot(known["sigma_y"], whole["sigma_y"].to_numpy())
    assert (np.abs(known["y"] - whole["y"].to_numpy()) < 4 * sigma).all()


def test_a_long_run_is_compared_stretch_by_stretch(run: rf.Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the door as by the command; its pages are put beside those of the diagnosis, which stay."""
    monkeypatch.setattr(seen, "is_one_stretch", lambda length: length <= 25)
    with pytest.raises(rf.InputError, match="`roadfiber diagnose` and `compare` look at stretch after stretch"):
        rf.compare(run)
    compared, ends = rf.compare_stretches(run), stretches_of(run)
    assert compared.channels == ends and len(ends) == 2
    assert compared.table["first"].tolist() == [first for first, _ in ends]
    # Gauges are longer than told along all of it.
    assert compared.headline.startswith("Model and measurement differ in 2 of 2 stretches, most in channels ")
    assert (compared.table["excess"] > 0.01).all() and set(compared.regions["first"]) == {first for first, _ in ends}
    assert compared.regions["chi2"].is_monotonic_decreasing and compared.plot().get_axes()
    done = CliRunner().invoke(app, ["-q", "compare", str(folder)], catch_exceptions=False)
    assert done.output.startswith("\n".join(compared.said())) and compared.headline in repr(compared)
    assert "<table" in compared._repr_html_() and len(compared.facts) == 2
    pages = [folder / f"channels-{a}-{b}" / f"{name}.html" for a, b in ends for name in ("compare", "diagnosis")]
    assert all(page.is_file() for page in pages) and compared.pages(folder) == pages[::2]


def test_a_stretch_that_cannot_be_is_one_line(run: rf.Run) -> None:
    first, last = (int(c) for c in run.problem.channel[[0, -1]])
    said = f"channels {first} to {first + 2}: 3 of them are fitted, too few for a route; the run has {first} to {last}"
    with pytest.raises(rf.InputError, match=said):
        rf.stretch(run, first, first + 2)
    with pytest.raises(rf.InputError, match=r"m of fiber, and 25 m can be fitted as one; give fewer"):
        rf.stretch(run, first, last)


def test_stretches_that_differ_are_told_one_by_one(found: rf.StretchDiagnosis) -> None:
    apart = rf.StretchDiagnosis(found.run, found.parts)
    vars(apart)["shared"] = Shared(found.shared.weighed, 0.1)
    assert apart.headline.startswith("Stretch by stretch. Channels ")
    assert apart.headline.count("Gauge length.") == 2 and apart.verdict == "missing-effect"
    assert apart.lines()[-1].startswith("how probable, if so: Gauge length")
    # What one cause would be is not said where there is none.
    vars(apart)["shared"] = Shared(found.shared.weighed, 0.01)
    assert apart.lines()[-1].startswith("that one cause, or none, acts along all of it is 1 % probable")


def test_a_stretch_whose_noise_is_not_understood_is_not_among_those_told_of(found: rf.StretchDiagnosis) -> None:
    first, second = found.parts
    silent = replace(second, finding=replace(second.finding, explanations=(), verdict="inconclusive"))
    some = rf.StretchDiagnosis(found.run, (first, silent))
    known = "the diagnosis cannot tell what the model may lack at channels {} to {}".format(*some.channels[1])
    assert known in {one["words"] for one in some.judged().facts["trust"]["gates"]}
    assert some.headline.startswith("Gauge length, along the 1 of 2 stretches with noise as expected: ")
    none = rf.StretchDiagnosis(found.run, (silent, silent))
    assert none.verdict == "inconclusive" and none.effect is None and none.headline.startswith("Stretch by stretch. ")
