"""The paper's study: its points, its surveys, one located survey, and what is drawn of the results."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import roadfiber as rf
from roadfiber import study_surveys
from roadfiber.command import app
from roadfiber.study_surveys import (
    AXES,
    Axis,
    Setting,
    anchors_of,
    run,
    settings_of,
    shifted,
    studied,
    survey_of,
)
from roadfiber.study_tables import claims_of, draw, table_of
from roadfiber.studying import Study
from solver.simulator import Survey, write_survey
from solver.survey.survey import Survey as Read
from tests.offline_pages import EVIL, is_whole, tells
from vision.contract import InputError


def test_every_point_is_there_once():
    settings = settings_of([AXES["snr"], AXES["anchors"]], ["spline", "network"], 3, Setting())
    # The point that both axes share is located once.
    assert len(settings) == 3 * 2 * (len(AXES["snr"].values) + len(AXES["anchors"].values) - 1)
    assert len({setting.key for setting in settings}) == len(settings)
    # Equal settings have equal keys, so each value has the type of its field.
    assert {Setting(**json.loads(setting.key)).key for setting in settings} == {setting.key for setting in settings}
    for name, axis in AXES.items():
        assert {type(value) for value in axis.values} == {type(getattr(Setting(), axis.field))}, name
    assert {setting.seed for setting in settings[: len(settings) // 3]} == {0}


@pytest.fixture(scope="module")
def survey() -> Survey:
    return survey_of(Setting(passes=2))


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_anchors_lie_on_the_fiber_evenly(survey: Survey, count: int):
    table = anchors_of(survey, count, np.random.default_rng(0))
    assert len(table) == count
    away = table[["x", "y", "z"]].to_numpy(float) - survey.route[table["channel"].to_numpy(int)]
    assert (np.abs(away) < 0.25).all()
    if count > 2:
        assert np.ptp(np.diff(table["channel"])) <= 1


def test_the_settings_reach_the_survey(survey: Survey):
    scenario = survey_of(Setting(passes=1, poisson_error=0.02, track_noise=0.3, snr_db=3.0, loads="wheels")).scenario
    assert (scenario.poisson_ratio, scenario.fix_sigma, scenario.snr_db) == (0.27, 0.3, 3.0)
    assert not scenario.effect("point_load")
    assert survey.scenario.effect("point_load") == 1.0


def test_whole_tracks_are_shifted_alike(survey: Survey):
    table = survey.trajectories
    moved = shifted(table, 0.5, np.random.default_rng(0))
    by_track = (moved[["x", "y"]] - table[["x", "y"]]).groupby(table["track_id"])
    assert (by_track.std() < 1e-9).all().all()
    assert (by_track.mean().abs() > 0.01).all().all()
    assert shifted(table, 0.0, np.random.default_rng(0)).equals(table)


def test_a_survey_is_located_near_the_truth_and_near_what_is_expected():
    row = run(Setting(passes=2, snr_db=20.0))
    assert row["mean"] < 0.2
    assert row["mean"] < row["largest"] < 0.4
    assert row["hausdorff"] <= row["largest"] + 1e-9
    assert row["located_share"] > 0.95
    assert 0.3 < row["mean"] / row["expected_mean"] < 3.0


def test_a_survey_without_anchors_is_read_as_one(tmp_path: Path):
    site = write_survey(survey_of(Setting(passes=1, anchors=0)), tmp_path / "survey")
    assert Read.read(site).anchors == []


def test_what_cannot_be_located_says_so(monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object, **__: object) -> None:
        raise InputError("nothing seen: mend it")

    monkeypatch.setattr(study_surveys, "locate", refuse)
    assert run(Setting(passes=1)) == {"failed": "nothing seen: mend it"}


def made(setting: Setting) -> dict[str, float | str]:
    """Results that get worse as the SNR falls; one survey fails."""
    if setting.snr_db < 0 and setting.seed == 1:
        return {"failed": "too quiet"}
    error = 0.1 * 10 ** (-(setting.snr_db - 10) / 20) * (2 if setting.method == "network" else 1)
    return {
        "mean": error,
        "largest": 2 * error,
        "hausdorff": 1.8 * error,
        "expected_mean": 0.1 * 10 ** (-(setting.snr_db - 10) / 20),
        "expected_largest": error,
        "covered": 0.95,
        "seconds": 1.0 + setting.seed,
    }


def test_a_stopped_study_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    settings, kept, asked = settings_of([AXES["snr"]], ["spline"], 2, Setting()), tmp_path / "results.json", []
    monkeypatch.setattr(study_surveys, "run", lambda setting: asked.append(setting) or made(setting))
    studied(settings[:5], kept)
    results = studied(settings, kept)
    assert asked == settings
    assert results == json.loads(kept.read_text())
    assert results[settings[0].key] == made(settings[0])


def test_table_and_figure():
    settings = settings_of([AXES["snr"]], ["spline", "network"], 3, Setting())
    results = {setting.key: made(setting) for setting in settings}
    table = table_of(AXES["snr"], settings, results).set_index(["snr_db", "method"])
    assert table.loc[(-3, "spline"), "surveys"] == 3
    assert table.loc[(-3, "spline"), "failed"] == 1
    assert table.loc[(10, "network"), "ratio"] == pytest.approx(2.0)
    assert table.loc[(30, "spline"), "seconds"] == pytest.approx(2.0)
    figure = draw(AXES["snr"], table.reset_index())
    assert [axis.get_title(loc="left") for axis in figure.axes] == [
        "Mean error, m; bands: 80 % of surveys",
        "Off at most (Hausdorff distance), m",
        "Seconds per survey",
    ]
    labels = figure.axes[1].get_legend_handles_labels()[1]
    assert "the paper, in the field" in labels and "the paper fails below 7 dB" in labels


@pytest.mark.parametrize("axis", AXES.values(), ids=list(AXES))
def test_every_axis_can_be_drawn(axis: Axis):
    settings = [Setting(**{axis.field: value}) for value in axis.values]
    table = table_of(axis, settings, {setting.key: made(setting) for setting in settings})
    assert len(draw(axis, table).axes) == 3


@pytest.fixture
def quickly(monkeypatch: pytest.MonkeyPatch) -> list[Setting]:
    """Located at once, with results made up; what was asked for."""
    asked = list[Setting]()
    monkeypatch.setattr(study_surveys, "run", lambda setting: asked.append(setting) or made(setting))
    return asked


def test_a_study_is_saved_as_page_tables_and_figures(tmp_path: Path, quickly: list[Setting]):
    done = rf.study(tmp_path, axes=["anchors", "noise"], methods=["spline"], surveys=2)
    done.save(tmp_path)
    files = {"results.json", "study.html", "claims.csv", "anchors.csv", "anchors.png", "noise.csv", "noise.png"}
    assert {path.name for path in tmp_path.iterdir()} == files
    page = done.page()
    assert "the paper needs 2 per 100 m" in page and "field data were not at hand" in page and "<script" not in page
    assert is_whole(page)
    assert list(done.claims["method"]) == ["spline", "spline"]
    assert done.facts["tables"]["noise"][0]["surveys"] == 2
    count = len(quickly)
    assert rf.study(tmp_path, axes=["noise"], methods=["spline"], surveys=2).results.keys() <= done.results.keys()
    assert len(quickly) == count  # nothing is located twice


def test_names_that_are_markup_are_text_on_the_page():
    axis = Axis("snr_db", EVIL, (0.0, 10.0), 7.0, EVIL, True)
    settings = [Setting(method=EVIL, snr_db=value) for value in axis.values]
    results = {one.key: made(one) for one in settings} | {settings[0].key: {"failed": EVIL}}
    page = Study({EVIL: axis}, {EVIL: settings}, results).page()
    assert tells(page) and is_whole(page) and "claims: " in page


def test_a_quick_study_by_the_command(tmp_path: Path, quickly: list[Setting]):
    done = CliRunner().invoke(app, ["study", "--quick", "--out", str(tmp_path)])
    assert done.exit_code == 0 and "the paper fails below 7 dB" in done.output and "expected" in done.output
    assert {(one.passes, one.seed) for one in quickly} == {(3, 0)}
    assert {one.method for one in quickly} == {"spline", "network-whitened", "geometric"}
    assert {one.snr_db for one in quickly} == {0.0, 10.0}


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"axes": ["weather"]}, "--axes weather: not known; choose of snr"),
        ({"methods": ["guess"]}, "--methods guess: not known; choose of spline"),
        ({"loads": "feathers"}, "--loads feathers: not known"),
    ],
)
def test_what_cannot_be_studied_is_one_line(tmp_path: Path, asked: dict, said: str):
    with pytest.raises(InputError, match=said):
        rf.study(tmp_path / "a", **asked)
    assert not (tmp_path / "a").exists()


def test_results_of_something_else_are_left_alone(tmp_path: Path):
    (tmp_path / "results.json").write_text('{"mine": 1}')
    with pytest.raises(InputError, match="holds no results of a study"):
        rf.study(tmp_path, axes=["snr"], methods=["spline"], surveys=1)
    assert (tmp_path / "results.json").read_text() == '{"mine": 1}'


def test_claims_are_told_from_the_tables():
    def claim(axis: str, distance: dict[float, float]) -> pd.Series:
        values = {AXES[axis].field: list(distance), "method": "network", "hausdorff": list(distance.values())}
        return claims_of({axis: AXES[axis]}, {axis: pd.DataFrame(values)}).iloc[0]

    assert claim("snr", {0.0: 3.0, 7.0: 0.4, 20.0: 0.2})["agrees"]
    still = claim("snr", {0.0: 0.3, 7.0: 0.2, 20.0: 0.1})  # it does not fail where the paper says that it does
    assert not still["agrees"] and "0.30 m beyond" in still["found"]
    assert not claim("noise", {0.1: 0.9, 0.35: 0.4, 0.7: 0.8})["agrees"]
    assert claim("snr", {10.0: 0.2})["agrees"] is None
    assert claim("poisson", {-0.05: 0.30, 0.0: 0.05, 0.05: 0.30})["agrees"]
    assert not claim("poisson", {-0.05: 0.06, 0.0: 0.05, 0.05: 0.06})["agrees"]
