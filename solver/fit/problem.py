"""What both fits are given: measured strain rate and its noise, passes, anchors, and what was known before."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from solver.anchors import Anchor
from solver.cable import Basis, GaugeEnds
from solver.fit.prior import Prior
from solver.model import SignalPath, Traffic
from solver.trajectory import Pass


@dataclass(frozen=True)
class Problem:
    """A survey ready to be fitted.

    Parameters
    ----------
    strain_rate : [sample, channel], measured, 1/s; NaN where there is none
    noise : [channel], standard deviation of the noise, 1/s
    channel : [channel], numbers of the fitted channels
    zero_distance : distance along the fiber of channel 0, m
    channel_spacing, gauge_length : m
    passes : vehicles; `traffic.samples` are the rows of the record in `strain_rate`
    anchors : known points of the fiber
    start : [channel, 3], rough route to begin from, m
    prior : what was known before
    """

    strain_rate: Tensor
    noise: Tensor
    channel: NDArray[np.int64]
    zero_distance: float
    channel_spacing: float
    gauge_length: float
    passes: Sequence[Pass]
    traffic: Traffic
    anchors: Sequence[Anchor]
    start: NDArray[np.float64]
    prior: Prior

    def distance_of(self, channel: ArrayLike) -> NDArray[np.float64]:
        """Distance along the fiber, m, of channel numbers."""
        return self.zero_distance + self.channel_spacing * np.asarray(channel, float)

    @property
    def distance(self) -> NDArray[np.float64]:
        """Distance [channel] of the fitted channels along the fiber, m."""
        return self.distance_of(self.channel)

    @property
    def anchor_distance(self) -> NDArray[np.float64]:
        """Distance [anchor] of the anchors along the fiber, m."""
        return self.distance_of([a.channel for a in self.anchors])

    @property
    def span(self) -> tuple[float, float]:
        """First and last distance that data or anchors touch: half a gauge (and a channel) beyond the channels, m."""
        reach = self.gauge_length / 2 + self.channel_spacing
        ends = np.concatenate([self.distance - reach, self.distance + reach, self.anchor_distance])
        return float(ends.min()), float(ends.max())

    @property
    def route_channel(self) -> NDArray[np.int64]:
        """Channel numbers within `span`, those without data between them included."""
        first, last = ((end - self.zero_distance) / self.channel_spacing for end in self.span)
        return np.arange(int(np.ceil(first)), int(np.floor(last)) + 1)

    @property
    def path(self) -> SignalPath:
        """The signal path of this survey's traffic."""
        return SignalPath(self.traffic, self.gauge_length)

    def ends(self, basis: Basis) -> GaugeEnds:
        """Gauge ends of the fitted channels."""
        return GaugeEnds.of(basis, self.distance, self.gauge_length)

    @property
    def measured(self) -> Tensor:
        """Where there is a measurement, [sample, channel]."""
        return torch.isfinite(self.strain_rate)
