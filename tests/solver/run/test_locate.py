"""`roadfiber locate` from files to a run folder, on surveys of the independent simulator."""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import roadfiber.command
from roadfiber.ingesting import draw_view
from solver.simulator import Scenario, Survey, simulate, write_survey
from vision.contract.statements import table_lines

Command = Callable[..., tuple[int, str, str]]
#: Where the route is what matters: what the model may lack is weighed in tests of its own.
LOCATE = ("-q", "locate", "--corridor", "fit")


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run `roadfiber ARGS` in this process; status, standard output, standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["roadfiber", *map(str, arguments)])
        try:
            roadfiber.command.main()
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


@pytest.fixture(scope="module")
def folder(street: Survey, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A survey as a user brings it."""
    path = tmp_path_factory.mktemp("survey")
    write_survey(street, path / "s")
    return path / "s"


def test_a_survey_that_does_not_fit_into_memory_is_refused_before_the_fit(
    folder: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for user in ("solver.survey.memory", "solver.fit.room"):
        monkeypatch.setattr(f"{user}.available", lambda: 1.5e8)
    monkeypatch.setattr("solver.run.locate.fit_route", lambda *given: pytest.fail("was fitted"))
    status, _, error = command(*LOCATE, folder, "--out", tmp_path / "run")
    assert status == 2 and error.count("\n") == 1
    assert " of memory, and 0.15 GB are free, enough for " in error and "channels at most, channels = [first" in error
    assert list(tmp_path.iterdir()) == []


def test_a_survey_becomes_a_run_folder(folder: Path, street: Survey, command: Command, tmp_path: Path) -> None:
    status, said, error = command("-q", "locate", folder, "--out", tmp_path / "run")
    assert status == 0, error
    assert said.startswith("\n".join(table_lines(draw_view(folder).statements))) and "report.html" in said
    first, last = street.active
    assert largest_error(tmp_path / "run", street) < 0.25
    facts = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert facts["effects"] == ["wheel_layout", "curved_gauge"]
    assert 0.9 < facts["chi2_per_dof"] < 1.1
    assert abs(facts["active_channels"][0] - first) <= 6 and abs(facts["active_channels"][1] - last) <= 6
    assert {path.name for path in (tmp_path / "run").iterdir()} >= {
        "route.csv",
        "route.geojson",
        "fit.json",
        "report.html",
    }


def largest_error(run: Path, street: Survey) -> float:
    first, last = street.active
    table = pd.read_csv(run / "route.csv").set_index("channel")
    return float(np.linalg.norm(table.loc[first:last, ["x", "y", "z"]] - street.route[first : last + 1], axis=1).max())


def test_channels_that_record_nothing_are_named_and_left_out(street: Survey, command: Command, tmp_path: Path) -> None:
    """Quiet ones mislead a fit most: with five of them it ended .5 to 1.7 m off."""
    first, last = street.active
    muted = [first + 15, first + 16, (first + last) // 2, last - 20]
    record = street.strain_rate.copy()
    record[:, muted] *= 0.05
    write_survey(replace(street, strain_rate=record), tmp_path / "s")
    status, said, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 0, error
    assert f"channels {muted[0]}-{muted[1]}, {muted[2]}, {muted[3]} left out, nearly silent" in said + error
    assert largest_error(tmp_path / "run", street) < 0.25


def test_wheels_of_an_unknown_class_are_fitted_and_it_is_said(street: Survey, command: Command, tmp_path: Path) -> None:
    """As point loads they cost decimeters, without a word."""
    tracks = street.trajectories.assign(**{"class": "Tuk-tuk"})
    write_survey(replace(street, trajectories=tracks), tmp_path / "s")
    status, _, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 0, error
    facts = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert any(line.startswith("class tuk tuk (4 passes) is not known; its wheels") for line in facts["warnings"])
    assert facts["effects"] == ["wheel_layout", "curved_gauge"]
    assert facts["chi2_per_dof"] < 1.03
    assert largest_error(tmp_path / "run", street) < 0.15


def test_a_rounded_record_is_located_and_its_step_said(street: Survey, command: Command, tmp_path: Path) -> None:
    """In steps of twice the noise quiet is zero: noise was told by its median, so that channels counted as dead."""
    step = 2.0 * street.noise_sd
    write_survey(replace(street, strain_rate=step * np.rint(street.strain_rate / step)), tmp_path / "s")
    status, _, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 0, error
    facts = json.loads((tmp_path / "run" / "fit.json").read_text())
    said = [line for line in facts["warnings"] if line.startswith(f"the record is rounded to steps of {step:.2g} 1/s")]
    assert len(said) == 1 and "counted as noise" in said[0]
    assert 0.8 < facts["chi2_per_dof"] < 1.1
    assert largest_error(tmp_path / "run", street) < 0.25


@pytest.mark.parametrize(("more", "seed"), [(0.15, 11), (0.2, 3)])
def test_ground_of_another_poisson_ratio_than_the_prior_says(
    more: float, seed: int, command: Command, tmp_path: Path
) -> None:
    """From a ratio of .4 on the waves beside a fiber have four crests: from .25 fits ended .5 m off and further."""
    street = Scenario(passes=4, snr_db=20.0, noise="street", view=(0.0, 45.0), effects={"poisson_ratio": more})
    survey = simulate(replace(street, seed=seed))
    write_survey(survey, tmp_path / "s")
    status, _, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 0, error
    assert largest_error(tmp_path / "run", survey) < 0.15
    facts = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert facts["parameters"]["poisson_ratio"]["value"] == pytest.approx(0.25 + more, abs=0.01)


def test_point_loads_push_the_tracks_away(folder: Path, street: Survey, command: Command, tmp_path: Path) -> None:
    """What a model lacks goes into the tracks' errors, which no camera would make; the anchors hold the route."""
    status, said, error = command(*LOCATE, folder, "--out", tmp_path / "run", "--effects", "none", "--json")
    assert status == 0, error
    assert json.loads(said)["effects"] == []
    facts = json.loads((tmp_path / "run" / "fit.json").read_text())
    across = [one["value"] for name, one in facts["parameters"].items() if name.startswith("across")]
    assert np.sqrt(np.mean(np.square(across))) > 0.15
    assert largest_error(tmp_path / "run", street) < 0.5


def test_without_anchors_two_lanes_tell_the_side(
    folder: Path, street: Survey, command: Command, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "s")
    site = tmp_path / "s" / "site.toml"
    text = site.read_text()
    site.write_text(text.replace(text[text.index("[anchors]") : text.index("[", text.index("[anchors]") + 1)], ""))
    status, _, error = command(*LOCATE, site, "--out", tmp_path / "run")
    assert status == 0, error
    table = pd.read_csv(tmp_path / "run" / "route.csv").set_index("channel")
    first, last = street.active
    assert np.abs(table.loc[first:last, "y"].to_numpy() - street.route[first : last + 1, 1]).max() < 0.5
    assert json.loads((tmp_path / "run" / "fit.json").read_text())["ambiguous_side"] is False


@pytest.mark.parametrize("seed", [402, 403])
def test_few_passes_without_anchors_end_on_the_right_side(seed: int, command: Command, tmp_path: Path) -> None:
    """They ended 4 and 15 m off with sigmas of .3 m: a fit on the wrong side had moved the tracks there."""
    survey = simulate(Scenario(seed=seed, passes=3, view=(0.0, 50.0)))
    site = write_survey(survey, tmp_path / "s")
    site.write_text(site.read_text().replace('[anchors]\nfile = "anchors.csv"\n', ""))
    status, _, error = command(*LOCATE, site, "--out", tmp_path / "run")
    assert status == 0, error
    facts = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert facts["ambiguous_side"] is False
    assert largest_error(tmp_path / "run", survey) < 0.4


def break_clock(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table["time"] = table["time"].str.replace("2025-", "2024-")
    table.to_csv(folder / "trajectories.csv", index=False)


def late_clock(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table["time"] = (pd.to_datetime(table["time"]) + pd.Timedelta(seconds=4)).dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    table.to_csv(folder / "trajectories.csv", index=False)


def clock_an_hour_off(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table["time"] = (pd.to_datetime(table["time"]) + pd.Timedelta(hours=1)).dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    table.to_csv(folder / "trajectories.csv", index=False)


def in_feet(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table[["x", "y"]] /= 0.3048
    table.to_csv(folder / "trajectories.csv", index=False)


def spacing_in_feet(folder: Path) -> None:
    site = folder / "site.toml"
    lines = site.read_text().splitlines()
    for name in ("gauge_length", "channel_spacing"):
        (at,) = (i for i, line in enumerate(lines) if line.startswith(name))
        lines[at] = f"{name} = {float(lines[at].split('=')[1].split('#')[0]) / 0.3048}"
    site.write_text("\n".join(lines))


def far_anchor(folder: Path) -> None:
    table = pd.read_csv(folder / "anchors.csv")
    table.loc[0, "x"] += 12600
    table.to_csv(folder / "anchors.csv", index=False)


def exchanged_anchors(folder: Path) -> None:
    table = pd.read_csv(folder / "anchors.csv")
    table.assign(channel=table["channel"].to_numpy()[::-1]).to_csv(folder / "anchors.csv", index=False)


def half_a_minute_late(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    late = pd.to_datetime(table["time"], utc=True, format="ISO8601") + pd.Timedelta(seconds=30)
    table.assign(time=late.map(lambda one: one.isoformat())).to_csv(folder / "trajectories.csv", index=False)


def across_the_road(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table.rename(columns={"x": "y", "y": "x"}).to_csv(folder / "trajectories.csv", index=False)


def empty_trajectories(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table.head(0).to_csv(folder / "trajectories.csv", index=False)


def corrupt_das(folder: Path) -> None:
    for path in folder.glob("das/*.h5"):
        path.write_bytes(b"no HDF5 at all")


def remove_das(folder: Path) -> None:
    shutil.rmtree(folder / "das")


def unknown_key(folder: Path) -> None:
    site = folder / "site.toml"
    site.write_text(site.read_text().replace("gauge_length", "gage_length"))


def no_site(folder: Path) -> None:
    (folder / "site.toml").unlink()


def shuffle_channels(folder: Path) -> None:
    import h5py

    for path in folder.glob("das/*.h5"):
        with h5py.File(path, "r+") as file:
            data = file["Acquisition/Raw[0]/RawData"]
            data[...] = np.random.default_rng(0).permuted(data[...], axis=0)


BROKEN = {
    break_clock: "overlap",
    clock_an_hour_off: "do not overlap in time; they are 1 h apart: a clock in local time, a zone that",
    in_feet: "it would if x and y of the trajectories were in feet: give them in m",
    spacing_in_feet: "it would if gauge_length and channel_spacing were in feet: give them in m",
    far_anchor: "m apart, but from channel",
    exchanged_anchors: "are not where vehicles are recorded on their channels; all would be if the channels of",
    half_a_minute_late: "it would if -30 s were added to the tracks' times",
    across_the_road: "it would if vehicles drove along x instead of y: see x_azimuth in [frame]",
    late_clock: "s ahead of that of the DAS; take",
    empty_trajectories: "trajectories.csv",
    corrupt_das: "das",
    remove_das: "no file matches",
    unknown_key: "gage_length",
    no_site: "site.toml",
    shuffle_channels: "DAS record",
}
#: Records in which nothing follows the trajectories: a picture shows what was seen.
PICTURED = (in_feet, spacing_in_feet, half_a_minute_late, across_the_road, shuffle_channels)


@pytest.mark.parametrize("damage", BROKEN, ids=lambda damage: damage.__name__)
def test_bad_input_is_one_line_and_nothing_written(
    damage: Callable[[Path], None], folder: Path, command: Command, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "s")
    damage(tmp_path / "s")
    status, said, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 2
    assert said == ""
    assert error.count("\n") == 1 and error.startswith("roadfiber: ") and BROKEN[damage] in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run-refused.png"] * (damage in PICTURED) + ["s"]


def dead_channels(folder: Path, first: int, last: int) -> None:
    import h5py

    for path in folder.glob("das/*.h5"):
        with h5py.File(path, "r+") as file:
            file["Acquisition/Raw[0]/RawData"][:, first : last + 1] = 0


def test_a_wrong_anchor_and_dead_channels_are_named(
    folder: Path, street: Survey, command: Command, tmp_path: Path
) -> None:
    """The route stays within its sigmas, and what is wrong is said."""
    shutil.copytree(folder, tmp_path / "s")
    middle = sum(street.active) // 2
    dead_channels(tmp_path / "s", middle, middle + 3)
    anchors = next((tmp_path / "s").glob("anchors.csv"))
    table = pd.read_csv(anchors)
    table.loc[0, "y"] += 1.5
    table.to_csv(anchors, index=False)
    status, _, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 0, error
    said = json.loads((tmp_path / "run" / "fit.json").read_text())["warnings"]
    assert any(f"one value most of the time on channels {middle}-{middle + 3};" in line for line in said)
    assert any(line.startswith(f"anchor {table.loc[0, 'name']} is 1.") and "left out" in line for line in said)
    assert largest_error(tmp_path / "run", street) < 0.25


def only_one_vehicle(folder: Path) -> None:
    table = pd.read_csv(folder / "trajectories.csv")
    table[table["track_id"] == table["track_id"].iloc[0]].to_csv(folder / "trajectories.csv", index=False)


def test_one_pass_is_said_to_be_few(folder: Path, command: Command, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "s")
    only_one_vehicle(tmp_path / "s")
    status, _, error = command(*LOCATE, tmp_path / "s", "--out", tmp_path / "run")
    assert status == 0, error
    said = json.loads((tmp_path / "run" / "fit.json").read_text())["warnings"]
    assert any(line.startswith("one pass only: ") and "survey at least four" in line for line in said)


@pytest.mark.parametrize("option", [("--method", "magic"), ("--effects", "magic")])
def test_unknown_options_are_named(option: tuple[str, str], folder: Path, command: Command, tmp_path: Path) -> None:
    status, _, error = command(*LOCATE, folder, "--out", tmp_path / "run", *option)
    assert status == 2 and "magic" in error and error.count("\n") == 1


@pytest.mark.parametrize("name", ["survey-01", "survey-02"])
def test_practice_surveys_within_a_quarter_meter(
    name: str, shared_data: Path, command: Command, tmp_path: Path
) -> None:
    status, _, error = command(*LOCATE, shared_data / "practice" / name, "--out", tmp_path / "run")
    assert status == 0, error
    answer = json.loads((shared_data / "practice" / "answers.json").read_text())[name]
    table = pd.read_csv(tmp_path / "run" / "route.csv").set_index("channel")
    first, last = answer["active_channels"]
    truth = np.array(answer["route_xyz"])[first : last + 1]
    assert np.linalg.norm(table.loc[first:last, ["x", "y", "z"]].to_numpy() - truth, axis=1).max() <= 0.25


def test_in_much_noise_filters_help_the_matched_filter(command: Command, tmp_path: Path) -> None:
    survey = simulate(Scenario(seed=4, noise="street", track_noise="camera", snr_db=-8.0))
    folder = write_survey(survey, tmp_path / "s").parent
    status, _, error = command(*LOCATE, folder, "--out", tmp_path / "plain")
    assert status == 2 and "--filter fk" in error
    status, _, error = command(*LOCATE, folder, "--filter", "fk", "--filter", "median", "--out", tmp_path / "run")
    assert status == 0, error
    table = pd.read_csv(tmp_path / "run" / "route.csv")
    off = table[["x", "y", "z"]] - survey.route[table["channel"]]
    first, last = survey.active
    assert np.linalg.norm(off[table["channel"].between(first, last)], axis=1).max() < 0.5
    status, _, error = command(*LOCATE, folder, "--filter", "kf", "--out", tmp_path / "none")
    assert status == 2 and "choose of fk, median" in error
