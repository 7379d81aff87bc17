"""Hidden effects end to end: simulated with other code than the effect's own, found through the public commands."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import roadfiber.command
from solver.criticism.score import FOUND
from vision.contract import InputError

STREET = """
passes = {passes}
snr_db = 20.0
noise = "street"
view = [0.0, 45.0]
{more}
[effects]
{effects}
"""

#: Hidden effect -> amounts, and the names that count as finding it.
HIDDEN = {
    "gauge_length": ({"gauge_length": 0.15}, {"gauge_length"}),
    "clock_offset": ({"clock_offset": 0.2}, {"clock_offset"}),
    "clocks far apart": ({"clock_offset": -0.45}, {"clock_offset"}),
    "lowpass": ({"lowpass": 1.1}, {"lowpass"}),
    "shear_lag": ({"shear_lag": 2.4}, {"shear_lag"}),
    "channel_wander": ({"channel_wander": 0.6}, {"channel_wander"}),
    "track_bias": ({"track_bias": 1.0}, {"track_bias"}),
    "highpass": ({"highpass": 0.1}, {"highpass"}),
    "saturation": ({"saturation": 0.5}, {"saturation"}),
    "channel_coupling": ({"channel_coupling": 0.3}, {"channel_coupling"}),
    "stiffness_contrast": ({"stiffness_contrast": 0.6}, {"stiffness_contrast"}),
    "conduit_slip": ({"conduit_slip": 12.0}, {"conduit_slip"}),
    "viscoelastic_lag": ({"viscoelastic_lag": 0.35}, {"viscoelastic_lag"}),
    "road_bump": ({"road_bump": 0.35}, {"road_bump"}),
    "unseen_vehicle": ({"unseen_vehicle": 0.8}, {"unseen_vehicle"}),
    "cycle_skips": ({"cycle_skips": 0.01}, {"cycle_skips"}),
}


def run(*words: object) -> str:
    """Run a command; what it printed."""
    result = CliRunner().invoke(roadfiber.command.app, ["-q", *(str(word) for word in words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def located(folder: Path, effects: dict[str, float], *, passes: int = 4, seed: int = 11, more: str = "") -> Path:
    """Run folder of a simulated survey with these hidden effects."""
    scenario = folder / "street.toml"
    lines = "\n".join(f"{name} = {amount}" for name, amount in effects.items())
    scenario.write_text(STREET.format(passes=passes, effects=lines, more=more), encoding="utf-8")
    run("simulate", scenario, "--seed", seed, "--out", folder / "survey")
    run("locate", folder / "survey", "--out", folder / "run")
    return folder / "run"


def diagnosis(folder: Path, *options: object) -> dict:
    """What `roadfiber diagnose` writes."""
    run("diagnose", folder, *options)
    return json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_effect_is_named(tmp_path: Path, name: str) -> None:
    effects, right = HIDDEN[name]
    folder = located(tmp_path, effects)
    found = diagnosis(folder)
    first = found["candidates"][0]
    assert found["verdict"] == "missing-effect", found["words"]
    page = (folder / "diagnosis.html").read_text(encoding="utf-8")
    assert first["told"]["title"] in page and "One vehicle, before and after" in page and 'href="report.html"' in page
    assert page.count('class="signature"') > 1 and len(page) < 8e6
    assert {first["effect"], *first["confounded_with"]} & right, found["words"]
    assert first["evidence"] > FOUND


@pytest.mark.parametrize(("seed", "idle"), [(11, {"long_vehicle"}), (12, set())])
def test_nothing_hidden_is_adequate_and_says_what_could_have_hidden(tmp_path: Path, seed: int, idle: set[str]) -> None:
    """Where no truck drives, trucks' length is among what could not have shown."""
    found = diagnosis(located(tmp_path, {}, seed=seed))
    assert found["verdict"] == "adequate", found["words"]
    assert all(c["verdict"] != "present" for c in found["candidates"])
    gauge = next(c for c in found["candidates"] if c["effect"] == "gauge_length")
    assert gauge["verdict"] == "excluded"
    assert 0 < gauge["detectable_size"] < 0.05
    assert {c["effect"] for c in found["candidates"] if c["numbers"] == 0} == idle
    blind = found["words"].split("It could not have shown: ")[1].rstrip(".").split(", ")
    assert set(blind) == {
        c["effect"] for c in found["candidates"] if c["verdict"] == "inconclusive" and not c["generic"]
    }
    assert idle <= set(blind)
    assert all(abs(c["estimate"]) < 1e6 for c in found["candidates"])
    assert found["audit"]["faults"] == []


@pytest.mark.parametrize(
    ("name", "amount"),
    [("unknown_echo", 0.2), ("unknown_quadratic", 0.4), ("unknown_equalized", 0.6), ("unknown_twin_path", 0.5)],
)
def test_what_is_in_no_catalogue_is_called_unknown(tmp_path: Path, name: str, amount: float) -> None:
    found = diagnosis(located(tmp_path, {name: amount}))
    assert found["verdict"] in ("unknown-effect", "inconclusive"), found["words"]
    assert not any(c["verdict"] == "present" and not c["generic"] for c in found["candidates"]), found["words"]


@pytest.mark.parametrize(
    ("name", "amount", "stage"),
    [
        ("unknown_hysteresis", 0.35, "ground"),
        ("unknown_wave_packet", 0.15, "ground"),
        ("unknown_skewed_kernel", 0.4, "interrogator"),
    ],
)
def test_the_unknown_is_placed_at_its_stage(tmp_path: Path, name: str, amount: float, stage: str) -> None:
    """The ground's friction and waves are told from curves and loads, what is fixed to the fiber from vehicles."""
    found = diagnosis(located(tmp_path, {name: amount}))
    assert (found["verdict"], found["candidates"][0]["stage"]) == ("unknown-effect", stage), found["words"]


def test_the_clocks_offset_is_estimated_and_kept_where_it_is_added(tmp_path: Path) -> None:
    folder = located(tmp_path, {"clock_offset": 0.2})
    found = json.loads(run("clock", folder, "--json"))
    assert found["clock_offset"] == pytest.approx(0.2, abs=4 * found["sigma"])
    assert 0 < found["sigma"] < 0.03
    # Every track is off by as much: passes held out, which may shift a little by themselves, fit better all the same.
    run("add", folder, "clock_offset", "--out", tmp_path / "second")
    before, after = json.loads((tmp_path / "second" / "ladder.json").read_text(encoding="utf-8"))["rungs"]
    assert after["held_out_chi2_per_dof"] < before["held_out_chi2_per_dof"]


def test_a_length_that_slips_is_fitted_to_the_noise(tmp_path: Path) -> None:
    """Between its ends it tells no place: the route stays where the rest of the fiber and its smoothness have it."""
    folder = located(tmp_path, {"conduit_slip": 16.0})
    run("add", folder, "conduit_slip", "--out", tmp_path / "second")
    before, after = json.loads((tmp_path / "second" / "ladder.json").read_text(encoding="utf-8"))["rungs"]
    assert before["chi2_per_dof"] > 1.5 and after["chi2_per_dof"] < 1.03 * after["noise_floor"]
    route = np.array(json.loads((tmp_path / "survey" / "truth.json").read_text(encoding="utf-8"))["route_xyz"])
    found = np.genfromtxt(tmp_path / "second" / "route.csv", delimiter=",", names=True)
    off = np.column_stack([found[axis] for axis in "xyz"]) - route[found["channel"].astype(int)]
    assert np.linalg.norm(off, axis=1).max() < 0.2


def test_a_bias_of_all_tracks_is_told_from_chance(tmp_path: Path) -> None:
    found = diagnosis(located(tmp_path, {"track_bias": 0.4}, passes=8, seed=5))
    first = found["candidates"][0]
    assert found["verdict"] == "missing-effect", found["words"]
    assert "track_bias" in {first["effect"], *first["confounded_with"]}, found["words"]


def test_two_effects_are_found_one_after_the_other(tmp_path: Path) -> None:
    folder = located(tmp_path, {"gauge_length": 0.15, "highpass": 0.1})
    said = run("explain", folder, "--out", tmp_path / "explained")
    rungs = json.loads((tmp_path / "explained" / "ladder.json").read_text(encoding="utf-8"))["rungs"]
    assert {"gauge_length", "highpass"} <= set(rungs[-1]["effects"]), said
    held_out = [rung["held_out_chi2_per_dof"] for rung in rungs]
    assert held_out == sorted(held_out, reverse=True)
    assert rungs[-1]["chi2_per_dof"] < 1.05 * rungs[-1]["noise_floor"]
    page = (tmp_path / "explained" / "explain.html").read_text(encoding="utf-8")
    assert "gauge_length was added" in page
    (first,) = set(rungs[1]["effects"]) - set(rungs[0]["effects"])
    assert f"<p>{first} is missing at the" in page


def test_a_vehicle_that_the_camera_missed_hides_no_other_effect(tmp_path: Path) -> None:
    found = diagnosis(located(tmp_path, {"unseen_vehicle": 0.8, "gauge_length": 0.15}))
    present = [c["effect"] for c in found["candidates"] if c["verdict"] == "present"]
    assert found["verdict"] == "missing-effect", found["words"]
    assert set(present) == {"unseen_vehicle", "gauge_length"}, found["words"]


PLUGIN = """
from solver.effect import Parameter, effect


@effect("wide_gauge", "interrogator", [Parameter("relative", "1", 0.1, lower=-0.5, upper=1.0)],
        physics="The gauge is longer than told.", source="A user.")
def wide_gauge(interrogator, p, survey):
    from dataclasses import replace
    return replace(interrogator, gauge_length=interrogator.gauge_length * (1 + p["relative"]))
"""


def test_add_extends_the_ladder_refuses_what_does_not_help_and_takes_a_user_effect(tmp_path: Path) -> None:
    folder = located(tmp_path, {"gauge_length": 0.15})
    plugin = tmp_path / "mine.py"
    plugin.write_text(PLUGIN, encoding="utf-8")
    run("add", folder, "wide_gauge", "--plugin", plugin, "--out", tmp_path / "second")
    ladder = json.loads((tmp_path / "second" / "ladder.json").read_text(encoding="utf-8"))["rungs"]
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


def test_noise_that_is_not_understood_ends_inconclusive(tmp_path: Path) -> None:
    import numpy as np

    folder = located(tmp_path, {"gauge_length": 0.15})
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
