"""All effects that are known, the users' own among them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import TypeVar

from solver.cable import cable_effects as cable
from solver.catalogue import ground_discrepancies, record_discrepancies, vehicle_discrepancies
from solver.effect import Effect, Plain, percent
from solver.ground import ground_effects as ground
from solver.interrogator import interrogator_effects as interrogator
from solver.load import load_effects as load
from solver.processing import processing_effects as processing
from solver.trajectory import trajectory_effects as trajectory
from vision.contract import InputError

Known = TypeVar("Known")

STAGE_MODULES = (trajectory, load, ground, cable, interrogator, processing)
#: Discrepancy models for the unknown: flexible changes of every stage that compete with the physical effects. Where one
#: of them explains the residual better than any effect of the catalogue, something acts there that the catalogue lacks.
DISCREPANCY_MODULES = (vehicle_discrepancies, ground_discrepancies, record_discrepancies)


@dataclass(frozen=True)
class FaultKind:
    """What may be wrong with a survey and is not a change to a stage: it is found and mended in the survey itself.

    Parameters
    ----------
    name, stage, physics, source : as of an effect
    unit : of its size
    plausible : smallest and largest usual size
    plain : the same for people who do not know the field's terms
    """

    name: str
    stage: str
    physics: str
    source: str
    unit: str
    plausible: tuple[float, float]
    plain: Plain

    @property
    def title(self) -> str:
        """Two or three plain words."""
        return self.plain.title


FAULTS = {
    one.name: one
    for one in (
        FaultKind(
            "unseen_vehicle",
            "load",
            "A vehicle passed that the trajectories lack; its weight is relative to a typical one.",
            "Superposition of Boussinesq loads; searched with a matched filter (Turin 1960, IRE Trans. IT-6, 311).",
            "1",
            (0.1, 2.0),
            Plain(
                "Unseen vehicle",
                "A vehicle passed that is not in the tracks; it weighs {size} of a typical one.",
                size=percent,
                unit="%",
            ),
        ),
        FaultKind(
            "cycle_skips",
            "interrogator",
            "The unwrapped phase jumped by whole turns at some samples; they are left out of the fit.",
            "Itoh 1982, Appl. Opt. 21, 2470: unwrapping fails where the phase moves by more than pi a sample.",
            "1",
            (1e-4, 1e-2),
            Plain("Jumped samples", "{size} of the samples jumped by whole turns of the phase.", "", percent, "%"),
        ),
        FaultKind(
            "faded_channels",
            "interrogator",
            "Single channels are nearly silent where their neighbors record vehicles; they are left out of the fit.",
            "Fading of Rayleigh backscatter: Healey 1984, Electron. Lett. 20, 30.",
            "1",
            (1e-2, 0.2),
            Plain("Silent channels", "{size} of the channels are nearly silent.", "", percent, "%"),
        ),
    )
}


@cache
def built_in() -> dict[str, Effect]:
    """Effects of the catalogue by name, in the order of the stages; generic ones last."""
    return {one.name: one for module in STAGE_MODULES + DISCREPANCY_MODULES for one in module.EFFECTS}


def family(kind: str, effects: Iterable[Effect]) -> tuple[str, ...]:
    """Names of the physical effects of a family.

    >>> family("depth", built_in().values())
    ('camber', 'poisson_ratio')
    """
    return tuple(one.name for one in effects if kind in one.families and not one.generic)


def find(name: str, catalogue: Mapping[str, Known]) -> Known:
    """Look an effect, or what is known of it, up by its name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in catalogue:
        near = get_close_matches(name, catalogue, 3) or [other for other in catalogue if name[:4] in other][:3]
        hint = f"did you mean {', '.join(near)}? " if near else ""
        raise InputError(f"effect {name}: not known; {hint}`roadfiber effects` lists all")
    return catalogue[name]


def title_of(name: str) -> str:
    """Title of a built-in effect or of a fault, as pages show it; of a user's own effect its name.

    >>> title_of("gauge_length"), title_of("mine")
    ('Gauge length', 'mine')
    """
    return FAULTS[name].title if name in FAULTS else built_in()[name].title if name in built_in() else name
