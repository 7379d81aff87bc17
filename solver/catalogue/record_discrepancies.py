"""Discrepancy models of the interrogator: filters, delays, echoes, gain, distortion."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from solver.catalogue.no_derivative import NoDerivative
from solver.catalogue.sieve import SOURCE
from solver.effect import Discrepancy, Parameter, Plain, Surroundings, effect
from solver.interrogator.interrogator import Interrogator

Values = Mapping[str, Tensor]
#: Distances of what mixes, samples or channels.
TAPS = (1, 2, 4)
#: For how long a channel may remember how loud it was, s.
MEMORIES = (0.5, 2.0)


@effect(
    "generic_time_filter",
    "interrogator",
    [Parameter(f"{way}_{lag}", "1", 0.2) for way in ("late", "early") for lag in TAPS],
    physics="Each sample mixes with the samples before and after it.",
    plain=Plain("Unknown filter in time"),
    source=SOURCE,
    families=("blur", "lag", "even"),
    discrepancy=Discrepancy(),
)
def generic_time_filter(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Finite impulse response of a few taps."""

    def transfer(s: Tensor) -> Tensor:
        step = s / survey.sampling_rate
        shares = [p[f"late_{lag}"] * torch.exp(-lag * step) + p[f"early_{lag}"] * torch.exp(lag * step) for lag in TAPS]
        return 1 + torch.stack(shares).sum(0)

    return interrogator.filtered(transfer)


@effect(
    "generic_delay",
    "interrogator",
    [Parameter("delay", "s", 0.1, scope="fiber")],
    physics="Channels are read at times that drift smoothly along the fiber.",
    plain=Plain("Unknown delays of channels"),
    source=SOURCE,
    families=("lag",),
    discrepancy=Discrepancy(),
)
def generic_delay(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Phase that grows with frequency, channel by channel."""
    return interrogator.filtered(lambda s: torch.exp(-s[:, None] * p["delay"]))


@effect(
    "generic_echo",
    "interrogator",
    [
        Parameter("share", "1", 0.1, lower=-1, upper=1),
        Parameter("shift", "m", 1.0, grid=(-30.0, -20.0, -12.0, 12.0, 20.0, 30.0)),
    ],
    physics="Channels record a share of the signal of others, a constant distance along the fiber.",
    plain=Plain("Unknown echo along the fiber"),
    source=SOURCE,
    discrepancy=Discrepancy(mixes=True),
)
def generic_echo(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Share of the strain at distance + shift, linear between channels."""
    s = survey.distance
    apart = (s[None, :] - s[:, None] - p["shift"]).abs() / survey.channel_spacing
    return interrogator.mixed(torch.eye(len(s), dtype=s.dtype) + p["share"] * (1 - apart).clamp_min(0))


@effect(
    "generic_neighbors",
    "interrogator",
    [Parameter(f"{way}_{lag}", "1", 0.2) for way in ("before", "after") for lag in TAPS],
    physics="Each channel mixes with the channels before and after it.",
    plain=Plain("Unknown mix of channels"),
    source=SOURCE,
    families=("blur",),
    discrepancy=Discrepancy(mixes=True),
)
def generic_neighbors(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Finite impulse response of a few taps along the fiber."""
    one = torch.ones_like(survey.distance)
    matrix = torch.diag(one)
    for lag in TAPS:
        step = torch.diag(one[lag:], lag)
        matrix = matrix + p[f"before_{lag}"] * step.T + p[f"after_{lag}"] * step
    return interrogator.mixed(matrix)


@effect(
    "generic_gain",
    "interrogator",
    [Parameter("change", "1", 0.2, scope="time")],
    physics="The gain of all channels changes smoothly in time.",
    plain=Plain("Unknown gain in time"),
    source=SOURCE,
    discrepancy=Discrepancy(levels=True),
)
def generic_gain(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Output times 1 + change."""
    return replace(interrogator, gain=interrogator.gain * (1 + p["change"]))


@effect(
    "generic_nonlinearity",
    "interrogator",
    [Parameter("quadratic", "1", 0.2), Parameter("odd", "1", 0.2), Parameter("cubic", "1", 0.2)],
    physics="The output is not linear in the strain rate.",
    plain=Plain("Unknown distortion"),
    source=SOURCE,
    discrepancy=Discrepancy(levels=True),
)
def generic_nonlinearity(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Polynomial of the strain rate over the largest of the record."""

    def bent(rate: Tensor) -> Tensor:
        x = rate / survey.largest
        return rate * (1 + p["quadratic"] * x + p["odd"] * x.abs() + p["cubic"] * x**2)

    return interrogator.through(bent)


class Loudness(NoDerivative):
    """Mean size of a map [..., sample, channel] before each sample, that fades over so many samples: no derivative."""

    @staticmethod
    def forward(rate: Tensor, samples: float) -> Tensor:
        """One-pole filter of the absolute values, sample by sample."""
        size = rate.abs().movedim(-2, 0).numpy()
        share = 1 - float(np.exp(-1 / samples))
        heard, last = np.empty_like(size), np.zeros_like(size[0])
        for row in range(len(size)):
            heard[row] = last
            last = last + share * (size[row] - last)
        return torch.from_numpy(heard).movedim(0, -2)


@effect(
    "generic_memory",
    "interrogator",
    [Parameter(f"after_{time:g}", "1", 0.5) for time in MEMORIES],
    physics="The gain of a channel depends on how loud it was before.",
    plain=Plain("Unknown memory of loud signals"),
    source=SOURCE,
    discrepancy=Discrepancy(levels=True),
)
def generic_memory(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Output times 1 + shares of what was heard before, over the largest strain rate of the record."""

    def remembered(rate: Tensor) -> Tensor:
        heard = (p[f"after_{time:g}"] * Loudness.apply(rate, time * survey.sampling_rate) for time in MEMORIES)
        return rate * (1 + sum(heard) / survey.largest)

    return interrogator.through(remembered)


EFFECTS = (
    generic_time_filter,
    generic_delay,
    generic_echo,
    generic_neighbors,
    generic_gain,
    generic_nonlinearity,
    generic_memory,
)
