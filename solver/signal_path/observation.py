"""Stages that act on a whole strain-rate map: filters in time and along the fiber, instrument limits, processing."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from torch import Tensor
from torch.nn.functional import pad

from solver.cable.cable import Cable
from solver.effect.transfers import FiberTransfer, TimeTransfer
from solver.ground.boussinesq import plain_values
from solver.ground.ground import Ground
from solver.interrogator.interrogator import Interrogator
from solver.noise.sample_runs import blocks_of
from solver.processing.processing import Processing

#: How far the exponential window of the numerical Laplace transform falls over a block, as a power of e.
DECAY = 8.0
#: Gaps between blocks of samples that are bridged by zeros, s, so that filters remember across them.
BRIDGE = 30.0
#: Of which the length of a transform is a multiple.
MULTIPLE = 32


def laplace_filtered(values: Tensor, transfers: Sequence[TimeTransfer], sampling_rate: float) -> Tensor:
    """Filter maps [..., sample, channel] in time; zero before the first sample.

    Parameters
    ----------
    transfers : of s = sigma + i omega [frequency], rad/s, to [frequency] or [frequency, channel]; one after the other

    Notes
    -----
    The Fourier transform of the values times exp(-sigma t) is their Laplace transform at s (Wedepohl and Wilcox 1973):
    poles at s = 0, such as an integrator's, do no harm, and wrap-around is damped to exp(-8).

    >>> time = torch.arange(100, dtype=torch.float64)[:, None] / 10
    >>> bell = torch.exp(-((time - 5) ** 2))
    >>> round(float(laplace_filtered(bell, [lambda s: 1 / s], 10.0)[-1]), 3)
    1.773
    """
    samples = values.shape[-2]
    # Transforms of other lengths, and along columns, take twice the time.
    size = MULTIPLE * next_fast_len(-(-(samples * 5 // 4 + 64) // MULTIPLE), real=True)
    time = torch.arange(samples, dtype=values.dtype) / sampling_rate
    sigma = DECAY * sampling_rate / size
    omega = 2 * np.pi * torch.fft.rfftfreq(size, 1 / sampling_rate, dtype=values.dtype)
    fall = torch.exp(-sigma * time)
    factor = together(transfers, torch.complex(torch.full_like(omega, sigma), omega))

    def filtered(x: Tensor, factor: Tensor) -> Tensor:
        spectrum = torch.fft.rfft(pad(x.T * fall, (0, size - samples))) * factor.T
        return (torch.fft.irfft(spectrum, size)[:, :samples] / fall).T

    def where_it_acts(x: Tensor) -> Tensor:
        if plain_values(x) is None:
            return filtered(x, factor)
        acts = x.any(0).nonzero()[:, 0]
        if not len(acts):
            return x
        # A knot of the route moves the channels near it alone.
        first, last = int(acts[0]), int(acts[-1]) + 1
        here = filtered(x[:, first:last], factor if factor.shape[1] == 1 else factor[:, first:last])
        return pad(here, (first, x.shape[1] - last))

    # One map at a time stays within the processor's cache: twice as fast.
    maps = values.flatten(0, -3) if values.ndim > 2 else values[None]
    found = [where_it_acts(x) for x in maps]
    if len(found) == 1:
        return found[0].reshape(values.shape)
    return torch.stack(found).reshape(values.shape) if found else values


def together(transfers: Sequence[TimeTransfer], s: Tensor) -> Tensor:
    """What filters make of each frequency, one after the other [frequency, 1 or channel].

    >>> s = torch.tensor([1j, 2j])
    >>> together([lambda s: 1 / s, lambda s: 2 * s], s)[:, 0]
    tensor([2.+0.j, 2.+0.j])
    """
    factor = torch.ones_like(s)[:, None]
    for transfer in transfers:
        one = transfer(s)
        factor = factor * (one if one.ndim > 1 else one[:, None])
    return factor


def fiber_matrix(transfers: Sequence[FiberTransfer], channels: int, spacing: float) -> Tensor:
    """Filter along the fiber as a matrix [channel, channel]: even continuation at both ends (cosine transform).

    >>> fiber_matrix([lambda k: torch.ones_like(k)], 5, 1.0).allclose(torch.eye(5, dtype=torch.float64))
    True
    """
    order = torch.arange(channels, dtype=torch.float64)
    waves = torch.cos(np.pi * order[:, None] * (order + 0.5) / channels) * (2 / channels) ** 0.5
    waves = torch.cat([waves[:1] / 2**0.5, waves[1:]])
    gain = torch.ones(channels, dtype=torch.float64)
    for transfer in transfers:
        gain = gain * transfer(np.pi * order / (channels * spacing))
    return waves.T @ (gain[:, None] * waves)


@dataclass(frozen=True)
class Description:
    """Ground, cable, interrogator and processing of one model.

    Parameters
    ----------
    ground, cable, interrogator, processing : see `solver.effect`
    sampling_rate : of the record, Hz
    channel_spacing : m
    chosen : which of the computed channels were measured: [channel], or a stretch of them; all where None
    over : how many moments per sample of the record maps are computed at
    """

    ground: Ground = field(default_factory=Ground)
    cable: Cable = field(default_factory=lambda: Cable(torch.zeros(0, dtype=torch.float64)))
    interrogator: Interrogator = field(default_factory=lambda: Interrogator(10.0))
    processing: Processing = field(default_factory=Processing)
    sampling_rate: float = 1.0
    channel_spacing: float = 1.0
    chosen: Tensor | slice | None = None
    over: int = 1

    @property
    def along_fiber(self) -> bool:
        """Whether a channel depends on its neighbors."""
        filters = self.cable.transfers or self.interrogator.fiber_transfers
        return bool(filters or self.cable.mixing or self.interrogator.mixing or self.processing.steps)

    @property
    def nonlinear(self) -> bool:
        """Whether the map is nonlinear in the load."""
        return bool(self.ground.tangent_compliances or self.interrogator.pointwise)

    @property
    def linear(self) -> "Description":
        """The same without its nonlinear parts."""
        ground, interrogator = replace(self.ground, tangent_compliances=()), replace(self.interrogator, pointwise=())
        return replace(self, ground=ground, interrogator=interrogator)

    @property
    def gauge(self) -> Tensor | float:
        """Length of each gauge along the route, scalar or [channel], m."""
        return self.interrogator.gauge_length * (1 + self.cable.slack)

    @property
    def in_rows(self) -> bool:
        """Whether single vehicles affect single channels otherwise than in the base model."""
        told = not isinstance(self.interrogator.gauge_length, Tensor)
        return not (told and self.ground.plain and self.cable.like_ground)

    @property
    def in_time(self) -> tuple[TimeTransfer, ...]:
        """All time filters."""
        return (*self.ground.transfers, *self.interrogator.transfers)

    def filtered_by(self, transfer: TimeTransfer) -> "Description":
        """The same with one filter in time in place of all others."""
        ground, interrogator = replace(self.ground, transfers=()), replace(self.interrogator, transfers=(transfer,))
        return replace(self, ground=ground, interrogator=interrogator)

    def observed(self, alone: Tensor, samples: NDArray[np.int64]) -> Tensor:
        """Maps [..., moment, computed channel] as observed, at the measured samples and channels."""
        out = alone
        if self.cable.transfers or self.interrogator.fiber_transfers:
            transfers = (*self.cable.transfers, *self.interrogator.fiber_transfers)
            out = out @ fiber_matrix(transfers, out.shape[-1], self.channel_spacing).T
        for matrix in (*self.cable.mixing, *self.interrogator.mixing):
            out = out @ matrix.T
        if isinstance(self.interrogator.gain, Tensor):
            out = out * self.interrogator.gain
        if self.in_time or self.processing.steps or self.nonlinear:
            out = self._in_time(out, samples)
        elif self.over > 1:
            out = out[..., torch.from_numpy(samples % self.over == 0), :]
        return out if self.chosen is None else out[..., self.chosen]

    def _in_time(self, values: Tensor, samples: NDArray[np.int64]) -> Tensor:
        """Apply all that needs neighboring samples, on gapless stretches that start at samples of the record."""
        parts, rate = [], self.sampling_rate * self.over
        for block in bridged(samples, round(BRIDGE * rate)):
            at = torch.from_numpy(samples[block] - samples[block.start])
            length, whole = int(at[-1]) + 1, values[..., block, :]
            if gaps := length > len(at):
                whole = values.new_zeros(*values.shape[:-2], length, values.shape[-1]).index_copy(-2, at, whole)
            if self.ground.tangent_compliances:
                strain = laplace_filtered(whole, [lambda s: 1 / s], rate)
                for compliance in self.ground.tangent_compliances:
                    whole = whole * compliance(strain)
            if self.in_time:
                whole = laplace_filtered(whole, self.in_time, rate)
            for function in self.interrogator.pointwise:
                whole = function(whole)
            whole = whole[..., :: self.over, :]
            for function in self.processing.steps:
                whole = function(whole)
            parts.append(whole.index_select(-2, at[at % self.over == 0] // self.over) if gaps else whole)
        return torch.cat(parts, -2) if len(parts) > 1 else parts[0]


def bridged(samples: NDArray[np.int64], gap: int) -> list[slice]:
    """Stretches [slice] of rows with no gap above `gap` between them.

    >>> bridged(np.array([0, 1, 5, 60]), 10)
    [slice(0, 3, None), slice(3, 4, None)]
    """
    stretches: list[slice] = []
    for block in blocks_of(samples):
        if stretches and samples[block.start] - samples[stretches[-1].stop - 1] <= gap:
            stretches[-1] = slice(stretches[-1].start, block.stop)
        else:
            stretches.append(block)
    return stretches


BASE = Description()
