"""Runs of several days make the route that one fit of all their passes finds."""

import json
from dataclasses import replace

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import roadfiber as rf
from roadfiber.locating import open_street
from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.fit.spline import fit_spline
from solver.fit.stretches import part
from solver.run.run import Run, run_of
from solver.run.run_corridor import lacking
from solver.signal_path.traffic import Traffic
from tests.offline_pages import EVIL, is_whole, tells
from vision.contract import InputError, LocalFrame
from vision.contract.palette import ROUTE

FRAME = LocalFrame((32.0, 34.8), 78.0)


def made_run(result: FitResult, problem: Problem, day: int) -> Run:
    """A run of some day in August."""
    start, time = np.datetime64(f"2025-08-{day}T06:00:00", "ns"), np.arange(len(problem.record)) / problem.sampling_rate
    lists = list(problem.passes), list(problem.anchors)
    facts = {"name": f"day {day}", "trust": {"grade": "good", "sentence": "No check failed."}, "corridor": {"why": ""}}
    return Run(result, FRAME, start, time[result.samples], *lists, facts, problem=problem)


@pytest.fixture(scope="module")
def days(case) -> tuple[FitResult, list[Run], rf.Combined]:
    """One fit of four passes, to its very end; a run of the first two of them and one of the others; both combined."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solver.fit.least_squares.ENOUGH", 0.01)
        every, problem = slice(None, None, 3), case.problem
        columns = {name: getattr(problem, name)[every] for name in ("noise", "channel", "start")}
        whole = replace(problem, record=problem.record[:, every], traffic=Traffic.of(problem.passes), **columns)
        parts = [part(whole, np.array(numbers)) for numbers in ([0, 1], [2, 3])]
        runs = [made_run(fit_spline(few), few, 10 + day) for day, few in enumerate(parts)]
        return fit_spline(whole), runs, rf.combine(*runs)


def test_the_route_is_that_of_one_fit_of_all(days) -> None:
    every, runs, combined = days
    place = combined.place
    assert combined.converged and place.channel.tolist() == every.channel.tolist()
    off = np.abs(place.route - every.route)
    assert (off < 0.02 * every.sigma).all()
    np.testing.assert_allclose(place.sigma / combined.widened, every.sigma, rtol=0.02)
    average = sum(run.result.route for run in runs) / 2
    assert np.abs(average - every.route).max() > 10 * off.max()


def test_runs_of_a_long_fiber_make_the_route_of_one_long_fit(case) -> None:
    """With stretches of 15 m, each with vehicles of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solver.fit.least_squares.ENOUGH", 0.01)
        patch.setattr("solver.fit.longest.ONE_STRETCH", 30.0)
        patch.setattr("solver.fit.stretches.STRETCH", 15.0)
        whole = replace(case.problem, effects=())
        parts = [part(whole, np.array(numbers)) for numbers in ([0, 1], [2, 3])]
        runs = [made_run(fit_spline(few), few, 10 + day) for day, few in enumerate(parts)]
        every, combined = fit_spline(whole), rf.combine(*runs)
    assert len({name for name in every.parameters if name.startswith("amplitude[")}) > len(whole.passes)
    assert combined.converged
    # What is near a stretch is told from where a fit begins: some samples more or less.
    off = np.abs(combined.place.route - every.route)
    assert (off < 0.05 * every.sigma).all()
    np.testing.assert_allclose(combined.place.sigma / combined.widened, every.sigma, rtol=0.005)


def test_runs_that_agree_are_said_to(days) -> None:
    _, _, combined = days
    assert combined.headline.startswith("2 runs with 4 passes make one route") and "all agree" in combined.headline
    assert combined.table["passes"].tolist() == [2, 2] and (combined.table["across_z"].abs() < 3).all()
    assert 1 <= combined.widened < 2
    nowhere = replace(combined.place, constrained=np.zeros_like(combined.place.constrained))
    assert "whose place no data decide" in replace(combined, place=nowhere).headline


def test_what_the_models_of_all_runs_may_lack_does_not_average_out(days) -> None:
    _, runs, combined = days
    channel = combined.place.channel
    assert not lacking(runs, channel).any() and (combined.place.sigma == combined.place.sigma_fit).all()
    more = np.tile(np.diag([0.0, 0.25, 0.0]), (len(runs[0].result.channel), 1, 1))
    np.testing.assert_allclose(lacking([replace(run, added=more) for run in runs], channel)[:, 1, 1], 0.25)
    one = lacking([replace(runs[0], added=more), runs[1]], channel)[:, 1, 1]
    assert ((one > 0) & (one < 0.25)).all()


def test_a_camera_that_is_off_is_named_and_widens_the_sigmas(days) -> None:
    """All that the second camera saw is half a meter aside; there are no anchors."""
    _, (first, second), combined = days
    aside = np.array([0.0, 0.5])
    passes = [replace(one, position=one.position + aside) for one in second.problem.passes]
    moved = replace(second.problem, passes=passes, traffic=Traffic.of(passes), anchors=[])
    route = replace(second.result, route=second.result.route + np.array([0.0, 0.5, 0.0]))
    runs = [replace(first, problem=replace(first.problem, anchors=[])), replace(second, problem=moved, result=route)]
    found = rf.combine(*runs)
    assert "differ from it by more than their sigmas" in found.headline and "day 11" in found.headline
    assert found.widened > 2 * combined.widened
    assert found.agreement[0].across < 0 < found.agreement[1].across


def test_what_is_written_is_what_was_found_and_opens_again(days, survey, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("solver.run.report.report_page.render", lambda run: "<!doctype html>")
    whole = run_of(survey.result, **survey.arguments)
    combined, both = replace(days[2], runs=[whole, whole], frame=whole.frame), tmp_path / "both"
    combined.save(both)
    assert {path.name for path in both.iterdir()} == {
        *("route.csv", "route.geojson", "combined.json", "combined.html", "data.npz", "runs")
    }
    facts = json.loads((both / "combined.json").read_text())
    assert facts == json.loads(json.dumps(combined.facts)) and len(facts["runs"]) == 2
    Draft202012Validator(rf.schema("combined.json")).validate(facts)
    rows = (both / "route.csv").read_text().splitlines()
    assert len(rows) == 1 + len(combined.route) and rows[0].startswith("channel,distance,x,y,z,sigma_x")
    assert combined.judged.left_out.count(whole.corridor) == 2, "runs that looked at nothing they may lack"
    assert "Do the runs agree?" in combined.page() and combined.headline in repr(combined)
    opened = rf.open(both)
    opened.to_geojson(tmp_path / "route.geojson")
    assert (tmp_path / "route.geojson").read_text() == (both / "route.geojson").read_text()
    assert opened.facts == facts and opened.route.equals(combined.route)


def test_of_combined_runs_each_is_criticized(days, tmp_path) -> None:
    combined = days[2]
    for verb in (rf.compare, rf.diagnose, rf.add):
        with pytest.raises(InputError, match=r"2 runs with 4 passes.*give a run of one, such as each that was"):
            verb(combined)
    (tmp_path / "runs" / "1").mkdir(parents=True)
    (tmp_path / "combined.json").write_text("{}")
    with pytest.raises(InputError, match=r"one route of several runs.*give one of them: .*runs.1$"):
        open_street(tmp_path)
    (tmp_path / "combined.json").unlink()
    with pytest.raises(InputError, match="holds something else than combined runs"):
        combined.save(tmp_path)


def test_a_route_of_a_run_that_may_not_be_relied_on_is_drawn_dashed(days) -> None:
    _, (first, second), combined = days
    weak = replace(first, facts=first.facts | {"trust": {"grade": "weak", "sentence": "Do not rely on this route."}})
    drawn = [
        {line.get_linestyle() for line in one.plot().axes[0].lines if line.get_color() == ROUTE}
        for one in (combined, replace(combined, runs=[weak, second]))
    ]
    assert "-" in drawn[0] and drawn[1] == {"--"}


def test_on_the_page_names_are_text(days) -> None:
    _, _, combined = days
    page = replace(combined, agreement=tuple(replace(one, run=EVIL) for one in combined.agreement)).page()
    assert tells(page) and is_whole(page)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda run: replace(run, frame=LocalFrame((32.0, 34.9), 78.0)), "different frames"),
        (lambda run: replace(run, problem=replace(run.problem, channel_spacing=2.0)), "differ in channel spacing"),
        (lambda run: replace(run, result=replace(run.result, method="network")), "has no sigmas"),
    ],
)
def test_runs_that_do_not_belong_together_are_refused(days, change, words: str) -> None:
    _, (first, second), _ = days
    with pytest.raises(InputError, match=words):
        rf.combine(first, change(second))


def test_a_vehicle_counts_once(days) -> None:
    _, (first, second), _ = days
    with pytest.raises(InputError, match="hold the same vehicle at 2025-08-10T06:00"):
        rf.combine(first, second, replace(first))
    with pytest.raises(InputError, match="give two runs at least"):
        rf.combine(first)
