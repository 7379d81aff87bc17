"""Response of gauges to loads: the ground's velocity at each gauge's points, weighted and summed."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.ground.boussinesq import plain_values
from solver.ground.compiled import compiled
from solver.ground.force_motion import forces_response
from solver.ground.ground import Ground
from solver.ground.ground_law import Law, Waves
from solver.ground.one_pass import law_response, waves_response
from solver.ground.tangential import tangential_displacement, tangential_displacement_rate
from solver.ground.wheel_motion import gauge_response
from solver.load.load import Load

Array = NDArray[np.float64]
#: From a force, offsets, velocity of the load and Poisson's ratio to the ground's velocity.
Moved = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
#: Share of each wheel, None for 1, and velocity of the ground under it, see `motions`.
Part = tuple[Tensor | None, Tensor]


def strain_rates(load: Load, ground: Ground, points: Tensor, weights: Tensor, ratio: Tensor) -> Tensor:
    """Strain rate [row, channel] of gauges, per unit amplitude: the sum of weight . velocity of the ground.

    Parameters
    ----------
    points, weights : [..., channel, point, 3], m and 1/m, see `solver.signal_path.gauges.Gauges`
    ratio : Poisson's; scalar or [..., channel, point]
    """
    static, sent, law, driven = None, None, ground.response, load.trajectory
    at = points, weights, load.position, load.share, driven.velocity
    if law is None:
        static = gauge_response(*at, ratio)
    elif isinstance(law, Law):
        static = law_response(law, *at, ratio)
    if isinstance(ground.radiation, Waves) and (sent := waves_response(ground.radiation, *at, driven.time)) is not None:
        ground = replace(ground, radiation=None)
    forced, left = of_forces(load, ground, points, weights, ratio)
    known = [one for one in (static, sent, forced) if one is not None]
    parts = motions(left, ground, points, ratio, static is None)
    if not parts:
        return sum(known[1:], known[0])
    if plain_values(weights, *(one for part in parts for one in part if one is not None)) is None:
        rest = (weights * total_motion(parts)).sum((-1, -2))
    else:
        rest = torch.from_numpy(gauge_sums(weights, parts))
    return sum(known, rest)


def of_forces(load: Load, ground: Ground, points: Tensor, weights: Tensor, ratio: Tensor) -> tuple[Tensor | None, Load]:
    """Strain rate [row, channel] by what pushes and changes, in one pass where it can be, and the load less that.

    Arguments as of `strain_rates`. Pushes act on the homogeneous half-space, and so do changes without a law of theirs.
    """
    rate = load.share_rate if ground.settlement is None else None
    if rate is None and load.thrust is None and load.thrust_rate is None:
        return None, load
    none = torch.zeros_like(load.position[:, :1])
    thrust, faster = (none if one is None else one for one in (load.thrust, load.thrust_rate))
    bounced = none[..., 0] if rate is None else rate
    velocity = load.trajectory.velocity
    found = forces_response(points, weights, load.position, bounced, thrust, faster, velocity, ratio)
    if found is None:
        return None, load
    left = replace(load, thrust=None, thrust_rate=None, share_rate=None if rate is not None else load.share_rate)
    return found, left


def gauge_sums(weights: Tensor, parts: Sequence[Part]) -> Array:
    """Sum [row, channel] of weight . velocity of the ground, in one pass over memory; `parts` as of `motions`.

    `weights` is [..., channel, point, 3].
    """
    whole = weights if weights.ndim == 4 else weights[None]
    shape = np.broadcast_shapes(whole[..., None, :].shape, *(motion.shape for _, motion in parts))
    out = np.zeros(shape[:2])
    for share, motion in parts:
        shares = torch.ones(1, 1, shape[3], dtype=torch.float64) if share is None else share
        outermost = motion.expand(shape).movedim(-1, 0)
        add_gauges(whole.contiguous().numpy(), shares.contiguous().numpy(), outermost.contiguous().numpy(), out)
    return out


def total_motion(parts: Sequence[Part]) -> Tensor:
    """Velocity of the ground [row, channel, point, 3] under all wheels; `parts` as of `motions`."""
    moved = [motion if share is None else share[..., None, :, None] * motion for share, motion in parts]
    return sum(moved[1:], moved[0]).sum(-2)


@partial(compiled, fastmath=True)
def add_gauges(weights: Array, share: Array, motion: Array, out: Array) -> None:
    """Add a part of `gauge_sums` to `out` [row, channel].

    Parameters
    ----------
    weights : [1 or row, channel, point, 3]
    share : [1 or row, 1 or channel, wheel]
    motion : [3, row, channel, point, wheel]
    """
    rows, channels, points, wheels = motion.shape[1:]
    for row in range(rows):
        by, of = weights[min(row, len(weights) - 1)], share[min(row, len(share) - 1)]
        for channel in range(channels):
            shares, total = of[min(channel, len(of) - 1)], 0.0
            for p in range(points):
                wx, wy, wz = by[channel, p]
                x, y, z = motion[0, row, channel, p], motion[1, row, channel, p], motion[2, row, channel, p]
                for wheel in range(wheels):
                    total += shares[wheel] * (wx * x[wheel] + wy * y[wheel] + wz * z[wheel])
            out[row, channel] += total


def motions(load: Load, ground: Ground, point: Tensor, poisson_ratio: Tensor, static: bool = True) -> list[Part]:
    """Velocity of the ground under each wheel, per unit amplitude, in parts to be summed.

    Parameters
    ----------
    point : [..., channel, point, 3], m
    poisson_ratio : scalar or [..., channel, point]
    static : include the response to the constant weight of the vehicles

    Returns
    -------
    share [row, 1 or channel, wheel] of what a part is to be multiplied by, None for 1, and that part
    [row, channel, point, wheel, 3]
    """
    others = ground.radiation, load.share_rate, load.thrust, load.thrust_rate
    if not static and all(one is None for one in others):
        return []
    parts = list[Part]()
    offset = offsets(point, load.position[..., None, :, :])
    velocity = load.trajectory.velocity[..., None, None, :]
    nu = poisson_ratio[..., None] if poisson_ratio.ndim else poisson_ratio
    if static:
        parts.append((load.share, ground.displacement_rate(offset, velocity, nu)))
    if ground.radiation is not None:
        parts.append((load.share, ground.radiation(offset, velocity, load.trajectory.time[..., None, None])))
    for force, moved in forces(load, ground):
        # Of a force that is nothing yet, only what more of it would do is ever asked for.
        at = (offset, velocity, nu) if bool(force.any()) else (offset.detach(), velocity.detach(), nu.detach())
        parts.append((None, moved(force, *at)))
    return parts


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
