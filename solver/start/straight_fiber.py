"""Strain rate of a straight level fiber beside a vehicle that drives along it."""

import torch
from torch import Tensor

from solver.ground.boussinesq import displacement_rate
from solver.interrogator.gauge import gauge_strain_rate
from solver.load.wheel_layout import WheelLayout, wheel_loads


def straight_strain_rate(
    offset: Tensor, depth: Tensor, along: Tensor, poisson_ratio: Tensor, layout: WheelLayout, gauge_length: float
) -> Tensor:
    """Strain rate of a straight level fiber beside a vehicle that drives along it at 1 m/s; differentiable.

    e'(x; Y, Z, nu) = sum over wheels w of share_w [u'_x(x + L/2 - x_w) - u'_x(x - L/2 - x_w)] / L,
    with u' the rate of Boussinesq's displacement at lateral offset Y - y_w and
    depth Z. Another speed v gives v times that, and a vehicle going the other way its negative.

    Parameters
    ----------
    offset : lateral distance from the vehicle's middle to the fiber [...], m
    depth : of the fiber [...], m
    along : place along the fiber, from the vehicle's middle [place], m
    poisson_ratio : of the ground [...]
    layout : wheels; `POINT` of `solver.load.wheel_layout` for a point load, `LAYOUTS["car"]` for four wheels
    gauge_length : m

    Returns
    -------
    [..., place], per unit F / (4 pi G): 1/(m^2 s)

    Examples
    --------
    >>> from solver.load.wheel_layout import POINT
    >>> one = torch.ones((), dtype=torch.float64)
    >>> beside = torch.tensor([-5.0, 0.0, 5.0], dtype=torch.float64)
    >>> [round(v, 4) for v in straight_strain_rate(4 * one, 0.9 * one, beside, 0.25 * one, POINT, 10.0).tolist()]
    [0.0013, 0.0, -0.0013]
    """
    offset, depth, poisson_ratio = torch.broadcast_tensors(offset, depth, poisson_ratio)
    heading = offset.new_tensor([1.0, 0.0])
    size = (offset.new_tensor(value) for value in (layout.wheelbase, layout.track, layout.front_share))
    wheels, weights = wheel_loads(torch.zeros_like(heading), heading, *size)

    def axial_velocity(place: Tensor) -> Tensor:
        # [..., place, wheel]
        x = place[:, None] - wheels[:, 0]
        y = offset[..., None, None] - wheels[:, 1]
        away = torch.stack(torch.broadcast_tensors(x, y, depth[..., None, None]), -1)
        motion = displacement_rate(away, heading.expand(*away.shape[:-1], 2), poisson_ratio[..., None, None])
        return (weights * motion[..., 0]).sum(-1)

    half = gauge_length / 2
    return gauge_strain_rate(axial_velocity(along + half), axial_velocity(along - half), gauge_length)
