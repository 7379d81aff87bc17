"""Response of gauges to loads: the ground's velocity at each gauge's points, weighted and summed."""

from collections.abc import Callable

import torch
from torch import Tensor

from solver.ground.ground import Ground
from solver.ground.tangential import tangential_displacement, tangential_displacement_rate
from solver.ground.wheel_motion import gauge_response
from solver.load.load import Load

#: From a force, offsets, velocity of the load and Poisson's ratio to the ground's velocity.
Moved = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]


def strain_rates(load: Load, ground: Ground, points: Tensor, weights: Tensor, ratio: Tensor) -> Tensor:
    """Strain rate [row, channel] of gauges, per unit amplitude: the sum of weight . velocity of the ground.

    Parameters
    ----------
    points, weights : [..., channel, point, 3], m and 1/m, see `solver.signal_path.gauges.Gauges`
    ratio : Poisson's; scalar or [..., channel, point]
    """
    static = None
    if ground.response is None:
        static = gauge_response(points, weights, load.position, load.share, load.trajectory.velocity, ratio)
    moving = ground_motion(load, ground, points, ratio, static is None)
    if moving is None:
        assert static is not None
        return static
    rest = (weights * moving).sum((-1, -2))
    return rest if static is None else static + rest


def ground_motion(
    load: Load, ground: Ground, point: Tensor, poisson_ratio: Tensor, static: bool = True
) -> Tensor | None:
    """Velocity of the ground under loads, per unit amplitude.

    Parameters
    ----------
    point : [..., channel, point, 3], m
    poisson_ratio : scalar or [..., channel, point]
    static : include the response to the constant weight of the vehicles

    Returns
    -------
    [row, channel, point, 3], or None if that part is excluded and there is no other
    """
    others = ground.radiation, load.share_rate, load.thrust, load.thrust_rate
    if not static and all(one is None for one in others):
        return None
    parts = []
    offset = offsets(point, load.position[..., None, :, :])
    velocity = load.trajectory.velocity[..., None, None, :]
    nu = poisson_ratio[..., None] if poisson_ratio.ndim else poisson_ratio
    share = load.share[..., None, :, None]
    if static:
        parts.append(share * ground.displacement_rate(offset, velocity, nu))
    if ground.radiation is not None:
        parts.append(share * ground.radiation(offset, velocity, load.trajectory.time[..., None, None]))
    for force, moved in forces(load, ground):
        # Of a force that is nothing yet, only what more of it would do is ever asked for.
        at = (offset, velocity, nu) if bool(force.any()) else (offset.detach(), velocity.detach(), nu.detach())
        parts.append(moved(force, *at))
    return sum(parts[1:], parts[0]).sum(-2)


def forces(load: Load, ground: Ground) -> list[tuple[Tensor, Moved]]:
    """Forces of wheels on the road other than constant weight, and what each moves, [row, channel, point, wheel, 3]."""

    def bounced(rate: Tensor, offset: Tensor, velocity: Tensor, nu: Tensor) -> Tensor:
        return rate[..., None, :, None] * ground.displacement(offset, nu)

    def pushed(thrust: Tensor, offset: Tensor, velocity: Tensor, nu: Tensor) -> Tensor:
        return tangential_displacement_rate(offset, velocity, nu, thrust[..., None, :, :])

    def jerked(rate: Tensor, offset: Tensor, velocity: Tensor, nu: Tensor) -> Tensor:
        return tangential_displacement(offset, nu, rate[..., None, :, :])

    every = (load.share_rate, bounced), (load.thrust, pushed), (load.thrust_rate, jerked)
    return [(force, moved) for force, moved in every if force is not None]


def offsets(point: Tensor, wheels: Tensor) -> Tensor:
    """Points [..., 3], z down, minus wheels [..., wheel, 2] on the road: [..., wheel, 3], m.

    Components and wheels are outermost in memory, so that operations, sums over wheels above all, run along long rows,
    several times as fast.
    """
    at = wheels.movedim((-1, -2), (0, 1))
    x, y = point[..., 0] - at[0], point[..., 1] - at[1]
    return torch.stack([x, y, point[..., 2].expand(x.shape)]).movedim((0, 1), (-1, -2))
