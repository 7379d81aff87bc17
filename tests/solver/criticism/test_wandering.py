"""Tracks that wander by more than they say of themselves: the fiber tells, and the fit allows for it."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from solver import simulator
from solver.criticism import wandering
from solver.criticism.quick_corridor import allowed_for, strict_scorer
from solver.criticism.wandering import LEAST, MOST, Wander, explains_best, wander_of
from solver.run.locate import locate
from solver.run.run import Run
from solver.simulator.scenario import Scenario
from solver.simulator.simulated_survey import Survey as Made
from solver.survey.survey import Survey
from solver.trajectory.trajectory_effects import SLOW_ERROR
from solver.trajectory.vehicle_pass import track_sigma


def bench_of(*evidence: float) -> Any:
    """Scores of effects with that evidence, best first."""
    return SimpleNamespace(table=[SimpleNamespace(evidence=one) for one in evidence], faults=[], scorer=None)


@pytest.mark.parametrize(
    ("size", "evidence", "best", "followed"),
    [
        (0.08, 20.0, 3.0, True),
        (0.08, 20.0, 30.0, False),  # another effect explains more
        (0.04, -0.4, 1.0, True),  # it may well be so, and nothing else shows
        (0.02, 20.0, 3.0, False),  # no more than the tracks say
        (0.25, 50.0, 3.0, False),  # to be told as an effect
    ],
)
def test_a_wander_is_allowed_for_where_nothing_else_explains_more(
    size: float, evidence: float, best: float, followed: bool
) -> None:
    assert explains_best(Wander(size, evidence), bench_of(best, 0.0)) is followed


def test_a_fault_of_the_survey_may_explain_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wandering, "fault_candidate", lambda fault, variance: SimpleNamespace(evidence=40.0))
    bench = SimpleNamespace(table=[], faults=["a vehicle"], scorer=SimpleNamespace(variance=1.0))
    assert not explains_best(Wander(0.08, 20.0), bench)  # type: ignore[arg-type]
    assert explains_best(Wander(0.08, 50.0), bench)  # type: ignore[arg-type]


def located(folder: Path, **camera: Any) -> tuple[Made, Run]:
    made = simulator.simulate(Scenario(seed=22, passes=6, snr_db=15.0, noise="street", **camera))
    return made, locate(Survey.read(simulator.write_survey(made, folder / "survey")))


def test_tracks_of_a_camera_that_wander_are_followed_and_the_route_is_better_for_it(tmp_path: Path) -> None:
    made, run = located(tmp_path, track_noise="camera", track_wander=0.1)
    found = wander_of(strict_scorer(run)[0])
    assert found is not None and found.evidence > 20
    assert 2 * track_sigma(run.problem.passes) < found.size < 0.15
    again = allowed_for(run, found)
    assert SLOW_ERROR in again.problem.effects and again.effects == run.effects
    assert [one for one in again.warnings if one.startswith("tracks wander by about")]
    assert wander_of(strict_scorer(again)[0]) is None

    def worst_depth(one: Run) -> float:
        here = one.result.constrained
        return float(np.abs(one.result.route[here, 2] - made.route[one.result.channel[here], 2]).max())

    assert worst_depth(again) < 0.5 * worst_depth(run)
    assert again.result.chi2_per_dof < run.result.chi2_per_dof


def test_tracks_without_slow_errors_are_taken_at_their_word(tmp_path: Path) -> None:
    _, run = located(tmp_path)
    found = wander_of(strict_scorer(run)[0])
    assert found is not None and found.size < LEAST < MOST
