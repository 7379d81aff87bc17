"""What a run says of the passes that were chosen for it."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from solver import simulator
from solver.fit.choice import Choice, Taken, choose
from solver.run.chosen import choice_facts, choice_line
from solver.run.folder import read_run
from solver.run.locate import locate
from solver.run.report.report_page import render
from solver.survey.survey import Survey


def test_of_many_passes_a_few_are_fitted_and_told(
    street: simulator.Survey, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("solver.run.passes_fit.MANY", 3)
    monkeypatch.setattr("solver.run.passes_fit.choose", partial(choose, fewest=3, most=3))
    survey = Survey.read(simulator.write_survey(street, tmp_path / "survey"))
    run = locate(survey)
    choice = run.facts["choice"]
    assert choice["of"] == 4 and choice["tested"] == 1 and len(choice["taken"]) == 3
    assert {one["track_id"] for one in choice["taken"]} == {one.track_id for one in run.passes}
    assert len(run.problem.passes) == 3 and run.facts["held_out_chi2_per_dof"] is not None
    line = next(one for one in run.warnings if one.lower().startswith("of 4 passes"))
    assert "the 3 that tell most" in line and "--all-passes" in line
    assert "Passes fitted: 3 of 4" in render(run)
    run.save(tmp_path / "run")
    assert read_run(tmp_path / "run").facts["choice"] == choice
    fitted = []
    monkeypatch.setattr("solver.run.locate.require_room_to_fit", lambda problem: fitted.append(problem) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        locate(survey, all_passes=True)
    assert len(fitted[0].passes) == 4


def test_nothing_is_missing_where_nothing_would_tell_more(survey) -> None:
    passes = survey.problem.passes
    choice = Choice(
        passes, [Taken(0, np.array([0.5, 0.2]))], ["route", "depth"], [("toward +x", np.array([0.01, 0.0]))]
    )
    facts = choice_facts(choice, 2)
    assert facts["taken"][0]["narrower"] == {"route": 0.2212, "depth": 0.0952}
    assert choice_line(facts).endswith("no kind of pass that is missing would tell much more")
    none = choice_line(choice_facts(replace(choice, missing=[]), 2))
    assert none.endswith("--all-passes fits all")
