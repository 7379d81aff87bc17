"""The signal path in one piece: trajectory -> load -> ground -> cable -> interrogator -> processing.

Rows are (pass, sample) pairs, as in `solver.signal_path.traffic`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor

from solver.cable.fiber import Fiber
from solver.effect import BY_ROW
from solver.load.load import Load
from solver.load.wheel_layout import wheel_loads
from solver.signal_path.closed_form import strain_rate_derivatives
from solver.signal_path.extension import NONE, Extension, Values
from solver.signal_path.gauge_strain import GaugeStrain
from solver.signal_path.observation import Description
from solver.signal_path.traffic import Traffic, Vehicles
from solver.trajectory.trajectory import Trajectory

#: Pairs of a row and a channel that are computed at once.
BLOCK = 16384


@dataclass(frozen=True)
class SignalPath:
    """Strain rate that traffic makes in a fiber.

    Parameters
    ----------
    traffic : vehicles' places
    gauge_length : m
    extension : the effects beyond the base model, none by default
    curved : strain is the integral along the fiber's path; if not, the motion of the gauge's two ends, as published
    """

    traffic: Traffic
    gauge_length: float
    extension: Extension = NONE
    curved: bool = False

    def with_effects(self, extension: Extension) -> "SignalPath":
        """The path with other effects, at the moments that they need."""
        return replace(self, extension=extension, traffic=extension.traffic or self.traffic)

    def described(self, values: Values) -> Description:
        """Ground, cable, interrogator and processing with the effects at `values`."""
        return self.extension.described(values, self.gauge_length)

    def stages_of(self, values: Values) -> Callable[[slice], Description]:
        """Function of some rows to `described` for them: once for all unless each row has its own ground."""
        by_row = (slot.parameter.scope in BY_ROW for slot in self.extension.slots if slot.effect.stage == "ground")
        if any(by_row):
            return lambda rows: self.described(self.extension.part(values, rows))
        whole = self.described(values)
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

    def rows(self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values | None = None) -> Tensor:
        """Strain rate [row, channel] of each vehicle alone, 1/s, before whatever acts on the whole map.

        Fields of `fiber` are [channel, 3] or [row, channel, 3]; of `vehicles` (per row) [row] or [row, channel];
        `poisson_ratio` is a scalar or [row, channel]; `values` are those of the effects' parameters, local to rows
        and channels (`Extension.local`).
        """
        values = values or {}
        # Fields per row get a channel axis, so that per-row and per-sample fields mix freely.
        columns = (getattr(vehicles, f.name) for f in fields(vehicles))
        v = Vehicles(*(x if x.ndim > 1 else x[:, None] for x in columns))
        return self.rows_of(self.loads(v, values), fiber, v.amplitude, poisson_ratio, self.stages_of(values))

    def rows_of(
        self, load: Load, fiber: Fiber, amplitude: Tensor, poisson_ratio: Tensor, stages: Callable[[slice], Description]
    ) -> Tensor:
        """The same [row, channel] for loads that are known; `amplitude` is [row, 1 or channel]; see `stages_of`."""

        def some(rows: slice) -> Tensor:
            here = Fiber(**{name: x[rows] for name, x in fiber.present().items()}) if fiber.ahead.ndim > 2 else fiber
            nu = poisson_ratio[rows] if poisson_ratio.ndim else poisson_ratio
            return self._rows_of(load.part(rows), here, amplitude[rows], nu, stages(rows))

        return torch.cat([some(rows) for rows in self.blocks(fiber)])

    def blocks(self, fiber: Fiber) -> list[slice]:
        """Rows that are computed at once: small tensors stay in the processor's cache, and all would hold gigabytes."""
        rows, count = len(self.traffic.pass_index), max(1, BLOCK // fiber.ahead.shape[-2])
        return [slice(first, min(first + count, rows)) for first in range(0, max(rows, 1), count)]

    def _rows_of(
        self, load: Load, fiber: Fiber, amplitude: Tensor, poisson_ratio: Tensor, stages: Description
    ) -> Tensor:
        strain = self.strain(load, fiber, poisson_ratio, stages)
        compliance = stages.ground.compliance
        rate = strain.even if compliance is None else (strain.graded * compliance(strain.points)).sum(-1)
        return amplitude * stages.cable.gain * rate

    def strain(self, load: Load, fiber: Fiber, poisson_ratio: Tensor, stages: Description) -> GaugeStrain:
        """What loads of unit amplitude do to each gauge."""
        bends = 1.0 if self.curved else stages.cable.path_integral
        return GaugeStrain(load, fiber, torch.as_tensor(poisson_ratio), stages, bends)

    def observed(self, alone: Tensor, values: Values) -> Tensor:
        """What the interrogator and the processing make of maps [..., sample, channel]."""
        return self.described(values).observed(alone, self.traffic.samples)

    def strain_rate(
        self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values | None = None
    ) -> Tensor:
        """Strain rate [sample, channel] of all vehicles together, 1/s."""
        values = values or {}
        rows = self.rows(fiber, vehicles.rows(self.traffic), poisson_ratio, values)
        return self.observed(self.traffic.superpose(rows), values)

    def sensitivities(
        self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values | None = None
    ) -> "Sensitivities":
        """Strain rate of each row and its derivative by every local quantity.

        In closed form for the base model; else in one backward pass per block of rows: each sample depends on its own
        copy of the local quantities only, so the gradient of the sum over samples holds all derivatives. What acts on
        the whole map is not in them, see `observed`.
        """
        values = values or {}
        if self.plain(fiber, values):
            return self.plain_sensitivities(fiber, vehicles, poisson_ratio, values)
        shape = (len(self.traffic.pass_index), fiber.ahead.shape[-2])
        per_row = vehicles.rows(self.traffic)
        own = {f.name: leaf(getattr(per_row, f.name)[:, None], shape) for f in fields(per_row)}
        load, stages = self.loads(Vehicles(**own), values), self.stages_of(values)
        parts = [self._block(r, load, fiber, own["amplitude"], poisson_ratio, stages(r)) for r in self.blocks(fiber)]
        rate = torch.cat([one.rate for one, _ in parts])
        by = {name: torch.cat([one.by[name] for one, _ in parts]) for name in parts[0][0].by}
        # On from the loads to the vehicles.
        moved = [x for x in load.tensors.values() if x.requires_grad]
        back = [torch.cat([part[which] for _, part in parts]) for which in range(len(moved))]
        others = {name: x for name, x in own.items() if name != "amplitude"}
        onward = torch.autograd.grad(moved, list(others.values()), back, materialize_grads=True)
        return Sensitivities(rate, by | dict(zip(others, onward, strict=True)))

    def _block(
        self, rows: slice, load: Load, fiber: Fiber, amplitude: Tensor, poisson_ratio: Tensor, stages: Description
    ) -> tuple["Sensitivities", tuple[Tensor, ...]]:
        """`sensitivities` of some rows by all but the loads, and the derivatives by each of these that may change."""
        shape = (rows.stop - rows.start, fiber.ahead.shape[-2])
        here = {name: x[rows].detach().requires_grad_(x.requires_grad) for name, x in load.tensors.items()}
        points = {name: leaf(x, shape, *x.shape[1:]) for name, x in fiber.present().items()}
        own = {"poisson_ratio": leaf(poisson_ratio, shape), "amplitude": leaf(amplitude[rows].detach(), shape)}
        rate = self._rows_of(load.with_tensors(here), Fiber(**points), own["amplitude"], own["poisson_ratio"], stages)
        leaves = own | points
        moved = [x for x in here.values() if x.requires_grad]
        wanted = [*leaves.values(), *moved]
        gradients = torch.autograd.grad(rate.sum(), wanted, materialize_grads=True)
        return Sensitivities(rate.detach(), dict(zip(leaves, gradients, strict=False))), gradients[len(leaves) :]

    def plain(self, fiber: Fiber, values: Values) -> bool:
        """Whether single vehicles do to single channels what the base model says, but for shifts along their way."""
        shifted = all(one.stage not in ("trajectory", "load") or one.shifts for one in self.extension.effects)
        return shifted and fiber.ahead.ndim == 2 and not self.described(values).in_rows

    def plain_sensitivities(
        self, fiber: Fiber, vehicles: Vehicles, poisson_ratio: Tensor, values: Values
    ) -> "Sensitivities":
        """`sensitivities` of the base model, in closed form."""
        per_row = vehicles.rows(self.traffic)
        load = self.loads(Vehicles(*(getattr(per_row, f.name)[:, None] for f in fields(per_row))), values)
        return Sensitivities(
            *strain_rate_derivatives(
                fiber.present(), load, per_row.amplitude, float(poisson_ratio), self.gauge_length, self.curved
            )
        )


def leaf(x: Tensor, shape: tuple[int, int], *tail: int) -> Tensor:
    """A copy of a quantity for each row and channel, to differentiate by; see `outermost`."""
    return outermost(x.expand(*shape, *tail), len(tail)).requires_grad_()


def outermost(x: Tensor, axes: int) -> Tensor:
    """A copy with its last axes outermost in memory, see `offsets`."""
    last, first = tuple(range(-axes, 0)), tuple(range(axes))
    return x.movedim(last, first).clone(memory_format=torch.contiguous_format).movedim(first, last)


@dataclass(frozen=True)
class Sensitivities:
    """Strain rate and its local derivatives.

    Parameters
    ----------
    rate : [row, channel], 1/s
    by : name of a local quantity -> derivative [row, channel], [row, channel, 3] or [row, channel, station, 3]
    """

    rate: Tensor
    by: dict[str, Tensor] = field(repr=False)

    @property
    def bytes(self) -> int:
        """What they take in memory."""
        return sum(one.numel() * one.element_size() for one in (self.rate, *self.by.values()))
