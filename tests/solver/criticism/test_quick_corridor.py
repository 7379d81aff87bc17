"""The corridor that `locate` ends with: when it takes the model for granted, what it fits, what it says."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.criticism import corridor, quick_corridor
from solver.criticism.corridor import Corridor
from solver.criticism.disagreement import Disagreement
from solver.criticism.explanations import Posterior, Weighed
from solver.criticism.quick_corridor import FITTED, far_moving, told, widened
from solver.run.report.report_page import render
from solver.run.run import Run, run_of


@pytest.fixture
def run(survey) -> Run:
    return run_of(survey.result, **survey.arguments)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"method": "network"}, "what it may lack is not looked for with --method network"),
        ({"converged": False}, "the fit has not converged, so what it may lack cannot be told"),
    ],
)
def test_a_fit_that_cannot_be_criticized_keeps_its_own_corridor_and_says_why(run, changes, why):
    found = widened(replace(run, result=replace(run.result, **({"method": "spline", "converged": True} | changes))))
    assert found.added is None and found.facts["corridor"]["why"] == why
    assert found.corridor.endswith(f"{why}." if found.result.converged else "")
    assert bool(found.corridor) == found.result.converged


@pytest.mark.parametrize("factor", [0.8, 5.0])
def test_where_noise_is_not_understood_the_corridor_is_as_wide_as_vehicles_disagree(run, monkeypatch, factor):
    channel = run.problem.channel
    check, own = SimpleNamespace(passed=False, faults=("too little quiet",)), np.diag([0.04, 0.01, 0.01])
    left = Disagreement(factor, np.tile(own, (len(channel), 1, 1)))
    scorer = SimpleNamespace(fit=SimpleNamespace(problem=run.problem), state=None)
    monkeypatch.setattr(quick_corridor, "strict_scorer", lambda run: (scorer, check))
    monkeypatch.setattr(Disagreement, "of", lambda scorer: left)
    monkeypatch.setattr(corridor, "route_of", lambda fit, state: run.problem.start)
    found = widened(replace(run, result=replace(run.result, method="spline", converged=True)))
    assert found.added is not None
    np.testing.assert_allclose(found.added[5], max(factor - 1, 0) * own)
    told = "Effects cannot be weighed, as the noise is not understood: too little quiet."
    assert found.corridor.endswith(told) and "with what vehicles disagree about, " in found.corridor
    assert found.facts["corridor"]["widest"] == ("disagreement" if factor > 1 else "")
    page = render(found)
    assert "The corridor is as wide as vehicles disagree about the route." in page and told in page


def bench_of(evidences: dict[str, float]) -> Any:
    """Scores of effects with that evidence, best first."""
    table = [SimpleNamespace(effect=SimpleNamespace(name=name), evidence=one) for name, one in evidences.items()]
    return SimpleNamespace(table=table, faults=[], scorer=SimpleNamespace(variance=1.0))


def test_what_shows_most_and_moves_the_route_by_more_than_its_sigma_is_fitted(monkeypatch):
    ways = {"near": 0.01, "far": 0.3, "farther": 0.9, "again": 0.9, "weak": 0.9}
    monkeypatch.setattr(quick_corridor, "moves", lambda bench, name, tried: np.full((2, 3), ways[name]))
    bench = bench_of({"near": 100.0, "far": 99.0, "farther": 98.0, "again": 97.0, "weak": 5.0})
    found = far_moving(bench, np.full((2, 3), 0.1))
    assert [one.effect.name for one in found] == ["far", "farther"] and len(found) == FITTED
    assert not far_moving(bench_of({"weak": 5.0}), np.full((2, 3), 0.1))


@pytest.mark.parametrize(
    ("probability", "narrower"),
    [
        (0.9, "adding it to the model, if `roadfiber diagnose RUN` names it too,"),
        (
            0.1,
            "a survey with passes from 30 to 70 km/h, a second lane farther away, and two classes of vehicle",
        ),
    ],
)
def test_a_run_says_what_widens_its_corridor_and_what_would_narrow_it(run, probability, narrower):
    channel = run.result.channel
    added = np.tile(np.diag([0.0, 1.0, 0.0]), (len(channel), 1, 1))
    wide = Corridor(channel, added, np.zeros((len(channel), 2, 3)), "shear_lag", 0.7)
    weighed = [Weighed("effect", ("shear_lag",), "cable", probability), Weighed("nothing", (), "", 1 - probability)]
    found = told(run, wide, Posterior(tuple(weighed)), list(run.known.values()))
    title = run.known["shear_lag"].title
    assert found.corridor.endswith(
        f"is widened most by {title.lower()} (70 % of what is added); {narrower} would narrow it."
    )
    said = [(one["title"], one["probability"]) for one in found.facts["corridor"]["explanations"]]
    assert said == [(title, probability), ("Nothing that would show", 1 - probability)]
