"""All effects that are known, the users' own among them."""

from functools import cache

from solver.effects import cable, generic, ground, interrogator, load, processing, trajectory
from solver.effects.effect import Effect
from vision.contract import InputError

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
    "depth": ("poisson_ratio", "camber"),
    "rigid": ("track_offset", "track_rotation", "track_scale", "channel_stretch"),
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


def find(name: str, catalogue: dict[str, Effect]) -> Effect:
    """Look an effect up.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in catalogue:
        near = [other for other in catalogue if name[:4] in other] or list(catalogue)
        raise InputError(f"effect {name}: not known; did you mean {', '.join(near)}? `roadfiber effects` lists all")
    return catalogue[name]
