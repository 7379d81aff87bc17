"""What both fits are given: measured strain rate with its noise, passes, anchors, and what was known before."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from solver.anchors import Anchor
from solver.cable import GaugeEnds, SplineBasis
from solver.model import SignalPath, Traffic
from solver.trajectory import Pass


@dataclass(frozen=True)
class Prior:
    """What is believed before the data speak; a standard deviation of 0 fixes a value.

    Parameters
    ----------
    depth : mean and standard deviation of the fiber's mean depth, m
    depth_slope : sd of the fiber's slope along the road
    curvature, depth_curvature : sd of horizontal and vertical curvature over one knot, 1/m
    stretch : sd of the route's length per meter of fiber
    poisson_ratio : mean and sd
    along : sd of a vehicle's load centroid and clock along travel, m
    across : sd of a whole track's lateral error, m
    """

    depth: tuple[float, float] = (0.9, 0.3)
    depth_slope: float = 0.03
    curvature: float = 0.02
    depth_curvature: float = 0.005
    stretch: float = 0.003
    poisson_ratio: tuple[float, float] = (0.25, 0.03)
    along: float = 0.5
    across: float = 0.05


@dataclass(frozen=True)
class Problem:
    """A survey ready to be fitted.

    Parameters
    ----------
    strain_rate : [sample, channel], measured, 1/s; NaN where there is none
    noise : [channel], standard deviation of the noise, 1/s
    channel, distance : [channel], number and distance along the fiber (m) of the fitted channels
    gauge_length : m
    passes : vehicles; `traffic.samples` are the rows of the record in `strain_rate`
    anchors : known points of the fiber
    start : [channel, 3], rough route to begin from, m
    prior : see `Prior`
    """

    strain_rate: Tensor
    noise: Tensor
    channel: NDArray[np.int64]
    distance: NDArray[np.float64]
    gauge_length: float
    passes: Sequence[Pass]
    traffic: Traffic
    anchors: Sequence[Anchor]
    anchor_distance: NDArray[np.float64]
    start: NDArray[np.float64]
    prior: Prior

    @property
    def path(self) -> SignalPath:
        """The signal path of this survey's traffic."""
        return SignalPath(self.traffic, self.gauge_length)

    def basis(self, spacing: float) -> SplineBasis:
        """Spline over every point that the data touch: the channels, half a gauge beyond, the anchors."""
        reach = self.gauge_length / 2 + 1.0
        ends = np.concatenate([self.distance - reach, self.distance + reach, self.anchor_distance])
        return SplineBasis(float(ends.min()), float(ends.max()), spacing)

    def ends(self, basis: SplineBasis) -> GaugeEnds:
        """Gauge ends of the fitted channels."""
        return GaugeEnds.of(basis, self.distance, self.gauge_length)

    @property
    def measured(self) -> Tensor:
        """Where there is a measurement, [sample, channel]."""
        return torch.isfinite(self.strain_rate)
