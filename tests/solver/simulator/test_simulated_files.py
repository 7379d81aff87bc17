"""Simulated surveys as files: read back through the readers, and `roadfiber simulate` from the outside."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import roadfiber.command
from solver.simulator import Scenario, route_error, simulate, write_survey
from solver.survey.anchors import read_anchors
from solver.survey.das import read_das
from solver.survey.site import read_site
from vision.contract import InputError, read_trajectories


@pytest.fixture(scope="module", params=[False, True], ids=["meters", "gps"])
def written(request, tmp_path_factory):
    survey = simulate(Scenario(name='a "quoted" name', seed=8, passes=4, gps=request.param))
    return survey, read_site(write_survey(survey, tmp_path_factory.mktemp("survey")))


def test_the_site_and_the_record_read_back(written):
    survey, site = written
    assert site.name == 'a "quoted" name'
    assert len(site.das.files) == int(np.ceil(survey.time[-1] / 60))
    record = read_das(site.das.files, gauge_length=10.0, channel_spacing=1.021, quantity="strain_rate")
    scale = np.abs(survey.strain_rate).max()
    np.testing.assert_allclose(record.strain_rate, survey.strain_rate, atol=1e-6 * scale)
    np.testing.assert_allclose(record.time, survey.time, atol=1e-6)
    assert record.start == survey.start and record.gaps == ()


def test_the_trajectories_read_back(written):
    survey, site = written
    table = read_trajectories(site.trajectories.files, site.frame)
    for vehicle in survey.vehicles:
        fixes = table[table["track_id"] == vehicle.track_id]
        time = (fixes["time"].dt.tz_localize(None).to_numpy() - survey.start) / np.timedelta64(1, "s")
        error = fixes[["x", "y"]].to_numpy() - vehicle.position(time)
        assert np.abs(error).max() < 0.3 and 0.04 < error.std() < 0.08
        assert set(fixes["class"]) == {vehicle.vehicle_class}
        assert (fixes["sigma_x"] == 0.06).all()


def test_the_anchors_are_on_the_route(written):
    survey, site = written
    anchors = read_anchors(site.anchors.file, site.frame)
    assert len(anchors) == 2
    for anchor in anchors:
        assert np.abs(survey.route[int(anchor.channel)] - (anchor.x, anchor.y, anchor.z)).max() < 0.25


def test_the_truth_is_beside(written):
    survey, site = written
    known = json.loads((site.anchors.file.parent / "truth.json").read_text())
    np.testing.assert_allclose(known["route_xyz"], survey.route, atol=1e-4)
    assert known["hidden_effect"] == "none" and tuple(known["active_channels"]) == survey.active
    assert len(known["vehicles"]) == 4


def test_a_route_is_compared_over_all_that_it_locates(tmp_path, written):
    survey, site = written
    first, last = survey.active[0] - 5, survey.active[1] - 1
    shifted = survey.route + np.array([0.0, 0.3, -0.4])
    shifted[first] += np.array([0.0, 3.0, 0.0])  # out of view, and located all the same
    table = pd.DataFrame(shifted, columns=["x", "y", "z"]).assign(channel=np.arange(len(shifted)))
    table = table.assign(sigma_x=0.2, sigma_y=0.2, sigma_z=0.3, constrained=True)
    table.loc[first + 1, "constrained"] = False  # claims no place
    table[first:last].to_csv(tmp_path / "route.csv")
    error = route_error(tmp_path / "route.csv", site.anchors.file.parent / "truth.json")
    assert error.largest == pytest.approx(np.hypot(3.3, 0.4), abs=1e-3)
    assert error.in_view == pytest.approx(0.5, abs=1e-3)
    table.assign(constrained=False)[first:last].to_csv(tmp_path / "route.csv")
    none = route_error(tmp_path / "route.csv", site.anchors.file.parent / "truth.json")
    assert none.words == "no place is located, and in view the fit is 0.50 m off at most" and np.isnan(none.mean)
    assert error.largest_lateral == pytest.approx(3.3, abs=1e-3)
    assert error.largest_depth == pytest.approx(0.4, abs=1e-3)
    assert (error.channels, error.inside) == (last - first - 1, last - first - 2)


def test_a_gap_reads_back_as_one(tmp_path):
    survey = simulate(Scenario(seed=8, passes=1, gaps=2))
    site = read_site(write_survey(survey, tmp_path / "survey"))
    record = read_das(site.das.files, gauge_length=10.0, channel_spacing=1.021, quantity="strain_rate")
    lost = np.isnan(survey.strain_rate)
    assert lost.any() and not lost.all()
    assert 1 <= len(record.gaps) <= 2
    np.testing.assert_array_equal(np.isnan(record.strain_rate), lost)


def test_an_earlier_survey_is_replaced_and_nothing_else(tmp_path):
    survey = simulate(Scenario(seed=8, passes=1))
    folder = tmp_path / "survey"
    write_survey(survey, folder)
    (folder / "stale.txt").write_text("old")
    write_survey(survey, folder)
    assert not (folder / "stale.txt").exists()
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="no simulated survey"):
        write_survey(survey, mine)
    assert (mine / "thesis.tex").read_text() == "precious"


def run(*arguments):
    return CliRunner().invoke(roadfiber.command.app, ["simulate", *map(str, arguments)])


def test_the_command_writes_a_survey_that_reads(tmp_path):
    out = tmp_path / "survey"
    result = run("street", "--seed", 3, "--passes", 2, "--snr", 10, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["passes"] == 2 and read_site(out / "site.toml").name == "street"
    assert json.loads((out / "truth.json").read_text())["snr_db"] == 10
    again = tmp_path / "again"
    assert run("street", "--seed", 3, "--passes", 2, "--snr", 10, "--out", again).exit_code == 0
    for name in ("trajectories.csv", "anchors.csv", "site.toml", "truth.json", "das/das_0001.h5"):
        assert (again / name).read_bytes() == (out / name).read_bytes(), name


def test_the_command_hides_what_is_asked(tmp_path):
    out = tmp_path / "survey"
    words = ("--hide", "viscoelastic_lag=0.3", "--hide", "viscoelastic_lag_tau=0.4")
    assert run("street", "--passes", 1, *words, "--out", out).exit_code == 0
    known = json.loads((out / "truth.json").read_text())
    assert known["hidden_effect"] == "viscoelastic_lag"
    assert known["switches"] == {"viscoelastic_lag": 0.3, "viscoelastic_lag_tau": 0.4, "viscoelastic_lag_model": 0.0}
    failed = run("street", "--hide", "viscoelastic_lag", "--out", tmp_path / "other")
    assert isinstance(failed.exception, InputError) and "NAME=NUMBER" in str(failed.exception)


def test_a_bad_scenario_is_one_line_and_exit_2(tmp_path):
    out = tmp_path / "survey"
    command = [sys.executable, "-m", "roadfiber", "simulate", "strete", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.splitlines() == [
        "roadfiber: strete: neither a file nor a built-in scenario (street, street-short, street-gps, street-paper, "
        "street-filtered, street-blind, street-filmed)"
    ]
    assert not out.exists()
