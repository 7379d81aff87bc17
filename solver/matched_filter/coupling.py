"""Coupling curve: how wide and how strong a passing vehicle appears in a straight fiber beside its lane."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch

from solver.load import layout_of
from solver.matched_filter.wavelets import Array, bank, best_scale
from solver.model import Fiber, SignalPath, Traffic, Vehicles

FARTHEST = 20.0  # m; a fiber farther from the lane is beyond what a survey feels
STEP = 0.5  # m, of the tabulated offsets
JUMP = 0.1  # share by which the width may grow from one tabulated offset to the next


def straight_response(
    offset: Array, along: Array, vehicle_class: str, *, depth: float, gauge_length: float, poisson_ratio: float
) -> Array:
    """Strain rate of a straight level fiber beside a vehicle that drives along it at 1 m/s.

    Parameters
    ----------
    offset : lateral distance from the vehicle's middle to the fiber [offset], m
    along : distance ahead of the vehicle [place], m
    vehicle_class : its wheel layout is taken; an unknown class is a point load
    depth, gauge_length : m
    poisson_ratio : of the ground

    Returns
    -------
    [offset, place], per unit F / (4 pi G): 1/(m^2 s)

    >>> beside = np.array([-5.0, 0.0, 5.0])
    >>> rate = straight_response(np.array([4.0]), beside, "vehicle", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    >>> rate.round(4).tolist()
    [[0.0013, 0.0, -0.0013]]
    """
    count = len(offset)
    position = torch.from_numpy(np.stack([np.zeros(count), -np.asarray(offset, float)], axis=1))
    forward = torch.tensor([[1.0, 0.0]], dtype=torch.float64).expand(count, 2)
    every = torch.arange(count)
    traffic = Traffic(count, every, every, np.arange(count), position, forward, forward, torch.zeros(count, 2))

    def ends(shift: float) -> torch.Tensor:
        return torch.from_numpy(np.stack([along + shift, np.zeros(len(along)), np.full(len(along), depth)], axis=1))

    tangent = torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64).expand(len(along), 3)
    layout = layout_of(vehicle_class)
    values = (1.0, 0.0, 0.0, layout.wheelbase, layout.track, layout.front_share)
    vehicles = Vehicles(*(torch.full((count,), value, dtype=torch.float64) for value in values))
    fiber = Fiber(ends(gauge_length / 2), ends(-gauge_length / 2), tangent, tangent)
    rate = SignalPath(traffic, gauge_length).rows(fiber, vehicles, torch.tensor(poisson_ratio, dtype=torch.float64))
    return np.asarray(rate.numpy())


@dataclass(frozen=True)
class CouplingCurve:
    """Width and strength of the response against lateral offset, the paper's sigma(Y; Z).

    The width is the scale (m) of the derivative-of-Ricker wavelet that matches the response best; the distance between
    its two lobes is 1.484 times that. Nearer than `nearest` the response is no such wavelet and its width tells
    nothing: the fiber is as good as under the wheels. From there on the width grows with the offset.

    Parameters
    ----------
    offset : [offset], ascending from 0, m
    width : [offset], m; constant up to `nearest`, then ascending
    amplitude : [offset], largest strain rate of a vehicle at 1 m/s per unit F / (4 pi G), 1/(m^2 s)
    """

    offset: Array
    width: Array
    amplitude: Array

    @cached_property
    def nearest(self) -> float:
        """Smallest offset that a width can tell, m."""
        return float(self.offset[self.width == self.width[0]][-1])

    def width_at(self, offset: Array | float) -> Array:
        """Width [...], m, at lateral offsets [...], m, of either sign."""
        return np.asarray(np.interp(np.abs(offset), self.offset, self.width))

    def offset_of(self, width: Array | float) -> Array:
        """Lateral offset [...], m, of a fiber whose response has `width` [...], m.

        A width at or below the smallest gives `nearest`, for anything from 0 to that; one above the largest gives the
        end of the table, 20 m.

        >>> curve = coupling_curve("car", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
        >>> curve.offset_of(curve.width_at(np.array([5.0, -8.0]))).round(6).tolist()
        [5.0, 8.0]
        """
        rising = self.offset >= self.nearest
        return np.asarray(np.interp(width, self.width[rising], self.offset[rising]))


def rising_branch(width: Array) -> Array:
    """Widths [offset] with all before the last fall or jump flattened to what follows, so that they rise steadily.

    >>> rising_branch(np.array([9.0, 2.0, 7.0, 6.0, 6.5, 7.0])).tolist()
    [6.0, 6.0, 6.0, 6.0, 6.5, 7.0]
    >>> rising_branch(np.array([2.0, 2.1, 6.0, 6.2])).tolist()
    [6.0, 6.0, 6.0, 6.2]
    """
    step = np.diff(width)
    unsteady = np.flatnonzero((step <= 0) | (step > JUMP * width[:-1]))
    bottom = unsteady[-1] + 1 if len(unsteady) else 0
    return np.where(np.arange(len(width)) < bottom, width[bottom], width)


@lru_cache(maxsize=64)
def coupling_curve(vehicle_class: str, *, depth: float, gauge_length: float, poisson_ratio: float) -> CouplingCurve:
    """Tabulate the coupling curve of a vehicle class from the signal path.

    Parameters
    ----------
    vehicle_class : its wheel layout is taken; an unknown class is a point load
    depth, gauge_length : m
    poisson_ratio : of the ground

    >>> curve = coupling_curve("vehicle", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    >>> curve.nearest, float(curve.width_at(8.0).round(1))
    (3.0, 8.2)
    """
    offset = np.arange(0.0, FARTHEST + STEP, STEP)
    step = gauge_length / 20
    scales = np.linspace(3 * step, 0.3 * gauge_length + 0.8 * FARTHEST, 100)
    wavelets = bank(scales / step)
    along = step * np.arange(-(len(wavelets) // 2), len(wavelets) // 2 + 1, dtype=float)
    response = straight_response(
        offset, along, vehicle_class, depth=depth, gauge_length=gauge_length, poisson_ratio=poisson_ratio
    )
    width = best_scale(np.abs(response @ wavelets), scales)
    return CouplingCurve(offset, rising_branch(width), np.abs(response).max(1))
