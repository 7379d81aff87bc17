"""The run folder: what is in it, that it comes back, and that nothing is half-written."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from solver.fit.held_out import HeldOut
from solver.fit.result import FitResult
from solver.run import folder as run_folder
from solver.run.folder import check_target, read_run
from solver.run.run import run_of
from vision.contract import InputError


@pytest.fixture
def quick(monkeypatch):
    """Leave the drawing to the tests of the report."""
    monkeypatch.setattr("solver.run.report.report_page.render", lambda run: "<!doctype html>")


def no_constant(text: str) -> None:
    raise AssertionError(f"{text} is not JSON")


def strict(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"), parse_constant=no_constant)


def test_folder_holds_its_six_files_and_nothing_beside_it(survey, tmp_path):
    run_of(survey.result, **survey.arguments).save(tmp_path / "runs" / "a")
    assert (tmp_path / "runs" / "a" / "report.html").read_text(encoding="utf-8").endswith("</html>\n")
    names = {path.name for path in (tmp_path / "runs" / "a").iterdir()}
    assert names == {"route.csv", "route.geojson", "fit.json", "report.html", "index.html", "data.npz"}
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["a"]


def test_route_table_has_the_documented_columns_and_values(survey, tmp_path, quick):
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    table = pd.read_csv(tmp_path / "run" / "route.csv")
    expected = [
        "channel",
        "distance",
        "x",
        "y",
        "z",
        "sigma_x",
        "sigma_y",
        "sigma_z",
        "sigma_x_fit",
        "sigma_y_fit",
        "sigma_z_fit",
        "latitude",
        "longitude",
        "constrained",
        "trust",
        "reason",
        "corner",
    ]
    assert list(table) == expected
    assert table["channel"].tolist() == survey.result.channel.tolist()
    np.testing.assert_allclose(table[["x", "y", "z"]], survey.result.route, atol=6e-5)
    np.testing.assert_allclose(table[["sigma_x", "sigma_y", "sigma_z"]], survey.result.sigma, atol=6e-5)
    assert table["constrained"].dtype == bool
    assert table["constrained"].tolist() == survey.result.constrained.tolist()


def test_latitude_and_longitude_lead_back_to_x_and_y(survey, tmp_path, quick):
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    table = pd.read_csv(tmp_path / "run" / "route.csv")
    x, y = survey.site.frame.to_local(table["latitude"], table["longitude"])
    np.testing.assert_allclose(np.stack([x, y], 1), survey.result.route[:, :2], atol=1e-3)


def test_fit_json_has_the_documented_keys(survey, tmp_path, quick):
    arguments = survey.arguments | {
        "held_out": HeldOut(11000.0, 10000.0, 0.0, 0.0),
        "effects": ["wheel_layout"],
        "warnings": ["a line"],
    }
    run_of(survey.result, **arguments).save(tmp_path / "run")
    facts = strict(tmp_path / "run" / "fit.json")
    assert facts["parameters"]["amplitude[1]"] == {"value": 1.2e-5, "sigma": 2e-7, "unit": "m^2", "free": True}
    assert facts["effects"] == ["wheel_layout"]
    assert facts["chi2_per_dof"] == 1.01
    assert facts["held_out_chi2_per_dof"] == 1.1
    assert facts["active_channels"] == [53, 107]
    assert facts["timings"] == {"fit": 1.5}
    assert {"python", "roadfiber", "torch", "numpy"} <= set(facts["versions"])
    assert facts["warnings"][-1] == "a line"
    inputs = {entry["role"]: entry["sha256"] for entry in facts["inputs"]}
    assert inputs == {
        "das": "ab" * 32,
        "trajectories": "387668e22f8946c1a1dfa26267805821b7ff8d66efee9347c9a2a872f2863748",
    }


def test_noise_floor_is_the_mean_square_of_the_quiet_samples(survey, tmp_path, quick):
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    assert strict(tmp_path / "run" / "fit.json")["noise_floor"] == pytest.approx(1.0, abs=0.03)
    louder = replace(survey.problem, noise=survey.problem.noise / 2)
    run_of(survey.result, **survey.arguments | {"problem": louder}).save(tmp_path / "louder")
    # Huber's weights hold back what is beyond 4 sigmas: a little less than 4.
    assert 3.2 < strict(tmp_path / "louder" / "fit.json")["noise_floor"] < 4.0


def test_what_is_not_a_number_becomes_null(survey, tmp_path, quick):
    nothing = np.full_like(survey.result.covariance, np.nan)
    unsure = survey.changed(covariance=nothing, chi2_per_dof=float("inf"))
    run_of(unsure.result, **unsure.arguments).save(tmp_path / "run")
    facts = strict(tmp_path / "run" / "fit.json")
    assert facts["chi2_per_dof"] is None
    assert facts["parameters"]["wheelbase[b/2]"]["sigma"] is None
    assert facts["held_out_chi2_per_dof"] is None
    assert any("uncertainty" in line for line in facts["warnings"])
    features = strict(tmp_path / "run" / "route.geojson")["features"]
    assert [item["geometry"]["type"] for item in features] == ["LineString", "Point"]
    assert pd.read_csv(tmp_path / "run" / "route.csv")["sigma_y"].isna().all()


def test_run_comes_back(survey, tmp_path, quick):
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    run = read_run(tmp_path / "run")
    for field in fields(FitResult):
        ours, theirs = getattr(survey.result, field.name), getattr(run.result, field.name)
        if field.name in ("measured", "model", "weight"):
            np.testing.assert_allclose(theirs, ours, rtol=1e-6)
        elif isinstance(ours, np.ndarray):
            np.testing.assert_array_equal(theirs, ours)
        elif field.name == "parameters":
            assert str(theirs) == str(ours)
        else:
            assert theirs == ours
    assert run.anchors == survey.anchors
    assert run.frame == survey.site.frame
    assert run.start == survey.record.start
    np.testing.assert_array_equal(run.time, survey.record.time[survey.result.samples])
    for ours, theirs in zip(survey.passes, run.passes, strict=True):
        for field in fields(ours):
            np.testing.assert_array_equal(getattr(theirs, field.name), getattr(ours, field.name))


def test_nothing_is_left_when_writing_fails(survey, tmp_path, quick, monkeypatch):
    def broken(run):
        raise OSError("disk full")

    monkeypatch.setattr("solver.run.report.report_page.render", broken)
    with pytest.raises(InputError, match="disk full"):
        run_of(survey.result, **survey.arguments).save(tmp_path / "out" / "run")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_run_stays_when_writing_fails_and_goes_when_it_does_not(survey, tmp_path, quick, monkeypatch):
    run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    before = (tmp_path / "run" / "fit.json").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(run_folder, "write_arrays", lambda path, run: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            run_of(survey.result, **survey.arguments).save(tmp_path / "run")
    assert (tmp_path / "run" / "fit.json").read_bytes() == before
    run_of(replace(survey.result, iterations=99), **survey.arguments).save(tmp_path / "run")
    assert read_run(tmp_path / "run").result.iterations == 99


def test_a_folder_of_something_else_is_never_replaced(survey, tmp_path, quick):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with pytest.raises(InputError, match="something else than a run"):
        run_of(survey.result, **survey.arguments).save(tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter.txt").read_text() == "years of work"
    with pytest.raises(InputError, match="a file"):
        check_target(tmp_path / "thesis" / "chapter.txt")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda folder: (folder / "fit.json").unlink(), "no run folder"),
        (lambda folder: (folder / "fit.json").write_text("{"), "invalid JSON"),
        (lambda folder: (folder / "fit.json").write_text("[1]"), "an object"),
        (lambda folder: (folder / "fit.json").write_text('{"format": "thesis"}'), "format: input should be 'roadfiber"),
        (lambda folder: (folder / "data.npz").unlink(), "arrays"),
        (lambda folder: (folder / "data.npz").write_bytes(b"PK\x03\x04 cut short"), "arrays"),
        (lambda folder: np.savez(folder / "data.npz", time=np.zeros(3)), "arrays"),
    ],
)
def test_what_is_not_a_run_is_refused_in_one_line(survey, tmp_path, quick, spoil, message):
    folder = tmp_path / "run"
    run_of(survey.result, **survey.arguments).save(folder)
    spoil(folder)
    with pytest.raises(InputError, match=message) as caught:
        read_run(folder)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="no run folder"):
        read_run(tmp_path / "nowhere")


def test_where_you_are_is_not_replaced(tmp_path, monkeypatch):
    (tmp_path / "run" / "below").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "run")
    for name in (".", tmp_path / "run", "below/.."):
        with pytest.raises(InputError, match="is where you are, and would be replaced"):
            check_target(Path(name))
    check_target(Path("below"))
