"""The paper's study: its points, its surveys, one located survey, and what is drawn of the results."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import paper
from benchmarks.paper import (
    AXES,
    Axis,
    Setting,
    anchors_of,
    draw,
    run,
    settings_of,
    shifted,
    study,
    survey_of,
    table_of,
)
from solver.simulator import Survey
from vision.contract import InputError


def test_every_point_is_there_once():
    settings = settings_of(["snr", "anchors"], ["spline", "network"], 3, Setting())
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


def test_what_cannot_be_located_says_so(monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object, **__: object) -> None:
        raise InputError("nothing seen: mend it")

    monkeypatch.setattr(paper, "locate", refuse)
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
    settings, kept, asked = settings_of(["snr"], ["spline"], 2, Setting()), tmp_path / "results.json", []
    monkeypatch.setattr(paper, "run", lambda setting: asked.append(setting) or made(setting))
    study(settings[:5], kept)
    results = study(settings, kept)
    assert asked == settings
    assert results == json.loads(kept.read_text())
    assert results[settings[0].key] == made(settings[0])


def test_table_and_figure():
    settings = settings_of(["snr"], ["spline", "network"], 3, Setting())
    results = {setting.key: made(setting) for setting in settings}
    table = table_of(AXES["snr"], settings, results).set_index(["snr_db", "method"])
    assert table.loc[(-3, "spline"), "surveys"] == 3
    assert table.loc[(-3, "spline"), "failed"] == 1
    assert table.loc[(10, "network"), "ratio"] == pytest.approx(2.0)
    assert table.loc[(30, "spline"), "seconds"] == pytest.approx(2.0)
    figure = draw(AXES["snr"], table.reset_index())
    assert [axis.get_title() for axis in figure.axes] == [
        "mean error; 80 % of surveys, m",
        "Hausdorff distance, m",
        "seconds per survey",
    ]
    labels = figure.axes[1].get_legend_handles_labels()[1]
    assert "the paper, in the field" in labels and "the paper fails below 7 dB" in labels


@pytest.mark.parametrize("axis", AXES.values(), ids=list(AXES))
def test_every_axis_can_be_drawn(axis: Axis):
    settings = [Setting(**{axis.field: value}) for value in axis.values]
    table = table_of(axis, settings, {setting.key: made(setting) for setting in settings})
    assert len(draw(axis, table).axes) == 3


def test_the_command_prints_a_table_and_draws_a_figure_per_axis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(paper, "run", made)
    paper.main(["--axes", "anchors", "noise", "--methods", "spline", "--surveys", "2", "--out", str(tmp_path)])
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "anchors.png", "noise.png"}
    printed = capsys.readouterr().out
    assert "the paper needs 2 per 100 m" in printed and "expected" in printed
