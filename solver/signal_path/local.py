"""What single vehicles do to single channels at a state, and what derivatives by many parameters are made of."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor
from torch.func import jvp

from solver.cable.fiber import STATION_OFFSETS, Fiber
from solver.load.load import Load
from solver.signal_path.extension import Values
from solver.signal_path.observation import Description
from solver.signal_path.signal_path import Sensitivities, SignalPath
from solver.signal_path.traffic import Vehicles

FiberAt = Callable[[Values, int], Fiber]


@dataclass(frozen=True)
class WheelResponses:
    """What each wheel of each row does to each channel, per unit of what the load stage may change about it.

    Parameters
    ----------
    path : of the model
    load : where its wheels are
    fiber : the gauges' ends
    amplitude : [row, 1]
    poisson_ratio : scalar or [row, channel]
    values : of the effects
    """

    path: SignalPath
    load: Load
    fiber: Fiber
    amplitude: Tensor
    poisson_ratio: Tensor
    values: Values

    @cached_property
    def share(self) -> Tensor:
        """Strain rate [row, channel, wheel] by vertical force."""
        return self._each(share=self._one)

    @cached_property
    def share_rate(self) -> Tensor:
        """Strain rate [row, channel, wheel] by the time derivative of vertical force."""
        return self._each(share_rate=self._one)

    @cached_property
    def thrust(self) -> Tensor:
        """Strain rate [row, channel, wheel, 2] by horizontal force along x and y."""
        return self._both_ways("thrust")

    @cached_property
    def thrust_rate(self) -> Tensor:
        """Strain rate [row, channel, wheel, 2] by the time derivative of horizontal force along x and y."""
        return self._both_ways("thrust_rate")

    def _both_ways(self, force: str) -> Tensor:
        axes = torch.eye(2, dtype=self.amplitude.dtype)
        return torch.stack([self._each(**{force: self._one[..., None] * axis}) for axis in axes], -1)

    @property
    def _one(self) -> Tensor:
        return torch.ones_like(self.load.share[..., :1])

    def _each(self, **force: Any) -> Tensor:
        still = replace(self.load, share=torch.zeros_like(self._one), share_rate=None, thrust=None, thrust_rate=None)
        single, stages = [], self.path.stages_of(self.values)
        for wheel in range(self.load.position.shape[-2]):
            one = replace(still, position=self.load.position[..., wheel : wheel + 1, :], **force)
            single.append(self.path.rows_of(one, self.fiber, self.amplitude, self.poisson_ratio, stages))
        return torch.stack(single, -1)


@dataclass(frozen=True)
class Local:
    """What single vehicles do to single channels at a state, and its derivatives, each computed when asked for.

    Parameters
    ----------
    path : with the effects
    fiber : (values of the effects, order) -> the gauges' ends, or their derivative by distance for order 1
    vehicles, poisson_ratio : of the state
    values : of the effects
    by : strain rate of each vehicle alone and its derivatives by local quantities
    """

    path: SignalPath
    fiber: FiberAt
    vehicles: Vehicles
    poisson_ratio: Tensor
    values: Values
    by: Sensitivities

    @cached_property
    def alone(self) -> Tensor:
        """Map [sample, computed channel] before whatever acts on the whole of it, 1/s."""
        return self.path.traffic.superpose(self.by.rate)

    @cached_property
    def gauges(self) -> Fiber:
        """The gauges' ends."""
        return self.fiber(self.values, 0)

    @cached_property
    def distance(self) -> Tensor:
        """Derivative [row, computed channel] by a shift of the channel along the fiber, 1/m."""
        total = torch.zeros_like(self.by.rate)
        # Beside its points, where a gauge is matters to a loose length alone.
        if self.path.described(self.values).cable.loose is not None:
            total = self._with_points_still("shift")
        for name, moved in self.fiber(self.values, 1).present().items():
            total = total + (self.by.by[name] * moved).flatten(2).sum(-1)
        return total

    @cached_property
    def slack(self) -> Tensor:
        """Derivative [row, computed channel] by how much farther the gauge reaches, relative to its length."""
        length, total = self.path.described(self.values).interrogator.gauge_length, self._with_points_still("slack")
        half = torch.tensor(0.5)
        reach = {"ahead": half, "behind": -half, "inner": torch.from_numpy(STATION_OFFSETS)[:, None]}
        for name, moved in self.fiber(self.values, 1).present().items():
            total = total + length * (self.by.by[name] * moved * reach[name.split("_")[0]]).flatten(2).sum(-1)
        return total

    def _with_points_still(self, name: str) -> Tensor:
        """Derivative [row, computed channel] by a number of each channel of the cable, gauges' ends as they are."""
        stages = self.path.stages_of(self.values)
        cable = self.path.described(self.values).cable
        here = getattr(cable, name) + torch.zeros_like(cable.counted)

        def rows(value: Tensor) -> Tensor:
            changed: dict[str, Any] = {name: value}

            def described(some: slice) -> Description:
                return replace(stages(some), cable=replace(cable, **changed))

            return self.path.rows_of(self.load, self.gauges, self.rows.amplitude, self.poisson_ratio, described)

        return jvp(rows, (here,), (torch.ones_like(here),))[1]

    @cached_property
    def ground_ends(self) -> tuple[Tensor, Tensor]:
        """Motion of the ground [row, computed channel] along the fiber at the ends of gauges, m/s."""
        stages = self.path.described(self.values)
        held = replace(stages, cable=replace(stages.cable, loose=None))
        return self.path.strain(self.load, self.gauges, self.poisson_ratio, held).ends

    @cached_property
    def rows(self) -> Vehicles:
        """The vehicles of each row, [row, 1]."""
        rows = self.vehicles.rows(self.path.traffic)
        return Vehicles(*(getattr(rows, f.name)[:, None] for f in fields(rows)))

    @cached_property
    def graded(self) -> tuple[Tensor, Tensor]:
        """Points [channel, point, 3] along each gauge, m, and derivatives [row, channel, point] by compliance there."""
        stages = self.path.described(self.values)
        strain = self.path.strain(self.load, self.gauges, self.poisson_ratio, stages)
        return strain.points, torch.as_tensor(self.rows.amplitude * stages.cable.gain)[..., None] * strain.graded

    @cached_property
    def by_ratio(self) -> tuple[Tensor, Tensor, Tensor | None]:
        """Points [channel, point, 3], m, and derivatives by Poisson's ratio there.

        Of each gauge's pieces [row, channel, piece], by the mean ratio at their ends, and of what the fiber's turning
        within adds [row, channel, station].
        """
        stages = self.path.described(self.values)
        if stages.ground.poisson_change is None:
            # Else the ratio would be the same everywhere, whatever is added to it.
            stages = replace(stages, ground=replace(stages.ground, poisson_change=lambda point: 0 * point[..., 0]))
        strain = self.path.strain(self.load, self.gauges, self.poisson_ratio, stages)
        points, field = strain.points, strain.change
        assert field is not None
        change = field(points)
        scale = torch.as_tensor(self.rows.amplitude * stages.cable.gain)[..., None]
        pieces = jvp(strain.varied, (change,), (torch.ones_like(change),))[1]
        if strain.fiber.inner is None:
            return points, scale * pieces, None
        within = change[..., 1:-1]
        return points, scale * pieces, scale * jvp(strain.bent, (within,), (torch.ones_like(within),))[1]

    @cached_property
    def load(self) -> Load:
        """Forces on the road."""
        return self.path.loads(self.rows, self.values)

    @cached_property
    def wheels(self) -> WheelResponses:
        """Derivatives by the strength of each wheel."""
        return WheelResponses(self.path, self.load, self.gauges, self.rows.amplitude, self.poisson_ratio, self.values)


@dataclass(frozen=True)
class Seen:
    """A model at a state.

    Parameters
    ----------
    path : with the effects
    fiber : as in `Local`
    local : of this path, or of one that differs by an effect at its null
    """

    path: SignalPath
    fiber: FiberAt
    local: Local
