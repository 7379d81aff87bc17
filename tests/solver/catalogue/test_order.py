"""Effects of one stage do the same together, whichever was added first."""

from dataclasses import replace
from itertools import combinations

import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.fit.map_fit import MapFit

LOADS = [one.name for one in built_in().values() if one.stage == "load"]
GROUNDS = ["poisson_ratio", "poisson_gradient", "stiffness_contrast", "layered_ground", "gibson_soil", "moving_load"]


def model(*names: str) -> torch.Tensor:
    """Map [sample, channel] with effects of half their plausible size, added in that order."""
    fit, state = trial_survey()
    with_them = MapFit(replace(fit.problem, effects=tuple(built_in()[name] for name in names)))
    numbers = with_them.extension.numbers()
    for slot in with_them.extension.slots:
        p = slot.parameter
        if not p.is_shape:
            numbers[slot.where] = min(p.null + p.plausible / 2, p.upper)
    return with_them.model(with_them.start_at(state.coefficients, state.poisson_ratio, numbers))


@pytest.mark.parametrize(("one", "other"), [*combinations(LOADS, 2), *combinations(GROUNDS, 2)])
def test_of_two_effects_either_may_be_added_first(one: str, other: str) -> None:
    first, last = model(one, other), model(other, one)
    torch.testing.assert_close(first, last, rtol=0, atol=1e-12 * float(first.abs().max()))


def test_a_law_of_the_ground_adds_to_another() -> None:
    """At null it leaves the other as it is; it does not bring the homogeneous ground back."""
    fit, state = trial_survey()
    with_both = MapFit(replace(fit.problem, effects=(built_in()["gibson_soil"], built_in()["layered_ground"])))
    numbers = with_both.extension.numbers({"gibson_soil": {"gradient": 0.5}})
    both = with_both.model(with_both.start_at(state.coefficients, state.poisson_ratio, numbers))
    torch.testing.assert_close(both, model("gibson_soil"), rtol=0, atol=1e-12 * float(both.abs().max()))
