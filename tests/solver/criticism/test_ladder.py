"""What is said of a rung before its numbers, and what a story leaves open."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver.catalogue.catalogue import built_in
from solver.criticism import judging
from solver.criticism.audit import NoiseAudit
from solver.criticism.candidate import idle_candidate
from solver.criticism.finding import Diagnosis
from solver.criticism.pages import Chapter, story_page
from solver.criticism.refit import Refit
from solver.criticism.verdict_words import left_open
from solver.fit.chain import Chain
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior, assemble
from solver.run.ladder import climbed, first_rung
from solver.run.ladder_file import read_ladder, write_ladder
from solver.run.report.ladder_page import ladder_page
from solver.run.run import Run


@pytest.fixture
def run(survey):
    """A run whose passes held out leave too much or not, with effects, its route aside by so much, m."""

    def made(*effects: str, aside: float = 0.0, failed: bool = False) -> Run:
        result = replace(survey.result, route=survey.result.route + np.array([0.0, aside, 0.0]))
        problem = replace(survey.problem, effects=tuple(built_in()[name] for name in effects))
        gate = {"name": "held-out passes", "verdict": "failed" if failed else "passed", "words": "1.490 on passes"}
        facts = {
            "effects": list(effects),
            "held_out_chi2_per_dof": 1.49,
            "noise_floor": 1.0,
            "trust": {"gates": [gate]},
        }
        return Run(result, survey.site.frame, survey.record.start, np.zeros(1), [], [], facts, problem=problem)

    return made


def said(before: Run, after: Run) -> tuple[str, ...]:
    """What must be said first of the run that grew out of another."""
    return climbed(before, after)[-1].words


def generic() -> str:
    return next(name for name, one in built_in().items() if one.generic)


def test_a_rung_that_leaves_too_much_and_moves_the_route_says_so_first(run) -> None:
    """One was kept beside hidden braking: held out 1.60 to 1.49, while the route went from .18 to .80 m off."""
    before = run()
    (line,) = said(before, run("gauge_length", aside=0.62, failed=True))
    assert "1.490 on passes" in line and "moved by 0.62 m, 12.4 of its sigmas" in line and "no better founded" in line
    assert said(before, run("gauge_length", aside=0.04, failed=True)) == ()
    assert said(before, run("gauge_length", aside=0.62)) == ()


def test_a_discrepancy_model_is_never_called_a_better_route(run) -> None:
    before, name = run(), generic()
    (line,) = said(before, run(name))
    assert line.startswith(f"{name} is a discrepancy model: it names no cause")
    # It is said of the rung that brought it.
    assert said(run(name), run(name, "gauge_length")) == ()


def test_what_is_said_of_a_rung_is_kept_and_comes_before_its_numbers(run, tmp_path: Path) -> None:
    before = run()
    rungs = climbed(before, run(generic()))
    write_ladder(tmp_path, rungs, "Elm <Street>")
    assert read_ladder(tmp_path) == [rungs[0], replace(rungs[1], folder=tmp_path)]
    assert json.loads((tmp_path / "ladder.json").read_text())["rungs"][1]["words"] == list(rungs[1].words)
    page = ladder_page(rungs, "Elm <Street>")
    assert page.index("names no cause") < page.index("<svg")


def test_how_far_a_route_moved_of_which_both_decide_no_place_is_unknown(run) -> None:
    before = run()
    nowhere = replace(before, result=replace(before.result, constrained=np.zeros_like(before.result.constrained)))
    rungs = climbed(before, nowhere)
    page = ladder_page(rungs, "elm")
    assert "how far the route moved is not known: no place is decided in both" in page and ">nan" not in page
    assert rungs[1].moved == "unknown"


def test_a_story_ends_with_what_could_not_be_told_apart(run) -> None:
    gauge = replace(idle_candidate(built_in()["gauge_length"]), confounded_with=("pulse_width", "shear_lag"))
    alone = idle_candidate(built_in()["camber"])
    words = left_open([gauge, alone])
    assert words.startswith("Still open: this survey cannot tell gauge length from pulse width, soft jacket.")
    assert left_open([alone]) == ""
    audit = NoiseAudit(900, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, ())
    added = Chapter(
        Diagnosis("missing-effect", "gauge_length is missing", (gauge,), audit, 0.0), "Added to the model.", added=True
    )
    last = Chapter(Diagnosis("adequate", "nothing is missing", (alone,), audit, 0.0), "Nothing more was added.")
    page = story_page([added, last], [first_rung(run())], "Elm <Street>")
    assert page.rindex(words) > page.index("Nothing more was added.")
    assert "<h1>What the model lacked: gauge_length</h1>" in page and "`" not in page


def test_an_effect_has_one_sigma_and_one_held_out_misfit(case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gauge's sigma was .0021 in its diagnosis and .0003 in the run to which it was added.

    While effects are ranked noise may count as growing with the signal, which is how a missing effect looks.
    """
    gauge = built_in()["gauge_length"]
    problem = replace(case.problem, effects=(gauge,))
    fit = MapFit(problem)
    end = solve(fit, fit.start(), iterations=60)
    told = assemble(problem, fit, end.state, method="spline", iterations=1, seconds=0.0, converged=True)
    ranked = MapFit(replace(problem, signal_noise=0.02))
    score: Any = SimpleNamespace(effect=gauge)
    refit = Refit(score, ranked, replace(end, at=Chain.single(ranked).visit(end.state)), 100.0, 0.0)
    assert refit.sigma[0] == pytest.approx(told.parameters["gauge_length.relative"].sigma, rel=1e-6)
    stopped = replace(refit, solution=replace(refit.solution, converged=False))
    chain = Chain.single(ranked)
    known = Posterior(chain, refit.solution.at).sigmas()[chain.layout["numbers"]]
    np.testing.assert_allclose(stopped.sigma, known)
    assert stopped.sigma[0] > refit.sigma[0]
    judged: list[float] = []
    monkeypatch.setattr(
        judging, "held_out_gain", lambda *ends: judged.extend(one[0].problem.signal_noise for one in ends)
    )
    scorer: Any = SimpleNamespace(fit=ranked, state=end.state)
    judging.gain_of(scorer, refit)
    assert judged == [0.0, 0.0]
