"""The corridor of a run: what is added to its fit's reaches every file and page."""

import json
from dataclasses import replace

import numpy as np
import pytest

from roadfiber.locate_commands import summary
from solver.run.folder import read_run
from solver.run.geojson import Z95, half_width, route_features
from solver.run.report.report_page import render
from solver.run.run import Run, run_of
from solver.run.run_corridor import corridor_facts, corridor_sentence, median_half, placed


def wider(run: Run, more: float) -> Run:
    """The run with so much more variance across, m^2."""
    added = np.tile(np.diag([0.0, more, 0.0]), (len(run.result.channel), 1, 1))
    told = {"widest": "gauge_length", "title": "gauge length", "share": 0.8, "narrower": "a survey with a second lane"}
    explained = {"title": "Gauge length", "kind": "effect", "effects": ["gauge_length"], "stage": "interrogator"}
    facts = corridor_facts(run.result, added, **told, explanations=[explained | {"probability": 0.9}])
    return replace(run, added=added, facts=run.facts | {"corridor": facts})


@pytest.fixture
def run(survey) -> Run:
    return run_of(survey.result, **survey.arguments)


def test_a_run_as_fitted_says_that_it_takes_its_model_for_granted(run):
    assert run.facts["corridor"]["full"] is False and run.added is None
    assert "if the model lacks nothing; what it may lack was not looked at." in run.corridor
    np.testing.assert_array_equal(run.route["sigma_y"], run.route["sigma_y_fit"])
    assert "If the model holds, the corridor holds the fiber at any one place in 95 of 100 surveys" in render(run)


def test_what_a_corridor_leaves_out_goes_with_the_route(run):
    sure = run.place.reliable
    assert set(run.route["reason"][sure]) == {run.corridor}, "of a run that looked at nothing it may lack"
    assert run.route["reason"][~sure].str.contains("neither data nor anchors decide").all() and 0 < sure.sum() < len(
        sure
    )
    features = [one["properties"] for one in route_features(run.place, run.frame, [], run.name)["features"]]
    assert {one["reason"] for one in features} == {f"{run.trust} {run.corridor}"} and len(features) > 1
    assert wider(run, 0.25).place.told == run.trust


def test_how_much_of_the_error_all_places_share_is_told_and_kept(survey, tmp_path):
    run = run_of(replace(survey.result, shared=(0.6, 0.93)), **survey.arguments)
    run.save(tmp_path / "run")
    assert "all share 60 % of the variance of y and 93 % of that of the depth" in render(read_run(tmp_path / "run"))


def test_both_sigmas_come_back_from_a_saved_run(run, tmp_path):
    wide = wider(run, 0.25)
    wide.save(tmp_path / "run")
    again = read_run(tmp_path / "run")
    np.testing.assert_allclose(again.route["sigma_y"] ** 2 - again.route["sigma_y_fit"] ** 2, 0.25)
    np.testing.assert_array_equal(again.route["sigma_y_fit"], run.result.sigma[:, 1])
    assert again.facts["corridor"] == wide.facts["corridor"] and again.corridor == wide.corridor


def test_every_file_draws_the_wide_corridor(run, tmp_path):
    wide = wider(run, 0.25)
    wide.save(tmp_path / "run")
    features = json.loads((tmp_path / "run" / "route.geojson").read_text(encoding="utf-8"))["features"]
    most = max(one["properties"].get("half_width_max_m", 0.0) for one in features)
    half = half_width(run.result.route, wide.place.covariance)
    assert most == pytest.approx(half.max(), abs=1e-3) and most > 0.5 * Z95 * 0.9
    assert wide.facts["corridor"]["half_width"] == median_half(placed(run.result, wide.added))
    page = render(wide)
    assert (
        "It is widened most by gauge length (80 % of what is added); a survey with a second lane would narrow it."
        in page
    )
    assert "<td>90 %</td>" in page and "if the model lacks nothing" in page


def test_nothing_is_said_of_what_widens_a_corridor_by_little(run):
    facts = wider(run, 1e-9).facts["corridor"]
    assert corridor_sentence(facts).endswith("m if it lacks nothing.")


def test_a_route_without_sigmas_has_no_sentence(run):
    unknown = replace(run.result, covariance=np.full_like(run.result.covariance, np.nan))
    assert corridor_sentence(corridor_facts(unknown)) == ""


def test_a_fit_that_has_not_converged_tells_no_corridor(survey, tmp_path):
    result = replace(survey.result, converged=False, constrained=np.zeros_like(survey.result.constrained))
    stopped = run_of(result, **survey.arguments)
    assert stopped.corridor == "" and "half_width" in stopped.facts["corridor"]
    page = render(stopped)
    assert "The fit has not converged: no uncertainty is known of where it stopped" in page
    assert "expected smoothness of a cable decides more" not in page
    assert "where it stopped has no corridor" in page and "the corridor should hold the fiber" not in page
    stopped.save(tmp_path / "run")
    assert read_run(tmp_path / "run").corridor == ""
    assert "the data decide no place of the fiber" in summary(stopped, tmp_path / "run")
