"""Maps over lateral offset and depth: how wide the response is, and how much it tells."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.functional import jvp

from solver.load.wheel_layout import layout_of
from solver.start.coupling_curve import FARTHEST
from solver.start.straight_fiber import straight_strain_rate
from solver.start.wavelets import best_scale, wide_bank
from vision.contract import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ResponseMaps:
    """Width and sensitivity of the response of one vehicle class over lateral offset and depth.

    With f(x) the response along the fiber (`straight_strain_rate`) and |f| its norm over x, sensitivity to p is
    |df/dp| / |f|: the share by which the response changes per unit of p. A vehicle's weight is not known, so only the
    part of df/dp across f tells p: `told` is |df/dp - f (f . df/dp) / |f|^2| / |f|.

    Parameters
    ----------
    vehicle_class : name
    offset : [offset], m
    depth : [depth], m
    width : [depth, offset], m; scale of the derivative-of-Ricker wavelet that matches best
    strength : [depth, offset], largest strain rate at 1 m/s per unit F / (4 pi G), 1/(m^2 s)
    sensitivity, told : by name "y" (1/m of offset), "z" (1/m of depth), "nu" (per unit of Poisson ratio),
        [depth, offset]
    """

    vehicle_class: str
    offset: Array
    depth: Array
    width: Array
    strength: Array
    sensitivity: dict[str, Array]
    told: dict[str, Array]

    def draw(self) -> "Figure":
        """Six pictures: width, strength, and what the response tells of offset, depth and Poisson ratio.

        >>> figure = response_maps(np.linspace(0, 12, 9), np.linspace(0.4, 2, 5)).draw()
        >>> len(figure.axes)
        12
        """
        from solver.start.response_figure import draw_maps

        return draw_maps(self)


def response_maps(
    offset: Array,
    depth: Array,
    vehicle_class: str = "car",
    *,
    gauge_length: float = 10.0,
    poisson_ratio: float = 0.25,
) -> ResponseMaps:
    """Compute `ResponseMaps` on a grid with autodiff.

    Parameters
    ----------
    offset : lateral distance from the vehicle's middle [offset], m
    depth : of the fiber [depth], m, positive
    vehicle_class : its wheel layout is taken; an unknown class is a point load
    gauge_length : m
    poisson_ratio : of the ground

    Raises
    ------
    InputError
        If a depth is not positive.

    Examples
    --------
    >>> maps = response_maps(np.array([4.0, 8.0]), np.array([0.9]), "vehicle")
    >>> maps.width.round(1).tolist(), maps.told["y"].round(2).tolist()
    ([[6.6, 8.2]], [[0.06, 0.08]])
    """
    if not (np.asarray(depth) > 0).all():
        raise InputError("depth: the fiber is under the ground; give depths above 0 m")
    wide = np.broadcast_to(np.asarray(offset, float), (len(depth), len(offset)))
    deep = np.broadcast_to(np.asarray(depth, float)[:, None], wide.shape)
    place = {"y": wide, "z": deep, "nu": np.full(wide.shape, poisson_ratio)}
    at = {name: torch.from_numpy(value.copy()) for name, value in place.items()}
    scales, places, wavelets = wide_bank(gauge_length, max(FARTHEST, float(np.abs(wide).max())))
    along, layout = torch.from_numpy(places), layout_of(vehicle_class)

    def response(y: Tensor, z: Tensor, nu: Tensor) -> Tensor:
        return straight_strain_rate(y, z, along, nu, layout, gauge_length)

    rate = response(**at)
    norm = rate.norm(dim=-1)
    sensitivity, told = {}, {}
    for name in at:
        # Each response depends on its own cell only, so one product gives the derivatives of all cells.
        _, slope = jvp(lambda value, name=name: response(**at | {name: value}), at[name], torch.ones_like(norm))
        across = slope - rate * ((rate * slope).sum(-1) / norm**2)[..., None]
        sensitivity[name] = (slope.norm(dim=-1) / norm).numpy()
        told[name] = (across.norm(dim=-1) / norm).numpy()
    width = best_scale(np.abs(rate.numpy() @ wavelets), scales)
    strength = rate.abs().amax(-1).numpy()
    return ResponseMaps(vehicle_class, np.asarray(offset), np.asarray(depth), width, strength, sensitivity, told)
