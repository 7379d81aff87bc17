"""Derivatives of the strain-rate map with respect to an effect's parameters: the chain rule through loads and gauges.

The effect of a parameter on loads or gauges is differentiated automatically, for these are few numbers; the derivatives
of strain rate with respect to them come from `solver.signal_path.sensitivities`. Laws of the ground are evaluated at
every gauge and wheel, and differentiated from values nearby.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import torch
from torch import Tensor
from torch.func import jvp

from solver.effect import BY_ROW, Parameter
from solver.signal_path.autodiff import pushed_all, pushed_ways
from solver.signal_path.extension import Extension, Slot, Values
from solver.signal_path.few import few_of
from solver.signal_path.gauges import Gauges
from solver.signal_path.local import ALIKE, EACH, LOOSE, Section, Seen, number
from solver.signal_path.map_changes import Changed, acts_on_map, by_channel, moving
from solver.signal_path.observation import Description
from solver.signal_path.sensitivities import along_load
from solver.signal_path.traffic import columns

#: Columns that are filtered together.
COLUMNS = 16
#: Share of a parameter's plausible size by which it is changed to see how a law of the ground changes.
STEP = 1e-7


def observed_tangents(
    stages: Description, alone: Tensor, tangents: Tensor, observed: Callable[[Tensor], Tensor]
) -> Tensor:
    """Small changes [column, sample, computed channel] of a map, as interrogator and processing pass them on.

    Parameters
    ----------
    stages : of the model
    alone : the map [sample, computed channel]
    observed : what the stages make of maps
    """
    plain = not stages.nonlinear and not stages.processing.steps

    def seen(some: Tensor) -> Tensor:
        if plain:
            return observed(some)
        return jvp(observed, (alone.expand_as(some).clone(),), (some.contiguous(),))[1]

    # Spectra of all columns at once would not fit into memory.
    found = [seen(some) for some in tangents.split(COLUMNS)]
    return torch.cat(found) if len(found) > 1 else found[0]


def derivative(seen: Seen, slot: Slot, numbers: Tensor) -> Tensor:
    """Derivative of the observed map with respect to the numbers of one parameter, [number, sample, channel]."""
    return torch.cat(list(derivatives(seen, slot, numbers)))


def derivatives(seen: Seen, slot: Slot, numbers: Tensor) -> Iterator[Tensor]:
    """The same, a few numbers at a time.

    A row depends only on the parameter's value at that row, so a single tangent, 1 everywhere, holds the derivatives
    with respect to all numbers.
    """
    path, extension, section = seen.path, seen.path.extension, seen.local.section
    values: Values = extension.local(numbers)
    if section is not None:
        values = extension.within(values, section.samples)
    effect, p, scope = slot.effect, slot.parameter, slot.spread

    def change(value: Tensor) -> Values:
        return {**values, effect.name: {**values[effect.name], p.name: value}}

    def observed(maps: Tensor) -> Tensor:
        return path.described(values).observed(maps, seen.samples)

    assert extension.scopes is not None
    here, alone = values[effect.name][p.name], seen.local.alone
    weights = torch.ones(here.numel(), 1).double() if scope == "one" else extension.scopes.along(scope)
    if section is not None and scope == "time":
        weights = weights[section.samples]
    in_rows = acts_on_rows(seen, slot, values)
    by_gauge = in_rows and effect.stage in ("cable", "interrogator")
    by_row = tangents(seen, slot, values, numbers) if in_rows and not by_gauge else []
    on_map = acts_on_map(seen, slot, values)
    moved = moving(seen, slot, change, here) if on_map else None
    each = by_channel(moved, here, extension.chosen) if moved is not None and scope == "fiber" else None
    for some in torch.arange(weights.shape[1]).split(few_of(alone.numel())):
        ways = [way.reshape(here.shape) for way in weights[:, some].unbind(1)]
        parts = []
        if in_rows:
            columns = by_gauges(seen, change, here, ways) if by_gauge else spread(seen, slot, by_row, some)
            parts.append(observed_tangents(path.described(values), alone, columns, observed))
        if each is not None:
            chosen = slice(None) if extension.chosen is None else extension.chosen
            parts.append(each * weights[chosen][:, some].T[:, None])
        elif moved is not None:
            parts.append(torch.stack([moved(way) for way in ways]))
        yield sum(parts[1:], parts[0])


def tangents(seen: Seen, slot: Slot, values: Values, numbers: Tensor) -> list[Tensor]:
    """Derivatives [row, channel] with respect to a parameter of loads or ground at its row, and to its rate."""
    p, name = slot.parameter, slot.effect.name

    def along(which: str) -> Tensor:
        def changed(value: Tensor) -> Values:
            return {**values, name: {**values[name], which: value}}

        return by_rows(seen, slot, changed, values[name][which], numbers)

    rated = p.rated and p.scope not in ("one", "fiber")
    return [along(p.name), *([along(p.rate_name)] if rated else [])]


def spread(seen: Seen, slot: Slot, by_row: Sequence[Tensor], some: Tensor) -> Tensor:
    """Derivatives [some, sample, channel] with respect to some of a parameter's numbers, from those of `tangents`."""
    local, scopes, scope = seen.local, seen.path.extension.scopes, slot.spread
    assert scopes is not None
    if scope in ("one", "fiber"):
        whole = local.superposed(by_row[0])[None]
        return whole if scope == "one" else whole * scopes.fiber.T[some, None, :]
    matrices = [scopes.rows[scope], *([scopes.rates[scope]] if len(by_row) > 1 else [])]
    out, at, begin = torch.zeros(len(some), *local.alone.shape, dtype=torch.float64), local.path.traffic.sample_index, 0
    if local.section is not None:
        matrices, begin = [one[local.section.rows] for one in matrices], local.section.samples.start
        at = at[local.section.rows]
    for rows, matrix in zip(by_row, matrices, strict=True):
        for one, share in zip(out, matrix[:, some].unbind(1), strict=True):
            acts = share.nonzero()[:, 0]
            one.index_add_(0, at[acts] - begin, rows[acts] * share[acts, None])
    return out


def by_rows(seen: Seen, slot: Slot, changed: Changed, here: Tensor, numbers: Tensor) -> Tensor:
    """Derivative [row, channel] with respect to a parameter of loads or of the ground."""
    if slot.effect.stage == "ground":
        return by_ground(seen, slot, changed, here, numbers)
    path, local, vehicles = seen.path, seen.local, columns(seen.local.vehicles)
    load = path.loads(vehicles, changed(here))
    by = local.by_load(load if local.section is None else load.with_tensors(local.at_rows(load.tensors)))

    def loads(value: Tensor) -> tuple[Tensor, ...]:
        tensors = path.loads(vehicles, changed(value)).tensors
        return tuple(tensors[name] for name in by)

    # Of all rows: few numbers each, and an effect may ask for what a vehicle does at others.
    moved = dict(zip(by, pushed_all(loads, here, torch.ones_like(here)), strict=True))
    return local.amplitude * along_load(by, local.at_rows(moved))


def by_gauges(seen: Seen, changed: Changed, here: Tensor, ways: Sequence[Tensor]) -> Tensor:
    """Derivatives [way, sample, channel] in directions of a parameter of the cable or of the gauge length."""
    stages = seen.path.described(changed(here))
    names = [*EACH, *ALIKE, *(() if stages.cable.loose is None else LOOSE), "gauge_length"]

    def told(value: Tensor) -> tuple[Tensor, ...]:
        new = seen.path.described(changed(value))
        return tuple(torch.as_tensor(number(new, name), dtype=torch.float64) for name in names)

    each = [dict(zip(names, moved, strict=True)) for moved in pushed_ways(told, here, ways)]
    total = torch.zeros(len(ways), *seen.local.alone.shape, dtype=torch.float64)
    for name in names:
        moved = torch.stack([one[name] for one in each])
        if bool(moved.any()):
            total += seen.local.by_number(stages, name) * moved.reshape(len(ways), 1, -1)
    return total


def by_ground(seen: Seen, slot: Slot, changed: Changed, here: Tensor, numbers: Tensor) -> Tensor:
    """Derivative [row, channel] with respect to a parameter of the ground's law or of its local properties."""
    path, local = seen.path, seen.local
    own = path.described_alone(slot.effect, changed(here)).ground
    total = torch.zeros(local.shape, dtype=torch.float64)
    if own.compliance is not None or own.poisson_change is not None:

        def gauges(value: Tensor) -> tuple[Tensor, ...]:
            return seen.gauges(path.described(changed(value))).tensors

        moved = Gauges(*pushed_all(gauges, here, torch.ones_like(here)))
        total = total + seen.local.along_gauges(Gauges(*gauges(here)), moved)
    if own.response is None and own.settlement is None and own.radiation is None:
        return total
    load = replace(local.load, thrust=None, thrust_rate=None)

    def rate(value: Tensor) -> Tensor:
        grounds = local.grounds(path.grounds(changed(value)))
        return path.alone(load, local.here, local.poisson_ratio, grounds)

    value = local.law_at(path, telling(path.extension, numbers), lambda: rate(here))
    return total + local.amplitude * slope(rate, here, slot.parameter, value, local.section)


def telling(extension: Extension, numbers: Tensor) -> Tensor:
    """Numbers of effects on which a law depends: nothing in place of the shapes of those that are absent."""
    told = numbers.clone()
    for effect in extension.effects:
        mine = [slot for slot in extension.slots if slot.effect is effect]
        sizes = [slot for slot in mine if not slot.parameter.is_shape]
        if all(bool((numbers[slot.where] == slot.parameter.null).all()) for slot in sizes):
            for slot in mine:
                if slot.parameter.is_shape:
                    told[slot.where] = 0
    return told


def slope(
    law: Callable[[Tensor], Tensor], here: Tensor, of: Parameter, value: Tensor, section: Section | None = None
) -> Tensor:
    """Derivative of a law by a parameter from its value there and one nearby, within the bounds.

    Laws of the ground are fast where they carry no derivative: with a tangent PyTorch calls Python for every operand
    that has none, and loads its compiler, which takes a second.

    Parameters
    ----------
    law : each row of what it returns depends on the parameter's value at that row
    here : the parameter's value, [], [channel] or, of all rows, [row, 1]
    value : of the law there
    section : whose rows the law returns; all where None

    >>> here = torch.tensor(0.0, dtype=torch.float64)
    >>> slope(lambda x: x.exp(), here, Parameter("share", "1", 0.2, lower=0), torch.ones(()).double())
    tensor(1.0000, dtype=torch.float64)
    """
    step = STEP * of.plausible
    way = step * torch.where(here + step > of.upper, -1.0, 1.0)
    change = law(here + way) - value
    return change / (way[section.rows] if section is not None and of.scope in BY_ROW else way)


def acts_on_rows(seen: Seen, slot: Slot, values: Values) -> bool:
    """Whether an effect changes the response of single channels to single vehicles."""
    if slot.effect.stage in ("trajectory", "load"):
        return True
    alone = seen.path.described_alone(slot.effect, values)
    return alone.in_rows or alone.cable.moved
