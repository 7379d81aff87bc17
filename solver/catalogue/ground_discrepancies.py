"""Discrepancy models of the ground: its response, softening, friction, waves."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from solver.catalogue.bells import Belled
from solver.catalogue.no_derivative import NoDerivative
from solver.catalogue.packets import Packet
from solver.catalogue.sieve import SOURCE
from solver.effect import Discrepancy, Parameter, Plain, Surroundings, effect
from solver.ground.ground import Ground

Values = Mapping[str, Tensor]
#: Scales of the distance from a wheel, m.
SCALES = (1.5, 4.0, 10.0)
#: Slacks of strain, in thousandths of what the largest rate adds in 1 s: a truck's strain reaches some hundreds.
SLACKS = (10, 20, 50, 100)


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
    numbers = ([p[f"{kind}_{scale:g}"] for scale in SCALES] for kind in ("near", "ahead", "beside"))
    return replace(ground, response=Belled(ground.response, SCALES, *numbers))


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


class Engaged(NoDerivative):
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
    return ground.radiating(Packet(p["sine"], p["cosine"], p["behind"], p["wavelength"]))


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
    generic_kernel,
    generic_softening,
    generic_friction,
    generic_wave,
    generic_wake,
)
