"""The vector of all that is fitted: its parts, what a state packs into it, and priors and bounds laid out alike."""

from dataclasses import replace

import torch

from solver.catalogue.catalogue import built_in
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.numbers import Numbers
from solver.fit.parameter_layout import PER_PASS, Layout, of_route
from solver.fit.state import State
from solver.signal_path.traffic import Vehicles


def test_parts_tile_the_vector() -> None:
    layout = Layout(coefficients=5, passes=3, numbers=2)
    every = torch.cat([layout.where(name) for name in layout.parts])
    assert every.tolist() == list(range(layout.size)) and layout.size == 15 + 5 * 3 + 1 + 2
    assert list(layout.parts) == ["route", *PER_PASS, "poisson_ratio", "numbers"]
    assert layout.vehicles == slice(15, 30)


def test_a_part_of_the_route_is_whole_coefficients() -> None:
    numbered = torch.arange(15).reshape(5, 3)
    assert numbered.flatten()[of_route(2, 2)].tolist() == numbered[2:4].flatten().tolist()


def test_a_state_is_what_its_vector_says() -> None:
    layout = Layout(coefficients=4, passes=2, numbers=3)
    vector = torch.arange(layout.size, dtype=torch.float64)
    vector[layout["poisson_ratio"]] = 0.3
    track = torch.tensor([1.5, 1.9], dtype=torch.float64)
    zeros = torch.zeros(2, dtype=torch.float64)
    state = State.of(vector, layout, Vehicles(zeros, zeros, zeros, zeros, track, zeros))
    assert torch.equal(state.vector(), vector) and state.layout == layout
    assert state.coefficients[1].tolist() == [3.0, 4.0, 5.0]
    assert state.vehicles.across.tolist() == vector[layout["across"]].tolist()
    assert torch.equal(state.vehicles.track, track)
    assert torch.equal(state.moved(2 * vector).numbers, 2 * state.numbers)


def test_poisson_ratios_stay_below_a_half() -> None:
    layout = Layout(coefficients=4, passes=0, numbers=0)
    vector = torch.full((layout.size,), 0.7, dtype=torch.float64)
    assert float(State.of(vector, layout, Vehicles.of([])).poisson_ratio) == 0.495


def test_links_hold_the_chain_s_parameters_under_the_same_names(case, cut_short: None) -> None:
    """One number that all share, some of each vehicle, some along each stretch."""
    effects = tuple(built_in()[name] for name in ("clock_offset", "dynamic_load", "channel_coupling"))
    chain = Chain.of(replace(case.problem, effects=effects))
    assert chain.long
    name_of = {int(i): name for name in chain.layout.parts for i in chain.layout.where(name)}
    for link in chain.links:
        for name in link.fit.layout.parts:
            assert {name_of[int(i)] for i in link.where[link.fit.layout[name]]} <= {name}
        assert torch.equal(chain.mean[link.where], link.fit.mean) and torch.equal(chain.sd[link.where], link.fit.sd)
    owned = torch.cat([link.where[link.own] for link in chain.links])
    assert len(torch.unique(owned)) == len(owned)


def test_numbers_stay_within_the_bounds_of_their_parameters(case) -> None:
    effect = built_in()["viscoelastic_lag"]
    fit = MapFit(replace(case.problem, effects=(effect,)))
    far = replace(fit.start(), numbers=torch.full((len(fit.prior.numbers),), 1e6, dtype=torch.float64))
    for space in (fit, Chain.single(fit)):
        highest = space.bounded(far).numbers
        assert highest.tolist() == [min(p.upper, 1e6) for p in effect.parameters]
    lower, upper = fit.prior.bounds
    assert torch.isinf(lower[: fit.layout["numbers"].start]).all() and torch.isinf(upper[fit.layout["route"]]).all()
    assert upper[fit.layout["numbers"]].tolist() == [p.upper for p in effect.parameters]


def test_numbers_are_joined_in_order(case) -> None:
    extension = case.problem.extension([built_in()["viscoelastic_lag"], built_in()["clock_offset"]])
    every = Numbers.of(extension, case.problem.prior)
    assert torch.equal(every.mean, extension.numbers()) and len(every) == extension.size
    assert len(Numbers.joined([])) == 0


def test_numbers_are_kept_within_their_bounds(case) -> None:
    """Also those of which each vehicle has its own."""
    extension = case.problem.extension([built_in()["viscoelastic_lag"], built_in()["wheel_layout"]])
    numbers = Numbers.of(extension, case.problem.prior)
    far = torch.full((len(numbers),), -9.0, dtype=torch.float64)
    assert numbers.bounded(far)[:2].tolist() == [0.0, 0.01] and numbers.bounded(far)[2:].max() == 0
    assert numbers.bounded(-far * 100)[0] == 3.0
    assert numbers.single.tolist() == [False, False, *[True] * (len(numbers) - 2)]
