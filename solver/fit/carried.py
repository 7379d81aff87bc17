"""Where a fit begins from the end of another: of other passes, other samples, or with other effects."""

from collections.abc import Iterator, Sequence

import torch

from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit, vehicles_of
from solver.fit.numbers import SINGLE
from solver.fit.state import State
from solver.signal_path.extension import Slot

#: A fit and where it ended.
End = tuple[Chain | MapFit, State]


def chained(fit: Chain | MapFit) -> Chain:
    """A fit as a chain."""
    return fit if isinstance(fit, Chain) else Chain.single(fit)


def carried(end: End, new: Chain | MapFit) -> State:
    """Route, ground and the numbers of effects where another fit ended; vehicles of their class, of the best amplitude.

    Numbers of single passes are carried over for passes of both fits; what is smooth along a pass only where the passes
    are the same. Other numbers begin at null.
    """
    state = end[1]
    numbers = carried_numbers(chained(end[0]), state, chained(new))
    return new.start_at(state.coefficients, state.poisson_ratio, numbers)


def carried_with_vehicles(end: End, new: Chain | MapFit) -> State:
    """The same with the vehicles as they were; all passes of the new fit are of the other one too."""
    old, state, chain = chained(end[0]), end[1], chained(new)
    known = {leg: number for number, leg in enumerate(legs(old))}
    vehicles = vehicles_of(state.vehicles, torch.tensor([known[leg] for leg in legs(chain)]))
    return State(state.coefficients, vehicles, state.poisson_ratio, carried_numbers(old, state, chain))


def carried_numbers(old: Chain, state: State, new: Chain) -> torch.Tensor:
    """Numbers of the effects in a new fit, as far as it has those of the old one; the others at null."""
    numbers = new.prior.numbers.mean.clone()
    before, after = legs(old), legs(new)
    known = {leg: number for number, leg in enumerate(before)}
    here = [number for number, leg in enumerate(after) if leg in known]
    there = [known[after[number]] for number in here]
    for slot, left, right in in_both(old, new):
        if (slot.parameter.scope not in SINGLE or before == after) and len(left) == len(right):
            numbers[right] = state.numbers[left]
        elif slot.parameter.scope == "pass":
            numbers[right[here]] = state.numbers[left][there]
    return numbers


def legs(chain: Chain) -> list[tuple[int, str, int]]:
    """What tells a vehicle in a stretch from all others: first channel, track, first row."""
    return [
        (int(link.fit.problem.channel[0]), one.track_id, int(one.rows[0]))
        for link in chain.links
        for one in link.fit.problem.passes
    ]


def in_both(old: Chain, new: Chain) -> Iterator[tuple[Slot, torch.Tensor, torch.Tensor]]:
    """Parameters of the effects that two chains share, and where the numbers of each hold them."""
    known = {(s.effect.name, s.parameter.name): at for s, at in zip(slots_of(old), old.slots, strict=True)}
    for slot, right in zip(slots_of(new), new.slots, strict=True):
        if (left := known.get((slot.effect.name, slot.parameter.name))) is not None:
            yield slot, left, right


def slots_of(chain: Chain) -> Sequence[Slot]:
    """Parameters of the effects in a chain."""
    return chain.links[0].fit.extension.slots
