"""Hidden effects end to end, from the simulator's files through the public commands.

Which effects are found is tested in memory, see `test_hidden_effects`.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

import roadfiber as rf
import roadfiber.command
from solver.catalogue import plugins
from solver.catalogue.catalogue import built_in
from solver.criticism.policy import POLICY
from solver.run.folder import read_run
from solver.run.titles import lower
from vision.contract import InputError

STREET = """
passes = 3
snr_db = 25.0
noise = "street"
view = [0.0, 30.0]
[effects]
{effects}
"""


def run(*words: object) -> str:
    """Run a command; what it printed."""
    result = CliRunner().invoke(roadfiber.command.app, ["-q", *(str(word) for word in words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def located(folder: Path, effects: dict[str, float]) -> Path:
    """Run folder of a simulated survey with these hidden effects; its corridor, the fit's own, is not looked at."""
    scenario = folder / "street.toml"
    lines = "\n".join(f"{name} = {amount}" for name, amount in effects.items())
    scenario.write_text(STREET.format(effects=lines), encoding="utf-8")
    run("simulate", scenario, "--seed", 11, "--laid", "winding", "--out", folder / "survey")
    run("locate", folder / "survey", "--corridor", "fit", "--out", folder / "run")
    return folder / "run"


def diagnosis(folder: Path, *options: object) -> dict:
    """What `roadfiber diagnose` writes, which its schema allows."""
    run("diagnose", folder, *options)
    return written(folder)


def written(folder: Path) -> dict:
    """The diagnosis in a run folder, which its schema allows."""
    found: dict = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    Draft202012Validator(rf.schema("diagnosis.json")).validate(found)
    return found


def rungs(folder: Path) -> list[dict]:
    """Of a run folder's ladder."""
    return json.loads((folder / "ladder.json").read_text(encoding="utf-8"))["rungs"]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A catalogue of a few effects, where it is not the point that one is told from all others."""
    names = ("gauge_length", "camber", "generic_neighbors")
    some = {name: one for name, one in built_in().items() if one.base_part or name in names}
    monkeypatch.setattr(plugins, "built_in", lambda: some)


@pytest.fixture(scope="module")
def stretched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of a survey whose gauges are longer than told; not to be changed."""
    return located(tmp_path_factory.mktemp("stretched"), {"gauge_length": 0.15})


def test_a_hidden_effect_is_named_of_the_whole_catalogue(stretched: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(stretched, tmp_path / "run")
    before = read_run(folder)
    said = run("diagnose", folder)
    assert 0 <= said.find("score test: ") < said.find("full fits: ") < said.find("missing-effect: "), "as it is found"
    found = written(folder)
    first = found["candidates"][0]
    assert found["verdict"] == "missing-effect", found["words"]
    page = (folder / "diagnosis.html").read_text(encoding="utf-8")
    assert first["told"]["title"] in page and "One vehicle, before and after" in page and 'href="report.html"' in page
    table = page.partition("<h2>Candidates</h2>")[2].partition("</table>")[0]
    assert all(line.count('class="signature"') == 2 for line in table.split("<tr>")[2:]), "predicted where not fitted"
    assert "*</td>" in table and len(page) < 8e6
    assert "gauge_length" in {first["effect"], *first["confounded_with"]}, found["words"]
    assert first["evidence"] > POLICY.found and first["held_out_gain"] > 0
    assert len(found["candidates"]) > 50
    # What is found reaches the route, its first page and its corridor.
    after = read_run(folder)
    assert "lacks gauge length" in after.trust and "lacks gauge length" not in before.trust
    assert "lacks gauge length" in (folder / "report.html").read_text(encoding="utf-8")
    assert after.facts["corridor"]["explanations"][0]["effects"] == list(found["explanations"][0]["effects"])
    assert not np.allclose(after.route["sigma_y"], before.route["sigma_y"])
    assert np.allclose(after.route["sigma_y_fit"], before.route["sigma_y_fit"])


def test_the_clocks_offset_is_estimated_and_kept_where_it_is_added(tmp_path: Path) -> None:
    folder = located(tmp_path, {"clock_offset": 0.2})
    found = json.loads(run("clock", folder, "--json"))
    assert found["clock_offset"] == pytest.approx(0.2, abs=4 * found["sigma"])
    assert 0 < found["sigma"] < 0.03
    # Every track is off by as much: passes held out, which may shift a little by themselves, fit better all the same.
    run("add", folder, "clock_offset", "--corridor", "fit", "--out", tmp_path / "second")
    before, after = rungs(tmp_path / "second")
    assert after["held_out_chi2_per_dof"] < before["held_out_chi2_per_dof"]


def test_the_clocks_offset_is_told_as_every_number_with_its_sigma(monkeypatch) -> None:
    monkeypatch.setattr("roadfiber.locating.open_street", lambda *_, **__: None)
    monkeypatch.setattr(rf, "clock_offset", lambda _: (-0.271234, 0.0134))
    assert run("clock", "run") == "the DAS clock is ahead of the trajectories' by -0.271 ± 0.013 s\n"


def test_a_length_that_slips_is_fitted_to_the_noise(tmp_path: Path) -> None:
    """Between its ends it tells no place: the route stays where the rest of the fiber and its smoothness have it."""
    folder = located(tmp_path, {"conduit_slip": 16.0})
    run("add", folder, "conduit_slip", "--corridor", "fit", "--out", tmp_path / "second")
    before, after = rungs(tmp_path / "second")
    assert before["chi2_per_dof"] > 1.5 and after["chi2_per_dof"] < 1.03 * after["noise_floor"]
    route = np.array(json.loads((tmp_path / "survey" / "truth.json").read_text(encoding="utf-8"))["route_xyz"])
    found = pd.read_csv(tmp_path / "second" / "route.csv")
    off = found[["x", "y", "z"]].to_numpy() - route[found["channel"]]
    assert np.linalg.norm(off, axis=1).max() < 0.2


def test_two_effects_are_found_one_after_the_other(tmp_path: Path, few: None) -> None:
    folder = located(tmp_path, {"gauge_length": 0.15, "unseen_vehicle": 0.8})
    said = run("explain", folder, "--out", tmp_path / "explained")
    climbed = rungs(tmp_path / "explained")
    assert {"gauge_length", "unseen_vehicle"} <= set(climbed[-1]["effects"]), said
    held_out = [rung["held_out_chi2_per_dof"] for rung in climbed]
    assert held_out == sorted(held_out, reverse=True)
    assert climbed[-1]["chi2_per_dof"] < 1.05 * climbed[-1]["noise_floor"]
    page = (tmp_path / "explained" / "explain.html").read_text(encoding="utf-8")
    (first,) = set(climbed[1]["effects"]) - set(climbed[0]["effects"])
    titles = {"gauge_length": "Gauge length", "unseen_vehicle": "Unseen vehicle"}
    told = sorted(titles, key=lambda name: page.index(f"Added to the model: {lower(titles[name])}"))
    assert told[0] == first


PLUGIN = """
from solver.effect import Parameter, effect


@effect("wide_gauge", "interrogator", [Parameter("relative", "1", 0.1, lower=-0.5, upper=1.0)],
        physics="The gauge is longer than told.", source="A user.")
def wide_gauge(interrogator, p, survey):
    from dataclasses import replace
    return replace(interrogator, gauge_length=interrogator.gauge_length * (1 + p["relative"]))
"""


def test_add_extends_the_ladder_refuses_what_does_not_help_and_takes_a_user_effect(
    stretched: Path, tmp_path: Path, few: None
) -> None:
    plugin = tmp_path / "mine.py"
    plugin.write_text(PLUGIN, encoding="utf-8")
    run("add", stretched, "wide_gauge", "--corridor", "fit", "--plugin", plugin, "--out", tmp_path / "second")
    ladder = rungs(tmp_path / "second")
    assert [rung["effects"][-1] for rung in ladder] == ["curved_gauge", "wide_gauge"]
    assert ladder[1]["held_out_chi2_per_dof"] < ladder[0]["held_out_chi2_per_dof"]
    facts = json.loads((tmp_path / "second" / "fit.json").read_text(encoding="utf-8"))
    assert facts["parameters"]["wide_gauge.relative"]["value"] == pytest.approx(0.15, abs=0.03)
    # The new run folder says which file it was made with, and is diagnosed with that.
    with pytest.raises(InputError, match=r"made with mine\.py \(sha256 \w{64}\): give it with --plugin mine\.py"):
        diagnosis(tmp_path / "second")
    assert diagnosis(tmp_path / "second", "--plugin", plugin)["verdict"] == "adequate"
    with pytest.raises(InputError, match=r"camber: chi2 .* held-out .* not kept"):
        CliRunner().invoke(
            roadfiber.command.app,
            ["-q", *map(str, ("add", tmp_path / "second", "camber", "--plugin", plugin, "--out", tmp_path / "third"))],
            catch_exceptions=False,
            standalone_mode=False,
        )
    assert not (tmp_path / "third").exists()
    assert "chi2/dof" in run("ladder", tmp_path / "second")


def test_noise_that_is_not_understood_ends_inconclusive(stretched: Path, tmp_path: Path, few: None) -> None:
    folder = shutil.copytree(stretched, tmp_path / "run")
    with np.load(folder / "data.npz") as file:
        arrays = {name: file[name] for name in file.files}
    # The second half of the record is four times as loud: no law of stationary noise holds for both.
    half = len(arrays["record"]) // 2
    noise = np.random.default_rng(0).normal(size=arrays["record"][half:].shape) * 4 * arrays["noise"]
    arrays["record"][half:] += noise.astype(np.float32)
    np.savez_compressed(folder / "data.npz", **arrays)
    found = diagnosis(folder)
    assert found["verdict"] == "inconclusive"
    assert "noise" in found["words"]
