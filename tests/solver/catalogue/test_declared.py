"""What the house does with an effect hangs on what the effect declares: not on its name, nor on who wrote it."""

import ast
import inspect
import sys
from collections import Counter
from dataclasses import fields, replace
from functools import cache, partial
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

import solver
from solver.cable.fiber import Coil
from solver.catalogue.catalogue import built_in, family
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.bench import scorable
from solver.criticism.placing import stage_of
from solver.criticism.race import started_elsewhere
from solver.criticism.scorer import Scorer
from solver.effect import Effect, Parameter, effect
from solver.fit.map_fit import MapFit
from solver.fit.pose import with_slow_errors
from solver.signal_path.traffic import Vehicles
from solver.survey import site

ROOT = Path(solver.__file__).parents[1]


@cache
def names() -> set[str]:
    """Names of effects that are not those of what a survey states, or of what a fit finds of vehicles, too."""
    sections = (one for _, one in inspect.getmembers(site, inspect.isclass) if issubclass(one, site.Section))
    stated = {name for section in sections for name in section.model_fields}
    return set(built_in()) - stated - {f.name for f in fields(Vehicles)}


@cache
def functions() -> dict[str, set[str]]:
    """Module -> names of the effects that it defines."""
    found: dict[str, set[str]] = {}
    for one in built_in().values():
        found.setdefault(one.change.__module__, set()).add(one.change.__name__)
    return found


def named(path: Path) -> set[str]:
    """Names of effects in a module's strings, alone or in a list with commas, and among what it imports."""
    text = path.read_text(encoding="utf-8")
    if not any(name in text for name in built_in()):
        return set()
    tree = ast.parse(text)
    told, found = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}, set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            told |= {id(name) for name in ast.walk(node.value)}
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            found |= {part.strip() for part in node.value.split(",")} & names()
        if isinstance(node, ast.ImportFrom):
            found |= {alias.name for alias in node.names} & functions().get(node.module or "", set())
    return found


def test_no_effect_is_named_outside_its_own_module_and_the_catalogue() -> None:
    """The simulator hides effects of its own, of which it has a list: it shares nothing with the solver."""
    own = {ROOT.joinpath(*module.split(".")).with_suffix(".py") for module in functions()}
    rooms = {ROOT / "solver" / room for room in ("catalogue", "simulator")}
    paths = {*(ROOT / "solver").rglob("*.py"), *(ROOT / "roadfiber").rglob("*.py")} - own
    assert len(paths) > 100
    assert {str(path): found for path in paths if path.parent not in rooms and (found := named(path))} == {}


def test_the_scan_sees_names(tmp_path: Path) -> None:
    path = tmp_path / "naming.py"
    path.write_text(
        '"""camber"""\nfrom solver.load.load_effects import braking, share_in_front\n'
        'from solver.trajectory.trajectory_effects import SLOW_ERROR\n__all__ = ["fk_filter"]\n'
        'EVERY = "shear_lag, pulse_width"\nRATIO = settings["poisson_ratio"]\n'
    )
    assert named(path) == {"braking", "shear_lag", "pulse_width"}


def mine(name: str) -> Effect:
    """A user's own effect, equal to a built-in one but for its name."""
    one = built_in()[name]

    def change(stage: Any, values: Any, survey: Any) -> Any:
        return one.change(stage, values, survey)

    return replace(one, name="mine", change=change)


def both(name: str) -> tuple[Effect, Effect]:
    """A built-in effect and a user's own that is equal to it."""
    return built_in()[name], mine(name)


def calls(run: Any) -> tuple[Any, Counter[str]]:
    """What a function gives, and how often functions of the solver, and derivatives of PyTorch, were called for it."""
    seen: Counter[str] = Counter()

    def note(frame: FrameType, event: str, what: Any) -> None:
        if event == "call":
            code = frame.f_code
            if code.co_filename.startswith(str(ROOT / "solver")) or code.co_name in ("grad", "jvp", "backward"):
                seen[f"{code.co_filename}: {code.co_qualname}"] += 1

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        return run(), seen
    finally:
        sys.setprofile(before)


PATHS = ["track_jitter", "clock_offset", "camber", "shear_lag", "poisson_ratio"]


@pytest.mark.parametrize("name", PATHS)
def test_a_user_s_effect_is_computed_as_an_equal_one_that_is_built_in(name: str) -> None:
    """The same values by the same steps, so at the same cost."""
    fit, state = trial_survey()
    one, users_own = both(name)
    # What is compiled or tabulated on its first call is not called again: that call does not count.
    fits = [MapFit(replace(fit.problem, effects=(each,))) for each in (one, one, users_own)]
    at = replace(state, numbers=fits[0].extension.numbers())
    fits[0].linearized(at)
    (built, steps), (users, user_steps) = (calls(partial(each.linearized, at)) for each in fits[1:])
    for mine, theirs in zip(users.jacobian.parts, built.jacobian.parts, strict=True):
        torch.testing.assert_close(mine.values, theirs.values, rtol=0, atol=0)
    assert user_steps == steps


@pytest.fixture(scope="module")
def scorer() -> Scorer:
    """Of the trial survey, where the matched filter saw a coil."""
    fit, state = trial_survey()
    return Scorer(MapFit(replace(fit.problem, coil=Coil(30.0, 8.0, -34.5, 1.0, 4.0, 0.9))), state)


@pytest.mark.parametrize("name", [name for name, one in built_in().items() if one.starts is not None])
def test_a_user_s_effect_starts_where_an_equal_one_does(scorer: Scorer, name: str) -> None:
    own, like = (started_elsewhere(scorer, [one]) for one in both(name))
    assert own
    for (built, score), (users, user_score) in zip(own, like, strict=True):
        torch.testing.assert_close(users.state.vector(), built.state.vector(), rtol=0, atol=0)
        assert user_score.shape == score.shape
        assert np.abs(score.estimate).max() > 0
        np.testing.assert_array_equal(user_score.estimate, score.estimate)


def test_an_effect_without_a_start_of_its_own_begins_where_the_fit_ended(scorer: Scorer) -> None:
    assert started_elsewhere(scorer, [built_in()["camber"]]) == []


def test_a_discrepancy_model_of_the_user_s_is_placed_as_an_equal_one(scorer: Scorer) -> None:
    check: Any = SimpleNamespace(leveled=True)
    problem = replace(scorer.fit.problem, law=replace(scorer.fit.problem.law, across=np.array([1.0, 0.4])))
    mixed: Any = SimpleNamespace(fit=SimpleNamespace(problem=problem))
    alike = [name for name, one in built_in().items() if one.discrepancy and not one.discrepancy.before_and_behind]
    stages = {name: [stage_of(one, mixed, check) for one in both(name)] for name in alike}
    assert all(built == users for built, users in stages.values())
    chosen = ("generic_echo", "generic_gain", "generic_twin", "generic_wake")
    assert [stages[name][0] for name in chosen] == ["processing", "processing", "cable", "ground"]


@pytest.mark.parametrize(("name", "part"), [("wheel_layout", "wheels"), ("curved_gauge", "bends")])
def test_what_the_base_model_has_is_not_missing(name: str, part: str) -> None:
    problem = trial_survey()[0].problem
    known = replace(problem, passes=problem.passes[1:], curved=True)
    for one in both(name):
        assert scorable(replace(problem, curved=False), [one]) == [one]
        assert scorable(known, [one]) == []
    assert part in known.base_parts and part not in problem.base_parts


def test_tracks_are_given_one_slow_error_whoever_wrote_it() -> None:
    problem = replace(trial_survey()[0].problem, effects=(mine("track_jitter"),))
    assert with_slow_errors(problem) is problem
    assert [one.slow_error for one in with_slow_errors(replace(problem, effects=())).effects] == [True]


def test_a_user_s_effect_joins_the_family_it_declares() -> None:
    assert family("depth", [*built_in().values(), mine("camber")]) == ("camber", "poisson_ratio", "mine")


def restating(stage: Any, values: Any, survey: Any) -> Any:
    """`shear_lag`, which says besides what the base model says anyway, in numbers of its own."""
    again = replace(stage, slack=float("0"), gain=float("1"), vertical=float("1"), path_integral=float("0"))
    return built_in()["shear_lag"].change(again, values, survey)


def test_a_number_that_the_base_model_has_too_changes_no_step() -> None:
    fit, state = trial_survey()
    lag = built_in()["shear_lag"]
    fits = [MapFit(replace(fit.problem, effects=(each,))) for each in (lag, lag, replace(lag, change=restating))]
    at = replace(state, numbers=fits[0].extension.numbers())
    fits[0].linearized(at)
    (_, steps), (_, user_steps) = (calls(partial(each.linearized, at)) for each in fits[1:])
    assert user_steps == steps


@pytest.mark.parametrize(
    ("declared", "words"),
    [
        ({"families": ("fog",)}, "family 'fog' is none of blur, lag"),
        ({"base_part": "fog"}, "'fog' is none of wheels"),
        ({"corrects": "fog"}, "'fog' is none of gauge"),
    ],
)
def test_a_declaration_that_means_nothing_is_refused(declared: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        effect("mine", "load", [Parameter("share", "1", 0.1)], physics="-", source="-", **declared)
