"""What is kept of a model that grows: passes held out decide, and what was asked for is checked first."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism import growth
from solver.criticism.fault import Fault
from solver.criticism.growth import CHANCE, Grown, check_names, fitted_with, grow, held_out_before
from solver.criticism.repairs import SEARCHES, TAKEN_OUT
from vision.contract import InputError

CAMBER = built_in()["camber"]
SAMPLES = 2000


def held(chi2: float | None) -> Any:
    """Misfit of passes held out, per degree of freedom."""
    return None if chi2 is None else SimpleNamespace(chi2_per_dof=chi2)


def grown(before: float | None, after: float | None) -> Grown:
    """A fit of so many samples that passes held out judge so."""
    fit: Any = SimpleNamespace(measured=torch.ones(SAMPLES))
    return Grown(fit, SimpleNamespace(), before, held(after))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("before", "after", "better"),
    [
        (1.2, 1.1, True),
        (1.2, 1.2, False),
        (1.2, 1.3, False),
        # What chance may gain of chi2, over all samples, is no gain.
        (1.2, 1.2 - 0.9 * CHANCE / SAMPLES, False),
        (1.2, 1.2 - 1.1 * CHANCE / SAMPLES, True),
        # Where passes cannot be held out nothing speaks against it.
        (None, 1.3, True),
        (1.2, None, True),
        (None, None, True),
    ],
)
def test_passes_held_out_decide_beyond_chance(before, after, better):
    assert grown(before, after).better is better


def test_the_misfit_of_passes_held_out_in_words():
    assert grown(1.2345, 1.1).held_out_words == "1.234 to 1.100"
    assert grown(None, 1.1).held_out_words == "unknown to 1.100"
    assert grown(1.1, None).held_out_words == "1.100 to unknown"


@pytest.mark.parametrize("name", sorted(SEARCHES))
def test_faults_are_known_names_though_no_effects(name):
    problem: Any = SimpleNamespace(effects=())
    check_names([name, "camber"], problem, built_in())
    with pytest.raises(InputError, match=f"{name}: is in the model already"):
        check_names([name, name], problem, built_in())


def test_what_is_in_the_model_is_refused_before_anything_is_fitted(monkeypatch):
    monkeypatch.setattr(growth, "held_out", lambda *given, **more: pytest.fail("fitted"))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(effects=(CAMBER,)))
    with pytest.raises(InputError, match="camber: is in the model already; choose another effect"):
        grow(fit, SimpleNamespace(), "camber", built_in(), 1.4)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="not known"):
        grow(fit, SimpleNamespace(), "nosuch", built_in(), 1.4)  # type: ignore[arg-type]


def fault(name: str) -> Fault:
    return Fault(name, "load", 400.0, 4, 100, 1.0, 0.1, "1", 0.3, "words", lambda survey: survey)


class Judged:
    """Stands for all that is fitted: each fit is a name, and its misfit held out is looked up."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, found: Fault | None, **misfits: float) -> None:
        self.asked: list[str] = []
        self.misfits = misfits
        monkeypatch.setattr(growth, "held_out", self.held_out)
        monkeypatch.setattr(growth, "mended", lambda fit, state, fault: (self.fit("mended"), self.end("mended")))
        monkeypatch.setitem(SEARCHES, found.name if found else "faded_channels", lambda fit, state: found)  # type: ignore[misc]

    def held_out(self, problem: Any, advance: Any, at: Any) -> Any:
        self.asked.append(at[0].name)
        assert at[0].problem is problem and at[1] == f"{at[0].name} state"
        return held(self.misfits[at[0].name])

    def fit(self, name: str) -> Any:
        return SimpleNamespace(name=name, problem=SimpleNamespace(effects=(), of=name), measured=torch.ones(SAMPLES))

    def end(self, name: str) -> Any:
        return SimpleNamespace(state=f"{name} state")


def test_a_vehicle_more_is_judged_by_passes_held_out(monkeypatch):
    judged = Judged(monkeypatch, fault("unseen_vehicle"), mended=1.1)
    step = grow(judged.fit("start"), "start state", "unseen_vehicle", {}, 1.4)  # type: ignore[arg-type]
    assert judged.asked == ["mended"]
    assert step.better and step.held_out_words == "1.400 to 1.100"
    assert step.fit.problem.of == "mended"  # type: ignore[attr-defined]


@pytest.mark.parametrize("choice", [None, {"fitted": 12}])
def test_a_run_tells_its_own_misfit_held_out_unless_it_was_tested_on_other_passes(monkeypatch, choice):
    judged = Judged(monkeypatch, None, start=1.4)
    run: Any = SimpleNamespace(facts={"choice": choice, "held_out_chi2_per_dof": 1.2})
    found = held_out_before(run, judged.fit("start"), "start state")  # type: ignore[arg-type]
    assert (found, judged.asked) == ((1.2, []) if choice is None else (1.4, ["start"]))


@pytest.mark.parametrize("name", TAKEN_OUT)
def test_samples_taken_out_leave_nothing_to_compare(monkeypatch, name):
    """The misfit held out goes up here, and is of other samples."""
    judged = Judged(monkeypatch, fault(name), mended=1.3)
    step = grow(judged.fit("start"), "start state", name, {}, 1.0)  # type: ignore[arg-type]
    assert step.better and step.held_out_words == "unknown to 1.300"


def test_a_fault_that_is_not_there_is_not_mended(monkeypatch):
    judged = Judged(monkeypatch, None)
    with pytest.raises(InputError, match="faded_channels: nothing of the kind is in this survey's residual"):
        grow(judged.fit("start"), "start state", "faded_channels", {}, 1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("scores", [[], [SimpleNamespace(evidence=-1.0, freedom=0)]])
def test_an_effect_that_finds_nothing_to_act_on_is_refused(monkeypatch, scores):
    monkeypatch.setattr(growth, "Scorer", lambda fit, state: SimpleNamespace(scores=lambda effect: scores))
    monkeypatch.setattr(growth, "race", lambda *given: pytest.fail("fitted"))
    with pytest.raises(InputError, match="camber: does nothing in this survey; nothing to add"):
        fitted_with(SimpleNamespace(), SimpleNamespace(), CAMBER, lambda n: None)  # type: ignore[arg-type]


def test_the_best_of_its_shapes_is_fitted(monkeypatch):
    shapes = [SimpleNamespace(evidence=size, freedom=1) for size in (3.0, 9.0, -2.0)]
    monkeypatch.setattr(growth, "Scorer", lambda fit, state: SimpleNamespace(scores=lambda effect: shapes))
    monkeypatch.setattr(growth, "elsewhere", lambda scorer, effects: [("elsewhere", effects)])
    raced: list[Any] = []

    def race(scorer: Any, scores: Any, advance: Any, others: Any) -> Any:
        raced.extend([scores, others])
        return {"camber": growth.Refit(scores[0], "fit", SimpleNamespace(state="near"), 9.0, 0.0)}  # type: ignore[arg-type]

    monkeypatch.setattr(growth, "race", race)
    monkeypatch.setattr(growth, "solve", lambda fit, state: f"{fit}, on from {state}")
    found = fitted_with(SimpleNamespace(), SimpleNamespace(), CAMBER, lambda n: None)  # type: ignore[arg-type]
    assert raced == [[shapes[1]], [("elsewhere", [CAMBER])]]
    assert found.solution == "fit, on from near"
