"""Derivatives of the strain-rate map with respect to an effect's parameters: the chain rule through loads and gauges.

The effect of a parameter on loads or gauges is differentiated automatically, for these are few numbers; the derivatives
of strain rate with respect to them come from `solver.signal_path.sensitivities`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import torch
from torch import Tensor
from torch.autograd import forward_ad
from torch.func import jvp

from solver.ground.ground import Ground
from solver.load.load import Load
from solver.signal_path.autodiff import pushed_all, pushed_ways
from solver.signal_path.extension import Slot, Values
from solver.signal_path.gauges import Gauges
from solver.signal_path.observation import Description
from solver.signal_path.sensitivities import ByLoad, Sensitivities, along_load
from solver.signal_path.signal_path import SignalPath, columns
from solver.signal_path.traffic import Vehicles

#: Columns that are filtered together.
COLUMNS = 16
#: Values of maps that are computed at once: of all numbers of an effect they may take gigabytes.
AT_ONCE = 1 << 21
#: Bytes of derivatives by other loads that are kept.
OTHERS = 1e8
#: Numbers of the cable that a parameter may change: per channel, common to all, and of a loose length.
EACH, ALIKE, LOOSE = ("shift", "slack", "gain"), ("vertical", "path_integral"), ("begin", "end", "share")

Changed = Callable[[Tensor], Values]


@dataclass(frozen=True)
class Local:
    """Response of single gauges to single vehicles at a state: what all derivatives share.

    Parameters
    ----------
    path : with the effects
    gauges : as the stages describe them, on the route of the state
    vehicles : per row
    poisson_ratio : of the state
    values : of the effects
    by : sensitivities at the state
    """

    path: SignalPath
    gauges: Callable[[Description], Gauges]
    vehicles: Vehicles
    poisson_ratio: Tensor
    values: Values
    by: Sensitivities
    _by_load: list[tuple[Load, ByLoad]] = field(default_factory=list, init=False)
    _by_number: dict[tuple[object, ...], Tensor] = field(default_factory=dict, init=False)

    @classmethod
    def of(
        cls,
        path: SignalPath,
        gauges: Callable[[Description], Gauges],
        vehicles: Vehicles,
        poisson_ratio: Tensor,
        values: Values,
    ) -> "Local":
        """With the sensitivities computed."""
        load, here = path.loads(columns(vehicles), values), gauges(path.described(values))
        by = path.sensitivities_of(load, here, vehicles, poisson_ratio, values)
        return cls(path, gauges, vehicles, poisson_ratio, values, by)

    @property
    def by_gauges_alone(self) -> "Local":
        """Without derivatives by the loads: few candidates that change gauges ask for those."""
        return replace(self, by=replace(self.by, by_load={}, by_vehicle={}))

    @cached_property
    def alone(self) -> Tensor:
        """Map [sample, computed channel], 1/s, before stages that act on the whole map."""
        return self.path.traffic.superpose(self.by.rate)

    def by_load(self, load: Load) -> ByLoad:
        """Derivatives with respect to a load that may have other wheels than `by`, or further forces that are zero."""
        for known, by in ((self.by.load, self.by.by_load), *self._by_load):
            if by and known.alike(load):
                return by
        if self._by_load and self.bytes - self.by.bytes > OTHERS:
            self._by_load.pop(0)
        by = self.path.by_load(load, self.by.gauges, self.poisson_ratio, self.values)
        self._by_load.append((load, by))
        return by

    @property
    def bytes(self) -> int:
        """Their size in memory."""
        every = [one for _, by in self._by_load for one in by.values()] + list(self._by_number.values())
        return self.by.bytes + sum(one.numel() * one.element_size() for one in every)

    def along_gauges(self, here: Gauges, change: Gauges) -> Tensor:
        """Derivative [row, channel] by what changes gauges so; some of their points may lie elsewhere than in `by`."""
        other = (here.points != self.by.gauges.points).flatten(2).any(2).any(0)
        if not bool(other.any()):
            return self.by.along_gauges(change)
        # Each point adds what it adds, whatever the others are.
        new = self.path.sensitivities_of(self.by.load, here.part(other), self.vehicles, self.poisson_ratio, self.values)
        return self.by.part(~other).along_gauges(change.part(~other)) + new.along_gauges(change.part(other))

    def by_number(self, stages: Description, name: str) -> Tensor:
        """Derivative of `alone` with respect to a number of the cable, or the gauge length."""
        loose = stages.cable.loose
        key = name, *(() if loose is None else (float(getattr(loose, one)) for one in LOOSE))
        if key not in self._by_number:
            here = torch.as_tensor(number(stages, name), dtype=torch.float64)
            here = here.expand(len(stages.cable.counted)) if name in EACH else here
            moved = pushed_all(lambda x: self.gauges(with_number(stages, name, x)).tensors, here, torch.ones_like(here))
            self._by_number[key] = self.path.traffic.superpose(self.along_gauges(self.gauges(stages), Gauges(*moved)))
        return self._by_number[key]


@dataclass(frozen=True)
class Seen:
    """A model at a state.

    Parameters
    ----------
    path : with the effects
    gauges : as in `Local`
    local : of this path, or of one that differs only by an effect at its null
    """

    path: SignalPath
    gauges: Callable[[Description], Gauges]
    local: Local


def number(stages: Description, name: str) -> Tensor | float:
    """A number of the cable or its loose length, or the gauge length."""
    if name == "gauge_length":
        return stages.interrogator.gauge_length
    value: Tensor | float = getattr(stages.cable.loose if name in LOOSE else stages.cable, name)
    return value


def with_number(stages: Description, name: str, value: Tensor) -> Description:
    """The stages with another value of `number`."""
    if name == "gauge_length":
        return replace(stages, interrogator=replace(stages.interrogator, gauge_length=value))
    cable = stages.cable
    if name in LOOSE:
        assert cable.loose is not None
        return replace(stages, cable=replace(cable, loose=replace(cable.loose, **{name: value})))
    changed = {name: value}
    return replace(stages, cable=replace(cable, **changed))  # type: ignore[arg-type]


def observed_tangents(path: SignalPath, alone: Tensor, tangents: Tensor, values: Values) -> Tensor:
    """Small changes [column, sample, computed channel] of a map, as interrogator and processing pass them on."""
    stages = path.described(values)
    plain = not stages.nonlinear and not stages.processing.steps

    def seen(some: Tensor) -> Tensor:
        if plain:
            return path.observed(some, values)
        return jvp(lambda m: path.observed(m, values), (alone.expand_as(some).clone(),), (some.contiguous(),))[1]

    # Spectra of all columns at once would not fit into memory.
    return torch.cat([seen(some) for some in tangents.split(COLUMNS)])


def few_of(cells: int) -> int:
    """How many maps of so many values are computed at once."""
    return max(1, AT_ONCE // max(cells, 1))


def derivative(seen: Seen, slot: Slot, numbers: Tensor) -> Tensor:
    """Derivative of the observed map with respect to the numbers of one parameter, [number, sample, channel]."""
    return torch.cat(list(derivatives(seen, slot, numbers)))


def derivatives(seen: Seen, slot: Slot, numbers: Tensor) -> Iterator[Tensor]:
    """The same, a few numbers at a time.

    A row depends only on the parameter's value at that row, so a single tangent, 1 everywhere, holds the derivatives
    with respect to all numbers.
    """
    path, extension = seen.path, seen.path.extension
    values = extension.local(numbers)
    effect, p, scope = slot.effect, slot.parameter, slot.parameter.scope

    def change(value: Tensor) -> Values:
        return {**values, effect.name: {**values[effect.name], p.name: value}}

    assert extension.scopes is not None
    here, alone = values[effect.name][p.name], seen.local.alone
    weights = torch.ones(here.numel(), 1).double() if scope == "one" else extension.scopes.along(scope)
    in_rows = acts_on_rows(seen, slot, values)
    by_gauge = in_rows and effect.stage in ("cable", "interrogator")
    by_row = tangents(seen, slot, values) if in_rows and not by_gauge else []
    for some in torch.arange(weights.shape[1]).split(few_of(alone.numel())):
        ways = [way.reshape(here.shape) for way in weights[:, some].unbind(1)]
        parts = []
        if in_rows:
            columns = by_gauges(seen, change, here, ways) if by_gauge else spread(seen, slot, by_row, some)
            parts.append(observed_tangents(path, alone, columns, values))
        if acts_on_map(seen, slot, values):
            found = pushed_ways(lambda v: (path.observed(alone, change(v)),), here, ways)
            parts.append(torch.stack([moved for (moved,) in found]))
        yield sum(parts[1:], parts[0])


def tangents(seen: Seen, slot: Slot, values: Values) -> list[Tensor]:
    """Derivatives [row, channel] with respect to a parameter of loads or ground at its row, and to its rate."""
    p, name = slot.parameter, slot.effect.name

    def along(which: str) -> Tensor:
        def changed(value: Tensor) -> Values:
            return {**values, name: {**values[name], which: value}}

        return by_rows(seen, slot, changed, values[name][which])

    rated = p.rated and p.scope not in ("one", "fiber")
    return [along(p.name), *([along(p.rate_name)] if rated else [])]


def spread(seen: Seen, slot: Slot, by_row: Sequence[Tensor], some: Tensor) -> Tensor:
    """Derivatives [some, sample, channel] with respect to some of a parameter's numbers, from those of `tangents`."""
    path, scopes, scope = seen.path, seen.path.extension.scopes, slot.parameter.scope
    assert scopes is not None
    if scope in ("one", "fiber"):
        whole = path.traffic.superpose(by_row[0])[None]
        return whole if scope == "one" else whole * scopes.fiber.T[some, None, :]
    matrices = (scopes.rows[scope], scopes.rates[scope]) if len(by_row) > 1 else (scopes.rows[scope],)
    out = torch.zeros(len(some), len(path.traffic.samples), by_row[0].shape[1], dtype=torch.float64)
    for rows, matrix in zip(by_row, matrices, strict=True):
        for one, share in zip(out, matrix[:, some].unbind(1), strict=True):
            acts = share.nonzero()[:, 0]
            one.index_add_(0, path.traffic.sample_index[acts], rows[acts] * share[acts, None])
    return out


def by_rows(seen: Seen, slot: Slot, changed: Changed, here: Tensor) -> Tensor:
    """Derivative [row, channel] with respect to a parameter of loads or of the ground."""
    if slot.effect.stage == "ground":
        return by_ground(seen, slot, changed, here)
    path, vehicles = seen.path, columns(seen.local.vehicles)
    by = seen.local.by_load(path.loads(vehicles, changed(here)))

    def loads(value: Tensor) -> tuple[Tensor, ...]:
        tensors = path.loads(vehicles, changed(value)).tensors
        return tuple(tensors[name] for name in by)

    moved = pushed_all(loads, here, torch.ones_like(here))
    return seen.local.by.amplitude[:, None] * along_load(by, dict(zip(by, moved, strict=True)))


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


def by_ground(seen: Seen, slot: Slot, changed: Changed, here: Tensor) -> Tensor:
    """Derivative [row, channel] with respect to a parameter of the ground's law or of its local properties."""
    path, by = seen.path, seen.local.by
    own = described_alone(path, slot, changed(here)).ground
    total = torch.zeros_like(by.alone)
    if own.compliance is not None or own.poisson_change is not None:

        def gauges(value: Tensor) -> tuple[Tensor, ...]:
            return seen.gauges(path.described(changed(value))).tensors

        moved = Gauges(*pushed_all(gauges, here, torch.ones_like(here)))
        total = total + seen.local.along_gauges(Gauges(*gauges(here)), moved)
    if own.response is None and own.settlement is None and own.radiation is None:
        return total
    # Strain is proportional to the ground's response: apply the derivative of the response to the loads.
    with forward_ad.dual_level():
        dual = path.grounds(changed(forward_ad.make_dual(here, torch.ones_like(here))))
        load = replace(by.load, thrust=None, thrust_rate=None)
        rate = path.alone(load, by.gauges, seen.local.poisson_ratio, lambda rows: varying(dual(rows)))
    return total + by.amplitude[:, None] * rate


def varying(ground: Ground) -> Ground:
    """Ground whose response is replaced by its derivative with respect to the parameter that carries one."""

    def tangent(answer: Callable[..., Tensor] | None) -> Callable[..., Tensor]:
        def along(offset: Tensor, *others: Tensor) -> Tensor:
            if answer is None:
                return torch.zeros_like(offset)
            value, found = forward_ad.unpack_dual(answer(offset, *others))
            return torch.zeros_like(value) if found is None else found

        return along

    radiation = None if ground.radiation is None else tangent(ground.radiation)
    return replace(
        ground, response=tangent(ground.response), settlement=tangent(ground.settlement), radiation=radiation
    )


def described_alone(path: SignalPath, slot: Slot, values: Values) -> Description:
    """The stages as they are with no other effect in the model."""
    return replace(path.extension, effects=(slot.effect,)).described(values, path.gauge_length)


def acts_on_rows(seen: Seen, slot: Slot, values: Values) -> bool:
    """Whether an effect changes the response of single channels to single vehicles."""
    if slot.effect.stage in ("trajectory", "load"):
        return True
    alone = described_alone(seen.path, slot, values)
    return alone.in_rows or alone.cable.moved


def acts_on_map(seen: Seen, slot: Slot, values: Values) -> bool:
    """Whether an effect acts on the whole map."""
    if slot.effect.stage in ("trajectory", "load"):
        return False
    alone = described_alone(seen.path, slot, values)
    gained = isinstance(alone.interrogator.gain, Tensor)
    return bool(gained or alone.along_fiber or alone.in_time or alone.nonlinear or alone.processing.steps)
