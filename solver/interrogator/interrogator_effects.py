"""Interrogator stage: what the instrument makes of strain."""

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from solver.effect import Parameter, Plain, Surroundings, effect, percent, root
from solver.interrogator.interrogator import Interrogator

Values = Mapping[str, Tensor]


def sinc_of_square(x: Tensor) -> Tensor:
    """sin(u) / u by x = u^2 >= 0, differentiable at 0.

    >>> sinc_of_square(torch.tensor([0.0, 2.4674011002723395], dtype=torch.float64)).round(decimals=3)
    tensor([1.0000, 0.6370], dtype=torch.float64)
    """
    small = x < 1e-3
    u = torch.where(small, torch.ones_like(x), x).sqrt()
    return torch.where(small, 1 - x / 6 + x**2 / 120, torch.sin(u) / u)


def averaged(x: Tensor) -> Tensor:
    """(1 - exp(-x)) / x, differentiable at 0."""
    small = x.abs() < 1e-3
    safe = torch.where(small, torch.ones_like(x), x)
    return torch.where(small, 1 - x / 2 + x**2 / 6, (1 - torch.exp(-safe)) / safe)


@effect(
    "gauge_length",
    "interrogator",
    [Parameter("relative", "1", 0.1, lower=-0.6, upper=1.0)],
    physics="Strain is averaged over another length than the file says.",
    plain=Plain(
        "Gauge length",
        "The interrogator averages strain over {size}, not over {told}.",
        size=lambda v, s: s.gauge_length * (1 + v),
        unit="m",
    ),
    source="Dean, Cuny and Hartog 2017, Geophys. Prospect. 65, 184.",
    confounders="nothing, on data that no FK filter has touched",
    corrects="gauge",
)
def gauge_length(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """The true gauge length is (1 + relative) times the one told."""
    return replace(interrogator, gauge_length=interrogator.gauge_length * (1 + p["relative"]))


@effect(
    "pulse_width",
    "interrogator",
    [Parameter("width_squared", "m^2", 25.0, lower=0, upper=225)],
    physics="The light pulse blurs strain along the fiber, beside the gauge.",
    plain=Plain("Pulse width", "The light pulse blurs strain over {size} of fiber.", size=root, unit="m"),
    source="Dean, Cuny and Hartog 2017.",
    confounders="shear lag and wheels",
    families=("blur",),
)
def pulse_width(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Box average over the width."""
    return interrogator.blurred(lambda k: sinc_of_square(k**2 * p["width_squared"] / 4))


@effect(
    "time_averaging",
    "interrogator",
    [Parameter("interval", "s", 0.2, lower=0, upper=3)],
    physics="Each sample is the mean over the interval before it.",
    plain=Plain("Averaging in time", "Each sample is the mean over the {size} before it."),
    source="Oppenheim and Schafer 2010, section 4: decimation by block means.",
    confounders="a clock offset of half the interval",
    families=("blur", "lag"),
)
def time_averaging(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Box average over the interval before the stamp."""
    return interrogator.filtered(lambda s: averaged(s * p["interval"]))


@effect(
    "highpass",
    "interrogator",
    [Parameter("corner", "Hz", 0.03, lower=0, upper=2)],
    physics="The interrogator is AC-coupled: it loses slow changes.",
    plain=Plain("AC coupling", "The interrogator loses what changes more slowly than {size}."),
    source="First-order RC filter.",
    confounders="a Maxwell ground",
    families=("even",),
)
def highpass(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """First-order high pass."""
    return interrogator.filtered(lambda s: s / (s + 2 * torch.pi * p["corner"]))


@effect(
    "lowpass",
    "interrogator",
    [
        Parameter("share", "1", 1.0, lower=0, upper=1.3),
        Parameter("corner", "Hz", 0.1, lower=0.3, upper=5, grid=(0.7, 1.0, 1.4, 2.0)),
    ],
    physics="An anti-alias filter removed fast changes and delayed the rest.",
    plain=Plain(
        "Anti-alias filter",
        "A filter removed what is faster than {corner} and delayed the rest.",
        size=percent,
        unit="%",
    ),
    source="Butterworth 1930, of fourth order.",
    confounders="a layered ground; the delay from a clock offset",
    families=("blur", "lag"),
)
def lowpass(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Causal Butterworth filter; share 1 is the whole of it."""

    def transfer(s: Tensor) -> Tensor:
        x = s / (2 * torch.pi * p["corner"])
        return 1 / ((x**2 + 0.765367 * x + 1) * (x**2 + 1.847759 * x + 1))

    return interrogator.filtered(lambda s: 1 + p["share"] * (transfer(s) - 1))


@effect(
    "lowpass_zero_phase",
    "interrogator",
    [
        Parameter("share", "1", 1.0, lower=0, upper=1.3),
        Parameter("corner", "Hz", 0.1, lower=0.3, upper=5, grid=(0.7, 1.0, 1.4, 2.0)),
    ],
    physics="A zero-phase anti-alias filter removed fast changes.",
    plain=Plain(
        "Filter without delay", "A filter without delay removed what is faster than {corner}.", size=percent, unit="%"
    ),
    source="Butterworth 1930, of fourth order, forward and backward (Gustafsson 1996).",
    confounders="a layered ground and other blurs",
    families=("blur",),
)
def lowpass_zero_phase(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Squared modulus of the Butterworth filter."""

    def transfer(s: Tensor) -> Tensor:
        return 1 / (1 + (s.imag / (2 * torch.pi * p["corner"])) ** 8)

    return interrogator.filtered(lambda s: 1 + p["share"] * (transfer(s) - 1))


@effect(
    "saturation",
    "interrogator",
    [
        Parameter("share", "1", 1.0, lower=0, upper=1.2),
        Parameter("level", "1", 0.05, lower=0.1, upper=1.5, grid=(0.4, 0.6, 0.75, 0.9, 1.0)),
    ],
    physics="Strain rates beyond the instrument's range are clipped.",
    plain=Plain("Clipping", "Strain rates beyond {level} times the largest are clipped.", size=percent, unit="%"),
    source="Hartog 2017, An Introduction to Distributed Optical Fibre Sensors, section 6.",
    confounders="a gauge length that is wrong, in part",
)
def saturation(interrogator: Interrogator, p: Values, survey: Surroundings) -> Interrogator:
    """Clipping at a level relative to the largest strain rate of the record."""

    def clipped(rate: Tensor) -> Tensor:
        limit = p["level"] * survey.largest
        return rate + p["share"] * (torch.minimum(torch.maximum(rate, -limit), limit) - rate)

    return interrogator.through(clipped)


EFFECTS = (
    gauge_length,
    pulse_width,
    time_averaging,
    highpass,
    lowpass,
    lowpass_zero_phase,
    saturation,
)
