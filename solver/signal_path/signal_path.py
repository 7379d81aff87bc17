"""The signal path in one piece: trajectory -> load -> ground -> cable -> interrogator -> processing.

Rows are (pass, sample) pairs, as in `solver.signal_path.traffic`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from solver.cable.fiber import Fiber
from solver.effect import BY_ROW, Effect
from solver.ground.ground import Ground
from solver.ground.ground_law import summed_in_one_pass
from solver.load.load import FORCES, Load
from solver.load.wheel_layout import wheel_loads
from solver.signal_path.autodiff import pushed_ways
from solver.signal_path.extension import NONE, Extension, Values
from solver.signal_path.few import AT_ONCE
from solver.signal_path.gauges import Gauges
from solver.signal_path.ground_motion import strain_rates
from solver.signal_path.observation import Description
from solver.signal_path.sensitivities import SHIFTS, ByLoad, Sensitivities, along_load
from solver.signal_path.traffic import Traffic, Vehicles, columns
from solver.trajectory.trajectory import Trajectory

#: From rows to their ground.
Grounds = Callable[[slice | Tensor], Ground]
#: Gauge points, over all rows, that are computed together.
BLOCK = 16384
#: The same by a law that is summed over them in one pass.
BLOCK_OF_LAWS = 1 << 20


@dataclass(frozen=True)
class SignalPath:
    """Strain rate that traffic causes in a fiber.

    Parameters
    ----------
    traffic : positions of the vehicles
    gauge_length : m
    extension : the effects beyond the base model, none by default
    curved : strain is the integral along the fiber's path; if not, the relative motion of the gauge's two ends, as
        published
    """

    traffic: Traffic
    gauge_length: float
    extension: Extension = NONE
    curved: bool = False

    def with_effects(self, extension: Extension) -> "SignalPath":
        """The path with other effects, sampled in time as they need."""
        return replace(self, extension=extension, traffic=extension.traffic or self.traffic)

    def described(self, values: Values) -> Description:
        """Ground, cable, interrogator and processing with the effects at `values`."""
        return self.extension.described(values, self.gauge_length)

    def described_alone(self, effect: Effect, values: Values) -> Description:
        """The same with no other effect in the model."""
        return replace(self.extension, effects=(effect,)).described(values, self.gauge_length)

    def grounds(self, values: Values) -> Grounds:
        """A function from rows to their ground: one ground for all, unless each row has its own."""
        by_row = (slot.parameter.scope in BY_ROW for slot in self.extension.slots if slot.effect.stage == "ground")
        if any(by_row):
            return lambda rows: self.described(self.extension.part(values, rows)).ground
        whole = self.described(values).ground
        return lambda rows: whole

    def trajectory(self, vehicles: Vehicles, values: Values) -> Trajectory:
        """Where the vehicles are; fields of `vehicles` are [row, 1 or channel]."""
        traffic = self.traffic
        time, since = self.extension.clock(traffic)
        driven = Trajectory(
            time,
            since,
            traffic.position[:, None, :],
            traffic.velocity[:, None, :],
            traffic.heading[:, None, :],
            traffic.pass_index,
        )
        return self.extension.changed("trajectory", driven.shifted(vehicles.along, vehicles.across), values)

    def loads(self, vehicles: Vehicles, values: Values) -> Load:
        """Forces on the road; fields of `vehicles` are [row, 1 or channel]."""
        traffic, v, driven = self.traffic, vehicles, self.trajectory(vehicles, values)
        heading = driven.heading.expand(driven.position.shape)
        wheels, weights = wheel_loads(driven.position, heading, v.wheelbase, v.track, v.front_share)
        if not bool(traffic.class_index.any()):
            wheels, weights = wheels[..., :1, :], torch.ones_like(weights[..., :1])
        load = Load(wheels, weights, driven, traffic.class_index[traffic.pass_index])
        return self.extension.changed("load", load, values)

    def gauges(self, fiber: Fiber, values: Values) -> Gauges:
        """The gauges of that geometry: points and weights."""
        return Gauges.of(fiber, self.described(values), self.curved)

    def rows(self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values | None = None) -> Tensor:
        """Strain rate [row, channel] of each vehicle alone, 1/s, before stages that act on the whole map.

        Fields of `fiber` are [channel, ...], of `vehicles` (per row) [row]; `poisson_ratio` is a scalar; `values` are
        those of the effects' parameters, local to rows and channels (`Extension.local`).
        """
        values = values or {}
        load, gauges = self.loads(columns(vehicles), values), self.gauges(fiber, values)
        return vehicles.amplitude[:, None] * self.alone(load, gauges, poisson_ratio, self.grounds(values))

    def alone(self, load: Load, gauges: Gauges, poisson_ratio: Tensor, ground: Grounds) -> Tensor:
        """The same per unit amplitude, for given loads, gauges and ground of some rows."""
        ratio = gauges.ratio(poisson_ratio)
        parts = (
            strain_rates(load.part(rows), ground(rows), gauges.points, gauges.weights, ratio)
            for rows in self.blocks(load, gauges, ground, derivatives=False)
        )
        return torch.cat(list(parts))

    def blocks(self, load: Load, gauges: Gauges, ground: Grounds, derivatives: bool = True) -> list[slice]:
        """Blocks of rows computed together: small tensors stay in the processor's cache; all rows would take gigabytes.

        The base model's response to vertical loads is computed in one pass, whatever their number, and that of laws
        which have such a pass, with its `derivatives` where these are wanted, of many rows.
        """
        here, rows = ground(slice(0, 1)), len(load.share)
        laws, vertical = (here.response, here.radiation), load.forces.keys() == {"share"}
        if vertical and laws == (None, None):
            return spans(rows, rows)
        in_one = vertical and summed_in_one_pass(*laws, derivatives, uniform=gauges.change is None)
        return spans(rows, (BLOCK_OF_LAWS if in_one else BLOCK) // gauges.points.shape[:2].numel())

    def observed(self, alone: Tensor, values: Values) -> Tensor:
        """Maps [..., sample, channel] after interrogator and processing."""
        return self.described(values).observed(alone, self.traffic.samples)

    def strain_rate(
        self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values | None = None
    ) -> Tensor:
        """Strain rate [sample, channel] of all vehicles together, 1/s."""
        values = values or {}
        rows = self.rows(fiber, vehicles.rows(self.traffic), poisson_ratio, values)
        return self.observed(self.traffic.superpose(rows), values)

    def sensitivities(
        self,
        fiber: Fiber,
        vehicles: Vehicles,
        poisson_ratio: Tensor,
        values: Values | None = None,
        rows: Tensor | None = None,
    ) -> Sensitivities:
        """Strain rate of each row, or of some `rows`, and its derivatives with respect to every local quantity.

        One backward pass per block of rows: each pair of a row and a channel depends only on its own copy of points,
        weights and loads, so the gradient of the sum over all pairs holds all derivatives. Stages that act on the whole
        map are not included, see `observed`.
        """
        values, per_row = values or {}, vehicles.rows(self.traffic)
        mine = slice(None) if rows is None else rows
        load, gauges = self.loads(columns(per_row), values).part(mine), self.gauges(fiber, values)
        grounds = self.grounds(values)
        ground = grounds if rows is None else lambda some: grounds(rows[some])
        found = self.by_gauges_and_loads(load, gauges, per_row.amplitude[mine], poisson_ratio, ground)
        names = [f.name for f in fields(vehicles) if f.name != "amplitude"]
        moved = self.moved_loads(per_row, values, names, list(found.by_load))
        ways = {name: {which: x[mine] for which, x in way.items()} for name, way in moved.items()}
        return replace(found, by_vehicle={name: along_load(found.by_load, way) for name, way in ways.items()})

    def moved_loads(
        self, vehicles: Vehicles, values: Values, names: Sequence[str], which: Sequence[str]
    ) -> dict[str, dict[str, Tensor]]:
        """Derivatives of some tensors of the loads, by fields of the vehicles per row: field -> tensor's name -> it."""

        def loads(numbers: Tensor) -> tuple[Tensor, ...]:
            changed = replace(vehicles, **dict(zip(names, numbers, strict=True)))
            tensors = self.loads(columns(changed), values).tensors
            return tuple(tensors[one] for one in which)

        here = torch.stack([getattr(vehicles, name) for name in names])
        ways = [way[:, None].expand_as(here) for way in torch.eye(len(names), dtype=torch.float64)]
        found = zip(names, pushed_ways(loads, here, ways), strict=True)
        return {name: dict(zip(which, way, strict=True)) for name, way in found}

    def shifts(self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values) -> Sensitivities:
        """`sensitivities` with the derivatives by shifts of the vehicles alone, some rows at a time.

        What all rows' derivatives by the gauges take, ten times as much as these, is never held.
        """
        per_row = vehicles.rows(self.traffic)
        load, gauges, ground = self.loads(columns(per_row), values), self.gauges(fiber, values), self.grounds(values)
        moved, parts = self.moved_loads(per_row, values, SHIFTS, differentiated(load)), list[list[Tensor]]()
        # Each point of a gauge has seven derivatives.
        for rows in spans(len(load.share), AT_ONCE // (7 * gauges.points.shape[:2].numel())):
            (alone, *_), by = _block(load.part(rows), ground(rows), gauges, poisson_ratio)
            ways = ({name: way[rows] for name, way in of.items() if name in by} for of in moved.values())
            parts.append([alone, *(along_load(by, way) for way in ways)])
        alone, *found = (torch.cat(one) for one in zip(*parts, strict=True))
        none = alone.new_zeros(0)
        by_vehicle = dict(zip(SHIFTS, found, strict=True))
        return Sensitivities(per_row.amplitude, gauges, load, alone, none, none, none, {}, by_vehicle)

    def by_gauges_and_loads(
        self, load: Load, gauges: Gauges, amplitude: Tensor, poisson_ratio: Tensor, ground: Grounds
    ) -> Sensitivities:
        """The same but for what may be fitted about each vehicle, at any rows; `amplitude` is [row]."""
        parts = [_block(load.part(r), ground(r), gauges, poisson_ratio) for r in self.blocks(load, gauges, ground)]
        each = zip(*(own for own, _ in parts), strict=True)
        alone, by_point, by_weight, by_ratio = (one[0] if len(one) == 1 else torch.cat(one) for one in each)
        by_load = _joined([by for _, by in parts])
        return Sensitivities(amplitude, gauges, load, alone, by_point, by_weight, by_ratio, by_load, {})

    def by_load(self, load: Load, gauges: Gauges, poisson_ratio: Tensor, ground: Grounds) -> ByLoad:
        """Only the derivatives with respect to the tensors of the loads."""
        parts = (_by_load(load.part(r), ground(r), gauges, poisson_ratio) for r in self.blocks(load, gauges, ground))
        return _joined(list(parts))


def spans(rows: int, count: int) -> list[slice]:
    """Rows, so many at a time and at least one; one span of none where there are none.

    >>> spans(5, 2)
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    """
    count = max(1, count)
    return [slice(first, min(first + count, rows)) for first in range(0, max(rows, 1), count)]


def differentiated(load: Load) -> list[str]:
    """Names of the tensors of a load that strain rate is differentiated by: nothing else depends on the channel."""
    return [name for name in load.tensors if name in ("position", *FORCES, "trajectory.velocity")]


def leaf(x: Tensor, *whole: int) -> Tensor:
    """A copy of its own for each row and channel, to be differentiated by."""
    return x.detach().expand(*whole).requires_grad_()


def leaves(load: Load, rows: int, channels: int) -> dict[str, Tensor]:
    """The tensors of a load that strain rate is differentiated by, each row and channel with its own."""
    tensors = load.tensors
    return {name: leaf(tensors[name], rows, channels, *tensors[name].shape[2:]) for name in differentiated(load)}


def _joined(parts: Sequence[ByLoad]) -> ByLoad:
    """Join blocks of rows."""
    if len(parts) == 1:
        return parts[0]
    return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


def _block(
    load: Load, ground: Ground, gauges: Gauges, poisson_ratio: Tensor
) -> tuple[tuple[Tensor, Tensor, Tensor, Tensor], dict[str, Tensor]]:
    """Strain rate [row, channel] of some rows, and its derivatives by points, weights, ratio and loads."""
    shape = (len(load.share), *gauges.points.shape[:2])
    own = leaf(gauges.points, *shape, 3), leaf(gauges.weights, *shape, 3), leaf(gauges.ratio(poisson_ratio), *shape)
    forces = leaves(load, *shape[:2])
    with torch.enable_grad():
        rate = strain_rates(load.with_tensors(load.tensors | forces), ground, *own)
    by_point, by_weight, by_ratio, *found = torch.autograd.grad(rate.sum(), [*own, *forces.values()], allow_unused=True)
    by_load = {name: grad for name, grad in zip(forces, found, strict=True) if grad is not None}
    return (rate.detach(), by_point, by_weight, by_ratio), by_load


def _by_load(load: Load, ground: Ground, gauges: Gauges, poisson_ratio: Tensor) -> dict[str, Tensor]:
    """The derivatives by loads alone."""
    forces = leaves(load, len(load.share), len(gauges.points))
    own = gauges.points, gauges.weights, gauges.ratio(poisson_ratio).expand(gauges.points.shape[:2])
    with torch.enable_grad():
        rate = strain_rates(load.with_tensors(load.tensors | forces), ground, *own)
    found = torch.autograd.grad(rate.sum(), list(forces.values()), allow_unused=True)
    return {name: grad for name, grad in zip(forces, found, strict=True) if grad is not None}
