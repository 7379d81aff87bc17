"""What a fit takes over from where another ended."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.fit.carried import carried, carried_with_vehicles, in_both
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.state import State
from solver.fit.stretches import part


@pytest.fixture
def end() -> tuple[MapFit, State]:
    """A fit with a gauge length for all passes and a bounce of each, at a state whose numbers all differ."""
    bare, _ = trial_survey()
    effects = tuple(built_in()[name] for name in ("gauge_length", "dynamic_load"))
    fit = MapFit(replace(bare.problem, effects=effects))
    return fit, fit.state_of(torch.linspace(1, 2, len(fit.mean), dtype=torch.float64))


def numbers(fit: MapFit, state: State) -> dict[str, list[float]]:
    return {slot.parameter.name: state.numbers[slot.where].tolist() for slot in fit.extension.slots}


def test_the_same_passes_take_over_all(end: tuple[MapFit, State]) -> None:
    np.testing.assert_array_equal(carried_with_vehicles(end, end[0]).vector(), end[1].vector())
    np.testing.assert_array_equal(carried(end, end[0]).numbers, end[1].numbers)


def test_some_passes_take_over_their_own(end: tuple[MapFit, State]) -> None:
    fit, state = end
    chosen = np.array([len(fit.problem.passes) - 1, 0])
    some = MapFit(part(fit.problem, chosen))
    taken = carried_with_vehicles(end, some)
    np.testing.assert_array_equal(taken.coefficients, state.coefficients)
    np.testing.assert_array_equal(taken.vehicles.along, state.vehicles.along[chosen])
    before, after = numbers(fit, state), numbers(some, taken)
    assert after["relative"] == before["relative"]
    assert after["sine"] == [before["sine"][one] for one in chosen]


def test_other_passes_and_effects_begin_at_null(end: tuple[MapFit, State]) -> None:
    """Route, ground and what is common to all are taken over; vehicles get the amplitudes that fit best."""
    fit, state = end
    first = MapFit(part(fit.problem, np.array([0])))
    start = carried((first, first.state_of(torch.linspace(1, 2, len(first.mean), dtype=torch.float64))), fit)
    after = numbers(fit, start)
    assert after["sine"][0] != 0
    assert after["sine"][1:] == [0.0] * (len(fit.problem.passes) - 1)
    assert after["relative"] != [0.0]
    np.testing.assert_array_equal(start.vehicles.along, 0 * state.vehicles.along)
    plain = MapFit(replace(fit.problem, effects=(built_in()["gauge_length"],)))
    assert [slot.effect.name for slot, _, _ in in_both(Chain.single(fit), Chain.single(plain))] == ["gauge_length"]
    assert numbers(plain, carried(end, plain)) == {"relative": numbers(fit, state)["relative"]}
