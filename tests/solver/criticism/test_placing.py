"""At which stage the unknown acts, on projections written out."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.criticism.placing import fixed_to_fiber, stage_of
from solver.criticism.policy import POLICY
from solver.criticism.score import Projected
from solver.criticism.sums import Sums
from solver.effect import Discrepancy

KNOWN = built_in()
LEVEL = SimpleNamespace(leveled=False)


def discrepancy(**said: Any) -> Any:
    """A discrepancy model of the ground that says this of itself."""
    return SimpleNamespace(stage="ground", name="one", discrepancy=Discrepancy(**said))


class Profiles:
    """A scorer in which each of some passes has a profile of so many numbers, which its record holds so much of.

    `held` [number, pass]: the size that the record has of each number, with unit information.
    """

    def __init__(self, held: np.ndarray, ways: list[int], across: tuple[float, ...] = (1.0,)) -> None:
        self.held = torch.from_numpy(held.astype(float))
        passes = [SimpleNamespace(velocity=np.array([[10.0 * way, 0.0]] * 3)) for way in ways]
        law = SimpleNamespace(across=np.array(across))
        problem = SimpleNamespace(passes=passes, law=law, extension=lambda effects: None)
        self.fit = SimpleNamespace(problem=problem, extension=SimpleNamespace(effects=()))
        self.parts = [1 / 4, 3 / 4]

    def columns(self, effect: Any, shape: Any, extension: Any, part: float) -> tuple[Any, list[int]]:
        numbers, passes = self.held.shape
        return self.held * part, [passes] * numbers

    def summed(self, columns: list[Any]) -> list[Sums]:
        score = columns[0].flatten()
        gram = torch.eye(len(score)).double() / len(self.parts)
        return [Sums(score, gram, gram[:0])]

    def left(self, sums: Sums) -> Projected:
        return Projected(sums.score, sums.gram, sums.gram)


WAYS = [1, -1, 1, -1]
#: Numbers before and behind, first half and second: the same for all who travel, or turned with those who come back.
WITH_TRAVEL = np.array([[3.0, 3.0, 3.0, 3.0], [-1.0, -1.0, -1.0, -1.0]])
WITH_FIBER = np.array([[3.0, -1.0, 3.0, -1.0], [-1.0, 3.0, -1.0, 3.0]])


@pytest.mark.parametrize(("held", "fixed"), [(WITH_TRAVEL, False), (WITH_FIBER, True)])
@pytest.mark.parametrize("first", [1, -1])
def test_what_turns_with_the_vehicles_is_not_fixed_to_the_fiber(held, fixed, first):
    """Whichever way the first pass goes."""
    scorer: Any = Profiles(held, [first * way for way in WAYS])
    assert fixed_to_fiber(KNOWN["generic_echo"], scorer) == fixed


def test_in_one_direction_the_two_are_the_same_and_nothing_is_said():
    scorer: Any = Profiles(WITH_FIBER, [1, 1, 1, 1])
    assert not fixed_to_fiber(KNOWN["generic_echo"], scorer)


@pytest.mark.parametrize("more", [0.99, 1.01])
def test_the_profile_along_the_fiber_must_explain_clearly_more(more):
    """Two numbers, two ways: along travel the sums are 1 and 1, along the fiber 1 + t and 1 - t, in all 1 + t^2."""
    t = np.sqrt(more * POLICY.fixed - 1)
    scorer: Any = Profiles(np.array([[0.0, 1.0], [-t, 1.0 + t]]), [1, -1])
    assert fixed_to_fiber(KNOWN["generic_echo"], scorer) == (more > 1)


@pytest.mark.parametrize(
    ("said", "across", "leveled", "stage"),
    [
        ({}, (1.0,), False, "ground"),
        ({"stage": "load"}, (1.0,), False, "load"),
        # Neighbors that share noise were mixed after the reading, where the model mixes them.
        ({"mixes": True}, (1.0, 2 * POLICY.negligible), False, "processing"),
        ({"mixes": True}, (1.0, -2 * POLICY.negligible), False, "processing"),
        ({"mixes": True}, (1.0, 0.5 * POLICY.negligible), False, "ground"),
        ({"mixes": True}, (1.0,), False, "ground"),
        ({}, (1.0, 2 * POLICY.negligible), False, "ground"),
        # A gain that follows the signal levels the noise too.
        ({"levels": True}, (1.0,), True, "processing"),
        ({"levels": True}, (1.0,), False, "ground"),
        ({}, (1.0,), True, "ground"),
        ({"before_and_behind": True}, (1.0,), False, "interrogator"),
    ],
)
def test_the_noise_tells_what_came_after_the_reading(said, across, leveled, stage):
    scorer: Any = Profiles(WITH_FIBER, WAYS, across)
    check: Any = SimpleNamespace(leveled=leveled)
    assert stage_of(discrepancy(**said), scorer, check) == stage


def test_what_goes_with_the_vehicles_stays_at_the_models_own_stage():
    scorer: Any = Profiles(WITH_TRAVEL, WAYS)
    check: Any = LEVEL
    assert stage_of(discrepancy(before_and_behind=True), scorer, check) == "ground"
    assert stage_of(KNOWN["saturation"], scorer, check) == "interrogator", "no discrepancy model: its stage"
