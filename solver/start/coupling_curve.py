"""Coupling curve: how wide and how strong a passing vehicle appears in a straight fiber beside its lane."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch

from solver.load.wheel_layout import layout_of
from solver.start.straight_fiber import straight_strain_rate
from solver.start.wavelets import Array, best_scale, wide_bank
from vision.contract import InputError

FARTHEST = 20.0  # m; a fiber farther from the lane is beyond what a survey senses
STEP = 0.5  # m, of the tabulated offsets
JUMP = 0.1  # share by which the width may grow from one tabulated offset to the next


@dataclass(frozen=True)
class CouplingCurve:
    """Width and strength of the response against lateral offset, the paper's sigma(Y; Z).

    The width is the scale (m) of the derivative-of-Ricker wavelet that matches the response best; the distance between
    its two lobes is 1.484 times that. Nearer than `nearest` the response is no such wavelet and its width says nothing:
    the fiber is practically under the wheels. From there on the width grows with the offset.

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
    """Tabulate the coupling curve of a vehicle class, the paper's sigma(Y; Z), for any depth Z.

    sigma(Y; Z) = argmax over s of |integral of e'(x; Y, Z) psi((x - x_0) / s) / sqrt(s) dx|, with e' the response of
    a straight fiber (`straight_strain_rate`) and psi the derivative-of-Ricker wavelet.

    Parameters
    ----------
    vehicle_class : its wheel layout is taken, see `solver.load.wheel_layout.layout_of`
    depth, gauge_length : m
    poisson_ratio : of the ground

    Raises
    ------
    InputError
        If the depth or the gauge length is not positive.

    Examples
    --------
    >>> curve = coupling_curve("vehicle", depth=0.9, gauge_length=10.0, poisson_ratio=0.25)
    >>> curve.nearest, float(curve.width_at(8.0).round(1))
    (3.0, 8.2)
    """
    if not (depth > 0 and gauge_length > 0):
        raise InputError(f"coupling curve: depth {depth:g} m, gauge length {gauge_length:g} m; give both above 0")
    offset = np.arange(0.0, FARTHEST + STEP, STEP)
    scales, along, wavelets = wide_bank(gauge_length, FARTHEST)
    one = torch.ones((), dtype=torch.float64)
    rate = straight_strain_rate(
        torch.from_numpy(offset),
        depth * one,
        torch.from_numpy(along),
        poisson_ratio * one,
        layout_of(vehicle_class),
        gauge_length,
    ).numpy()
    width = best_scale(np.abs(rate @ wavelets), scales)
    return CouplingCurve(offset, rising_branch(width), np.abs(rate).max(1))
