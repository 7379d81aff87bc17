"""What loads do to single gauges: ground motion at points along each, and the strain rate that it makes there."""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn.functional import pad

from solver.cable.fiber import STATION_OFFSETS, STATION_WEIGHTS, Fiber, axial, turning, unit
from solver.ground.ground import Ground
from solver.ground.tangential import tangential_displacement, tangential_displacement_rate
from solver.interrogator.gauge import gauge_strain_rate
from solver.load.load import Load
from solver.signal_path.observation import Description
from solver.transfers import Field


@dataclass(frozen=True)
class GaugeStrain:
    """Strain rate that loads of unit amplitude make in each gauge.

    Parameters
    ----------
    load : forces on the road
    fiber : the gauges
    poisson_ratio : scalar or [row, channel]
    stages : of the signal path
    bends : share of what the turning of the fiber within its gauge adds
    """

    load: Load
    fiber: Fiber
    poisson_ratio: Tensor
    stages: Description
    bends: Tensor | float

    @property
    def even(self) -> Tensor:
        """[row, channel], in ground that is as stiff all along each gauge."""
        change = None if self.change is None else self.change(self.points)
        rate = gauge_strain_rate(*self.ends, self.stages.gauge) if change is None else self.varied(change).sum(-1)
        if self.fiber.inner is None:
            return rate
        return rate + self.bent(None if change is None else change[..., 1:-1]).sum(-1)

    def varied(self, change: Tensor) -> Tensor:
        """[row, channel, piece], of a gauge's pieces; `change` [..., channel, point] of the ratio is at `points`.

        Strain is local: with a ratio of its own at either end, their difference in settlement would count as strain. So
        each piece of a gauge has one ratio, the mean of those at its ends.
        """
        f, points = self.fiber, self.points
        slopes = [f.behind_slope[..., None, :], f.ahead_slope[..., None, :]]
        if f.inner_slope is not None:
            slopes.insert(1, f.inner_slope)
        tangent, mean = self.tangent(torch.cat(slopes, -2)), (change[..., 1:] + change[..., :-1]) / 2
        ahead, behind = (
            self.followed(axial(self.motion(points[..., where, :], True, mean), tangent[..., where, :]), where)
            for where in (slice(1, None), slice(None, -1))
        )
        return gauge_strain_rate(ahead, behind, torch.as_tensor(self.stages.gauge)[..., None])

    def bent(self, change: Tensor | None) -> Tensor:
        """[row, channel, station], of the turning within; `change` [..., channel, station] of the ratio is there.

        A loose length turns with its duct as if it were held: evening this part out too would matter in bends only.
        """
        assert self.fiber.inner is not None
        return self.bends * bend_strain_rates(self.motion(self.fiber.inner, True, change), self.fiber)

    @property
    def graded(self) -> Tensor:
        """[row, channel, point], by the ground's compliance c at `points`.

        The mean of c t . du/ds over a gauge is summed piece by piece, with the mean of c at either end of each piece.
        """
        assert self.fiber.inner is not None and self.fiber.inner_slope is not None
        inner = self.motion(self.fiber.inner, True)
        ahead, behind = self.ends
        within = self.followed(axial(inner, self.tangent(self.fiber.inner_slope)), slice(1, -1))
        moved = torch.cat([behind[..., None], within, ahead[..., None]], -1)
        pieces = moved.diff(dim=-1) / (2 * torch.as_tensor(self.stages.gauge)[..., None])
        bent = self.bends * bend_strain_rates(inner, self.fiber)
        return pad(pieces, (1, 0)) + pad(pieces, (0, 1)) + pad(bent, (1, 1))

    @property
    def points(self) -> Tensor:
        """[..., channel, point, 3], m: the end behind, the stations within where there are any, the end ahead."""
        behind, ahead = self.fiber.behind[..., None, :], self.fiber.ahead[..., None, :]
        return torch.cat([behind, ahead] if self.fiber.inner is None else [behind, self.fiber.inner, ahead], -2)

    @property
    def ends(self) -> tuple[Tensor, Tensor]:
        """Motion [row, channel] along the fiber at the ends ahead and behind."""
        f = self.fiber
        places = ((f.ahead, f.ahead_slope, -1), (f.behind, f.behind_slope, 0))
        ahead, behind = (
            self.followed(axial(self.motion(point), self.tangent(slope)), end) for point, slope, end in places
        )
        return ahead, behind

    def followed(self, ground: Tensor, which: int | slice) -> Tensor:
        """Motion [row, channel] or [row, channel, point] along the fiber at some of `points`, by that of the ground."""
        loose = self.stages.cable.loose
        if loose is None:
            return ground
        first, last = (x[..., None] if isinstance(which, slice) else x for x in self.held)
        return loose.moved(ground, self.along[..., which], first, last)

    @cached_property
    def held(self) -> tuple[Tensor, Tensor]:
        """Motion [row, 1 or channel] along the fiber where a loose length begins and ends."""
        f = self.fiber
        assert f.first is not None and f.first_slope is not None and f.last is not None and f.last_slope is not None
        first, last = (
            axial(self.motion(point), self.tangent(slope))
            for point, slope in ((f.first, f.first_slope), (f.last, f.last_slope))
        )
        return first, last

    @property
    def along(self) -> Tensor:
        """Where along the route `points` are, [channel, point], m."""
        within = [] if self.fiber.inner is None else STATION_OFFSETS.tolist()
        reach = torch.as_tensor(self.stages.gauge)[..., None] * torch.tensor([-0.5, *within, 0.5], dtype=torch.float64)
        return self.stages.cable.distance[..., None] + reach

    @property
    def change(self) -> Field | None:
        """What is added to Poisson's ratio here and there."""
        return self.stages.ground.poisson_change

    def motion(self, point: Tensor, within: bool = False, change: Tensor | None = None) -> Tensor:
        """Velocity of the ground, see `ground_motion`; `change` is of the ratio, at the points where None."""
        nu = self.poisson_ratio
        if nu.ndim:
            nu = nu.reshape(*nu.shape, *[1] * within)
        if self.change is not None:
            nu = nu + (self.change(point) if change is None else change)
        return ground_motion(self.load, self.stages.ground, point, nu, within)

    def tangent(self, slope: Tensor) -> Tensor:
        """The way along which the fiber follows the ground."""
        tangent, vertical = unit(slope), self.stages.cable.vertical
        if not isinstance(vertical, Tensor):
            return tangent
        return torch.cat([tangent[..., :2], tangent[..., 2:] * vertical], -1)


def ground_motion(load: Load, ground: Ground, point: Tensor, poisson_ratio: Tensor, stations: bool = False) -> Tensor:
    """Velocity of the ground under loads, per unit amplitude.

    Parameters
    ----------
    point : [channel, 3] or [row, channel, 3], m; with `stations` one more axis before the last
    poisson_ratio : scalar, or as `point` without its last axis, or [row, channel]; with `stations` one more axis

    Returns
    -------
    [row, channel, 3] or [row, channel, station, 3]
    """

    def beside(x: Tensor, tail: int) -> Tensor:
        """A quantity per row, channel and wheel, with an axis for stations where points have one."""
        return x.unsqueeze(x.ndim - tail) if stations else x

    wheels = beside(load.position, 2)
    velocity = beside(load.trajectory.velocity[..., None, :], 2)
    nu = poisson_ratio[..., None] if poisson_ratio.ndim else poisson_ratio
    offset = offsets(point, wheels)
    motion = ground.displacement_rate(offset, velocity, nu)
    if ground.radiation is not None:
        motion = motion + ground.radiation(offset, velocity, beside(load.trajectory.time[..., None], 1))
    motion = beside(load.share, 1)[..., None] * motion
    if load.share_rate is not None:
        motion = motion + beside(load.share_rate, 1)[..., None] * ground.displacement(offset, nu)
    if load.thrust is not None:
        motion = motion + tangential_displacement_rate(offset, velocity, nu, beside(load.thrust, 2))
    if load.thrust_rate is not None:
        motion = motion + tangential_displacement(offset, nu, beside(load.thrust_rate, 2))
    return motion.sum(-2)


def offsets(point: Tensor, wheels: Tensor) -> Tensor:
    """Points [..., 3], z down, less wheels [..., wheel, 2] on the road: [..., wheel, 3], m.

    Components and wheels are outermost in memory: all that is done to them, sums over wheels above all, then runs along
    long rows, several times as fast.
    """
    at = wheels.movedim((-1, -2), (0, 1))
    x, y = point[..., 0] - at[0], point[..., 1] - at[1]
    return torch.stack([x, y, point[..., 2].expand(x.shape)]).movedim((0, 1), (-1, -2))


def bend_strain_rates(motion: Tensor, fiber: Fiber) -> Tensor:
    """What the turning of the fiber at each station [row, channel, station] adds to the strain rate of the two ends.

    `motion` [row, channel, station, 3] is the ground's velocity at the inner stations. The strain averaged over a gauge
    is the integral of t . du/ds = [t . u] - integral of u . dt/ds, over its length.
    """
    slope, bend = fiber.inner_slope, fiber.inner_bend
    assert slope is not None and bend is not None
    weights = torch.from_numpy(STATION_WEIGHTS)
    return -weights * axial(motion, turning(slope, bend))
