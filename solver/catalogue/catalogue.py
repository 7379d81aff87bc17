"""All effects that are known, the users' own among them."""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import TypeVar

from solver.cable import cable_effects as cable
from solver.catalogue import discrepancy_models as generic
from solver.effect import Effect
from solver.ground import ground_effects as ground
from solver.interrogator import interrogator_effects as interrogator
from solver.load import load_effects as load
from solver.processing import processing_effects as processing
from solver.trajectory import trajectory_effects as trajectory
from vision.contract import InputError

Known = TypeVar("Known")

STAGE_MODULES = (trajectory, load, ground, cable, interrogator, processing, generic)

#: Effects that surveys often cannot tell apart: one is not named without the others unless the survey separates them.
FAMILIES: dict[str, tuple[str, ...]] = {
    "blur": (
        "wheel_layout",
        "pulse_width",
        "shear_lag",
        "time_averaging",
        "layered_ground",
        "gibson_soil",
        "pavement",
        "lowpass",
        "lowpass_zero_phase",
        "moving_load",
    ),
    "lag": ("clock_offset", "track_bias", "time_averaging", "kelvin_voigt_lag", "front_share", "lowpass"),
    "even": ("grade_drag", "maxwell_flow", "highpass", "viscoelastic_lag"),
    "gain": ("stiffness_contrast", "poisson_gradient", "channel_coupling"),
    "place": ("slack_spool", "channel_wander", "track_bend"),
    "depth": ("poisson_ratio", "camber"),
    "rigid": ("track_offset", "track_rotation", "track_scale", "channel_stretch"),
    # Tracks bent evenly, and the route along with them, are longer on one side of the road than on the other.
    "curve": ("track_bend", "track_scale"),
}

#: Discrepancy models that mix channels, whether in the instrument or after it.
MIXING = ("generic_echo", "generic_neighbors")
#: Discrepancy models that change how strongly all channels are read, whether in the instrument or after it.
GAINS = ("generic_gain", "generic_nonlinearity")
#: Discrepancy models that are put in at one stage for what acts at another.
MEANT_FOR = {"generic_twin": "cable"}
#: Families of which a discrepancy model for the unknown takes up what the catalogue's laws leave.
DISCREPANCY_FAMILIES = {
    "generic_track": ("place",),
    "generic_road": ("gain",),
    "generic_train": ("blur",),
    "generic_kernel": ("blur",),
    "generic_neighbors": ("blur",),
    "generic_time_filter": ("blur", "lag", "even"),
    "generic_delay": ("lag",),
    "generic_shift": ("lag", "rigid"),
}


@dataclass(frozen=True)
class FaultKind:
    """What may be wrong with a survey and is no change to a stage: it is found and mended in the survey itself.

    Parameters
    ----------
    name, stage, physics, source : as of an effect
    unit : of its size
    plausible : smallest and largest usual size
    """

    name: str
    stage: str
    physics: str
    source: str
    unit: str
    plausible: tuple[float, float]


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
        ),
        FaultKind(
            "cycle_skips",
            "interrogator",
            "The unwrapped phase jumped by whole turns at some samples; they are left out of the fit.",
            "Itoh 1982, Appl. Opt. 21, 2470: unwrapping fails where the phase moves by more than pi a sample.",
            "1",
            (1e-4, 1e-2),
        ),
        FaultKind(
            "faded_channels",
            "interrogator",
            "Single channels hear next to nothing of what their neighbors do; they are left out of the fit.",
            "Fading of Rayleigh backscatter: Healey 1984, Electron. Lett. 20, 30.",
            "1",
            (1e-2, 0.2),
        ),
    )
}


@cache
def built_in() -> dict[str, Effect]:
    """Effects of the catalogue by name, in the order of the stages; generic ones last."""
    return {one.name: one for module in STAGE_MODULES for one in module.EFFECTS}


def families_of(name: str) -> tuple[str, ...]:
    """Names of the families an effect belongs to.

    >>> families_of("camber")
    ('depth',)
    """
    return tuple(family for family, members in FAMILIES.items() if name in members)


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
