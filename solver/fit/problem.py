"""What both fits are given: measured strain rate and its noise, passes, anchors, and what was known before."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from solver.cable.fiber import Basis, Coil, GaugeEnds, SplineBasis
from solver.effect import Effect, Surroundings
from solver.fit.prior import Prior
from solver.noise.law import NoiseLaw
from solver.noise.whitening import Whitener
from solver.signal_path.extension import Extension, Scopes
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import Traffic
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass

#: Knot spacing of a route, m: roads and ducts bend slowly.
KNOT_SPACING = 10.0
#: Least distance of knots, m: ducts bend on a radius of 0.3 m at least (TIA-569).
CLOSEST = 0.3
#: How far the model is computed beyond the fitted channels where an effect mixes neighbors, m.
MARGIN = 12.0
#: Moments a second at which filters in time need the model: vehicles near the fiber change it faster than 5 Hz shows.
OFTEN = 20.0


@dataclass(frozen=True)
class Problem:
    """A survey ready to be fitted.

    Parameters
    ----------
    record : [row, channel], the whole record of the fitted channels, 1/s; NaN where there is none; in single precision
        where it was read so, of which fits take the samples that they need in double
    noise : [channel], standard deviation of the noise, 1/s
    channel : [channel], numbers of the fitted channels
    recorded : first and last channel number of the whole record
    zero_distance : distance along the fiber of channel 0, m
    channel_spacing, gauge_length : m
    passes : vehicles; `traffic.samples` are the rows of the record that are fitted
    anchors : known points of the fiber
    start : [channel, 3], rough route to begin from, m
    prior : what was known before
    sampling_rate : Hz
    law : of the noise in time and across channels
    effects : in the model, beyond the base
    signal_noise : how noise grows with the signal: its variance is times 1 + signal_noise (signal / noise)^2
    curved : whether strain is the integral along the fiber's path, see `SignalPath`
    knots : distances along the fiber, m, of knots of the route; what is between them has knots `KNOT_SPACING` apart
    coil : fiber that the matched filter takes to lie coiled; no model has it before it is added
    windows : row and time, s since the record's start, at which each window of the record after the first begins: where
        only some times were read, time jumps there
    """

    record: NDArray[Any]
    noise: Tensor
    channel: NDArray[np.int64]
    recorded: tuple[int, int]
    zero_distance: float
    channel_spacing: float
    gauge_length: float
    passes: Sequence[Pass]
    traffic: Traffic
    anchors: Sequence[Anchor]
    start: NDArray[np.float64]
    prior: Prior
    sampling_rate: float
    law: NoiseLaw = field(default_factory=NoiseLaw.white)
    effects: Sequence[Effect] = ()
    curved: bool = True
    signal_noise: float = 0.0
    knots: tuple[float, ...] = ()
    coil: Coil | None = None
    windows: tuple[tuple[int, float], ...] = ()

    def time_of(self, row: ArrayLike) -> NDArray[np.float64]:
        """Time of rows of the record, or of places between two of them, s since its start."""
        first, begin = np.array([(0, 0.0), *self.windows]).T
        window = np.searchsorted(first, row, side="right") - 1
        return np.asarray(begin[window] + (np.asarray(row, float) - first[window]) / self.sampling_rate)

    @cached_property
    def strain_rate(self) -> Tensor:
        """Measured strain rate [sample, channel] at the traffic's samples, 1/s."""
        samples = self.traffic.samples
        whole = samples[-1] - samples[0] == len(samples) - 1
        return torch.from_numpy(self.record[slice(samples[0], samples[-1] + 1) if whole else samples]).double()

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
    def basis(self) -> SplineBasis:
        """Of the route, over the span."""
        start, stop = self.span
        places = [start, *(one for one in self.knots if start + CLOSEST < one < stop - CLOSEST), stop]
        pieces = [SplineBasis.even(*ends, KNOT_SPACING).breaks[:-1] for ends in pairwise(places)]
        return SplineBasis.of(np.concatenate([*pieces, [stop]]))

    @property
    def route_channel(self) -> NDArray[np.int64]:
        """Numbers of the record's channels within `span`, and of those beyond it out to an anchor."""
        span = (np.array(self.span) - self.zero_distance) / self.channel_spacing
        held = [*self.recorded, *(one.channel for one in self.anchors)]
        return np.arange(int(np.ceil(max(span[0], min(held)))), int(np.floor(min(span[1], max(held)))) + 1)

    @property
    def base_parts(self) -> set[str]:
        """Of `solver.effect.BASE_PARTS`, those that the model has."""
        wheels = all(one.vehicle_class != "vehicle" for one in self.passes)
        return {part for part, there in (("wheels", wheels), ("bends", self.curved)) if there}

    @property
    def path(self) -> SignalPath:
        """The signal path of this survey's traffic, with its effects."""
        bare = SignalPath(self.traffic, self.gauge_length, curved=self.curved)
        return bare.with_effects(self.extension(self.effects))

    @cached_property
    def largest(self) -> float:
        """Largest strain rate of the record, single jumps left aside, 1/s."""
        size = np.abs(self.record[np.isfinite(self.record)])
        return float(np.quantile(size, 0.9998)) if len(size) else 0.0

    def extension(self, effects: Sequence[Effect]) -> Extension:
        """Effects, ready to be put into the signal path."""
        if not effects:
            return Extension()
        plain = self._extension(effects, self.distance, None, self.traffic)
        described = plain.described(plain.local(plain.numbers()), self.gauge_length)
        traffic = self.finer if described.in_time else self.traffic
        if not described.along_fiber:
            return plain if traffic is self.traffic else self._extension(effects, self.distance, None, traffic)
        # Neighbors matter: a gapless stretch of channels, and some beyond either end.
        margin = int(np.ceil(MARGIN / self.channel_spacing))
        every = np.arange(self.channel[0] - margin, self.channel[-1] + margin + 1)
        at = np.searchsorted(every, self.channel)
        gapless = at[-1] - at[0] == len(at) - 1
        chosen = slice(int(at[0]), int(at[-1]) + 1) if gapless else torch.from_numpy(at)
        return self._extension(effects, self.distance_of(every), chosen, traffic)

    @cached_property
    def finer(self) -> Traffic:
        """The traffic often enough that filters in time see what the record's samples are too far apart to show."""
        over = int(np.ceil(OFTEN / self.sampling_rate))
        return self.traffic if over <= 1 else self.traffic.finer(over)

    def _extension(
        self, effects: Sequence[Effect], distance: NDArray[np.float64], chosen: Tensor | slice | None, traffic: Traffic
    ) -> Extension:
        inside = self.traffic.position.numpy()
        around = Surroundings(
            distance=torch.from_numpy(distance),
            recorded=self.recorded[1] - self.recorded[0] + 1,
            gauge_length=self.gauge_length,
            channel_spacing=self.channel_spacing,
            sampling_rate=self.sampling_rate,
            passes=self.traffic.passes,
            middle=torch.from_numpy((inside.min(0) + inside.max(0)) / 2),
            largest=self.largest,
        )
        sampled = torch.from_numpy(self.time_of(traffic.samples / traffic.over))
        bare = Extension(time=sampled[traffic.sample_index])
        scopes = self._scopes.get((chosen is None, traffic.over))
        if scopes is None:
            road = float(self.start[:, 0].min()), float(self.start[:, 0].max())
            scopes = Scopes.of(traffic, torch.from_numpy(distance), bare.clock(traffic)[1], sampled, road)
            self._scopes[chosen is None, traffic.over] = scopes
        finer = None if traffic is self.traffic else traffic
        return Extension(effects, around, scopes, chosen, bare.time, finer)

    @cached_property
    def _scopes(self) -> dict[tuple[bool, int], Scopes]:
        """Spline weights of the effects' numbers, by whether channels beyond those measured count, and moments."""
        return {}

    @cached_property
    def whitener(self) -> Whitener:
        """Makes the noise of [sample, channel] white."""
        return Whitener(self.noise, self.traffic.samples, self.channel, self.law)

    def ends(self, basis: Basis) -> GaugeEnds:
        """Gauge ends of the fitted channels."""
        return GaugeEnds.of(basis, self.distance, self.gauge_length)

    @property
    def measured(self) -> Tensor:
        """Where there is a measurement, [sample, channel]."""
        return torch.isfinite(self.strain_rate)
