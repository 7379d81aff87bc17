"""Discrepancy models for the unknown: flexible changes of every stage that compete with the physical effects.

Where one of them explains the residual better than any effect of the catalogue, something acts there that the
catalogue lacks.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from solver.effect import Discrepancy, Parameter, Plain, Surroundings, effect
from solver.ground.ground import Ground
from solver.ground.ground_effects import TROUGH
from solver.interrogator.interrogator import Interrogator
from solver.load.load import Load
from solver.trajectory.trajectory import Trajectory

Values = Mapping[str, Tensor]
SOURCE = "Generic; sieve of smooth functions (Chen 2007, Handbook of Econometrics 6B, chapter 76)."

#: Scales of the distance from a wheel, and places before and behind a vehicle, m; lags, samples or channels.
SCALES, TRAIN, TAPS = (1.5, 4.0, 10.0), (5, 10, 18), (1, 2, 4)
#: Slacks of strain, in thousandths of what the largest rate adds in 1 s: a truck's strain reaches some hundreds.
SLACKS = (10, 20, 50, 100)
#: m aside at which a wave that follows a vehicle has lost a third.
ASIDE = 10.0


@effect(
    "generic_track",
    "trajectory",
    [Parameter("x", "m", 0.3, scope="road"), Parameter("y", "m", 0.3, scope="road")],
    physics="All vehicles are off their tracks, by a shift that changes smoothly along the road.",
    plain=Plain("Unknown shift of tracks"),
    source=SOURCE,
    families=("place",),
    discrepancy=Discrepancy(),
    shifts=True,
)
def generic_track(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """Positions plus a smooth function of x."""
    return replace(driven, position=driven.position + torch.stack([p["x"], p["y"]], -1))


@effect(
    "generic_shift",
    "trajectory",
    [Parameter("along", "m", 0.5, scope="pass"), Parameter("across", "m", 0.5, scope="pass")],
    physics="Each vehicle is off its track by a constant shift.",
    plain=Plain("Unknown shift of each vehicle"),
    source=SOURCE,
    families=("lag", "rigid"),
    discrepancy=Discrepancy(),
    shifts=True,
)
def generic_shift(driven: Trajectory, p: Values, survey: Surroundings) -> Trajectory:
    """One shift along and one across travel for each pass."""
    return driven.shifted(along=p["along"], across=p["across"])


@effect(
    "generic_load",
    "load",
    [Parameter("change", "1", 0.2, scope="track", rated=True)],
    physics="The load of each vehicle changes smoothly as it drives.",
    plain=Plain("Unknown change of weights"),
    source=SOURCE,
    discrepancy=Discrepancy(),
)
def generic_load(load: Load, p: Values, survey: Surroundings) -> Load:
    """Weight times 1 + change."""
    return load.modulated(1 + p["change"], p["change_rate"])


@effect(
    "generic_road",
    "load",
    [Parameter("change", "1", 0.2, scope="road", rated=True)],
    physics="The load of all vehicles changes in the same way along the road.",
    plain=Plain("Unknown change along the road"),
    source=SOURCE,
    families=("gain",),
    discrepancy=Discrepancy(),
)
def generic_road(load: Load, p: Values, survey: Surroundings) -> Load:
    """Weight times 1 + change."""
    return load.modulated(1 + p["change"], p["change_rate"])


@effect(
    "generic_train",
    "load",
    [Parameter(f"{way}_{reach}", "1", 0.2, scope="pass") for way in ("before", "behind") for reach in TRAIN],
    physics="Each vehicle also presses or pulls some meters ahead of it and behind it.",
    plain=Plain("Unknown load ahead or behind"),
    source=SOURCE,
    families=("blur",),
    discrepancy=Discrepancy(before_and_behind=True),
)
def generic_train(load: Load, p: Values, survey: Surroundings) -> Load:
    """More loads along travel, each a share of the vehicle's weight."""
    driven = load.trajectory
    reach = [sign * meters for sign in (1, -1) for meters in TRAIN]
    along = torch.tensor(reach, dtype=torch.float64)[:, None] * driven.heading[..., None, :]
    share = torch.stack([p[f"{way}_{meters}"] for way in ("before", "behind") for meters in TRAIN], -1)
    return load.joined(driven.position[..., None, :] + along, share)


@effect(
    "generic_twin",
    "load",
    [
        Parameter("share", "1", 0.2, lower=-3, upper=3),
        Parameter("aside", "m", 3.0, lower=-12, upper=12, grid=(-8.0, -5.0, 5.0, 8.0)),
    ],
    physics="A second signal is recorded, like that of another fiber some meters to one side.",
    plain=Plain("Unknown second source"),
    source=SOURCE,
    discrepancy=Discrepancy(stage="cable"),
)
def generic_twin(load: Load, p: Values, survey: Surroundings) -> Load:
    """A share of every wheel's load once more, aside: a fiber beside this one sees the road that far away."""
    across = torch.stack([torch.zeros_like(p["aside"]), p["aside"]], -1)
    return load.joined(load.position + across, p["share"] * load.share)


@effect(
    "generic_kernel",
    "ground",
    [
        *(Parameter(f"near_{scale:g}", "1", 0.2) for scale in SCALES),
        *(Parameter(f"ahead_{scale:g}", "1", 0.2) for scale in SCALES),
        *(Parameter(f"beside_{scale:g}", "1", 0.2) for scale in SCALES),
    ],
    physics="The ground's response falls off differently with distance, along the road and beside it.",
    plain=Plain("Unknown response of the ground"),
    source=SOURCE,
    families=("blur",),
    discrepancy=Discrepancy(),
)
def generic_kernel(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Response times one plus Gaussians of the distance from the wheel, even, odd along travel, and even across."""

    def response(offset: Tensor, velocity: Tensor, nu: Tensor | float) -> Tensor:
        base = ground.displacement_rate(offset, velocity, nu)
        speed = velocity.norm(dim=-1).clamp_min(1e-3)
        ahead = (offset[..., :2] * velocity).sum(-1) / speed
        square = (offset[..., :2] ** 2).sum(-1)
        factor = torch.ones_like(square)
        for scale in SCALES:
            bell = torch.exp(-square / (2 * scale**2))
            beside = 1 - ahead**2 / square.clamp_min(1e-6)
            even = p[f"near_{scale:g}"] + p[f"ahead_{scale:g}"] * ahead / scale + p[f"beside_{scale:g}"] * beside
            factor = factor + even * bell
        return base * factor[..., None]

    return replace(ground, response=response)


@effect(
    "generic_softening",
    "ground",
    [Parameter("softer", "1", 1.0), Parameter("uneven", "1", 1.0)],
    physics="The ground softens or stiffens where it is strained more.",
    plain=Plain("Unknown softening of the ground"),
    source=SOURCE,
    discrepancy=Discrepancy(),
)
def generic_softening(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Compliance that changes with the strain, either sign alike and not; in what the largest rate adds in 1 s."""

    def factor(strain: Tensor) -> Tensor:
        x = strain / survey.largest
        return 1 + p["softer"] * x.abs() + p["uneven"] * x

    return ground.yielding(factor)


class Engaged(torch.autograd.Function):
    """Share of a strain's change [..., sample, channel] that is left beyond some slack: 0 or 1 but where it turns.

    The play operator (Krasnosel'skii and Pokrovskii 1989, Systems with Hysteresis, section 2): what is pulled along
    stays where it is until the slack is taken up. It changes with the strain at single samples only: no derivative.
    """

    @staticmethod
    def forward(strain: Tensor, slack: float) -> Tensor:
        """Follow the strain sample by sample."""
        drive = strain.movedim(-2, 0).numpy()
        low, high, pulled = drive - slack, drive + slack, np.empty_like(drive)
        last = np.zeros_like(drive[0])
        for row in range(len(drive)):
            last = np.clip(last, low[row], high[row], out=pulled[row])
        change = np.diff(drive, axis=0, prepend=0.0)
        share = np.diff(pulled, axis=0, prepend=0.0) / np.where(change == 0, 1.0, change)
        return torch.from_numpy(share).movedim(0, -2)

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        """Nothing is kept."""

    @staticmethod
    def jvp(ctx: Any, strain: Tensor, slack: None) -> Tensor:
        """No derivative."""
        return torch.zeros_like(strain)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        """No derivative."""
        return torch.zeros_like(gradient), None


@effect(
    "generic_friction",
    "ground",
    [Parameter(f"slack_{slack}", "1", 0.2) for slack in SLACKS],
    physics="Friction holds strain back where it reverses, however slowly the ground is strained.",
    plain=Plain("Unknown friction in the ground"),
    source="Prandtl-Ishlinskii model of hysteresis: Krasnosel'skii and Pokrovskii 1989, Systems with Hysteresis.",
    discrepancy=Discrepancy(),
)
def generic_friction(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Strain plus shares of what it pulls along beyond some slacks (of what the largest rate adds in 1 s)."""

    def factor(strain: Tensor) -> Tensor:
        shares = (p[f"slack_{slack}"] * Engaged.apply(strain, 1e-3 * slack * survey.largest) for slack in SLACKS)
        return 1 + sum(shares)

    return ground.yielding(factor)


@effect(
    "generic_wave",
    "ground",
    [
        Parameter("sine", "1", 0.1, scope="pass"),
        Parameter("cosine", "1", 0.1, scope="pass"),
        Parameter("behind", "m", 4.0, lower=4, upper=40, grid=(9.0, 16.0, 23.0)),
        Parameter("wavelength", "m", 4.0, lower=5, upper=40, grid=(9.0, 15.0)),
    ],
    physics="A packet of waves follows each vehicle at a constant distance.",
    plain=Plain("Unknown waves"),
    source="Gabor 1946, J. Inst. Electr. Eng. 93, 429: the packet; steady in the vehicle's frame.",
    discrepancy=Discrepancy(),
)
def generic_wave(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Motion along travel, half a wavelength wide (sd); 1 strains the ground as the trough does nearby."""
    k = 2 * torch.pi / p["wavelength"]

    def radiation(offset: Tensor, velocity: Tensor, time: Tensor) -> Tensor:
        (x, y, _), (along, across) = offset.unbind(-1), velocity.unbind(-1)
        speed = (along**2 + across**2).sqrt().clamp_min(1e-3)
        along, across = along / speed, across / speed
        behind = -(x * along + y * across) - p["behind"]
        aside = (x * across - y * along) / ASIDE
        sine, cosine = (p[name].reshape(time.shape) for name in ("sine", "cosine"))
        wave = sine * torch.sin(k * behind) + cosine * torch.cos(k * behind)
        moved = speed / TROUGH**3 / k * torch.exp(-2 * (behind / p["wavelength"]) ** 2) * (1 + aside**2) ** -0.5 * wave
        return torch.stack([moved * along, moved * across, torch.zeros_like(moved)], -1)

    return replace(ground, radiation=radiation)


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


@effect(
    "generic_wake",
    "ground",
    [
        Parameter("share", "1", 0.2, lower=-3, upper=3),
        Parameter("delay", "s", 0.2, lower=0.2, upper=8, grid=(0.6, 1.2, 2.4, 4.0)),
    ],
    physics="Each vehicle is followed by a copy of its signal.",
    plain=Plain("Unknown followers of vehicles"),
    source=SOURCE,
    discrepancy=Discrepancy(),
)
def generic_wake(ground: Ground, p: Values, survey: Surroundings) -> Ground:
    """Response plus a share of it, later."""
    return ground.filtered(lambda s: 1 + p["share"] * torch.exp(-s * p["delay"]))


EFFECTS = (
    generic_track,
    generic_shift,
    generic_load,
    generic_road,
    generic_train,
    generic_twin,
    generic_kernel,
    generic_softening,
    generic_friction,
    generic_wave,
    generic_time_filter,
    generic_delay,
    generic_echo,
    generic_neighbors,
    generic_gain,
    generic_nonlinearity,
    generic_wake,
)
