"""What a scenario may hold: an error says which entry is wrong and how to mend it."""

from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from solver.simulator.ducts import SHAPES
from solver.simulator.effects import EFFECTS, SETTINGS
from vision.contract import InputError

if TYPE_CHECKING:
    from solver.simulator.scenario import Scenario

NOISES = ("white", "colored", "street")
TRACK_NOISES = ("white", "camera")
LAID = ("winding", "as-built", *SHAPES)


def check(scenario: "Scenario") -> None:
    """Raise InputError at the first field that cannot be simulated."""
    for name in (
        "sampling_rate",
        "gauge_length",
        "channel_spacing",
        "poisson_ratio",
        "shear_modulus",
    ):
        _number(name, getattr(scenario, name))
    for name in ("frame_rate", "fix_sigma", "anchor_sigma", "x_azimuth", "track_wander", "track_wander_time"):
        _number(name, getattr(scenario, name))
    for name in ("noise_drift", "noise_freedom", "signal_noise", "side_street", "rounding", "spikes", "ahead"):
        _number(name, getattr(scenario, name))
    for name in ("passes", "snr_db"):
        value = getattr(scenario, name)
        (_range if isinstance(value, tuple) else _number)(name, value)
    for name in ("view", "lateral", "depth", "undulation", "depth_undulation", "speeds", "headway"):
        _range(name, getattr(scenario, name))
    for name in ("lanes", "origin"):
        _pair(name, getattr(scenario, name))
    for name in ("seed", "passes", "channels", "bad_channels", "gaps"):
        value = getattr(scenario, name)
        if any(type(item) is not int for item in (value if isinstance(value, tuple) else (value,))):
            raise InputError(f"{name}: must be a whole number, not {value!r}")
    for name in ("name", "side", "sampling", "start", "noise", "track_noise", "laid"):
        if not isinstance(getattr(scenario, name), str):
            raise InputError(f"{name}: must be text, in quotes")
    for name in ("classes", "effects"):
        _amounts(name, getattr(scenario, name))
    for good, message in _rules(scenario):
        if not good:
            raise InputError(message)


def _rules(s: "Scenario") -> list[tuple[bool, str]]:
    from solver.simulator.vehicle import FLEET

    positive = ("sampling_rate", "gauge_length", "channel_spacing", "shear_modulus", "frame_rate")
    return [
        *((getattr(s, name) > 0, f"{name}: must be above 0") for name in positive),
        (s.seed >= 0, "seed: must be 0 or above"),
        (np.min(s.passes) >= 1, "passes: at least 1"),
        (s.channels >= 2, "channels: at least 2"),
        (isinstance(s.gps, bool), "gps: true or false"),
        (-1 < s.poisson_ratio <= 0.5, "poisson_ratio: between -1 and 0.5"),
        (s.noise in NOISES, f"noise: one of {', '.join(NOISES)}, not {s.noise!r}"),
        (s.track_noise in TRACK_NOISES, f"track_noise: one of {', '.join(TRACK_NOISES)}, not {s.track_noise!r}"),
        (s.noise_freedom == 0 or s.noise_freedom > 2, "noise_freedom: above 2, or 0 for Gaussian noise"),
        *((getattr(s, name) >= 0, f"{name}: 0 or above") for name in ("noise_drift", "side_street", "rounding")),
        (s.signal_noise >= 0 and 0 <= s.spikes <= 1, "signal_noise, spikes: 0 or above; spikes at most 1"),
        (0 <= s.bad_channels < s.channels, "bad_channels: 0 or more, fewer than the channels"),
        (0 <= s.gaps <= 20, "gaps: 0 to 20"),
        (s.track_wander >= 0 and s.track_wander_time > 0, "track_wander: 0 m or above; track_wander_time: above 0 s"),
        (s.fix_sigma >= 0 and s.anchor_sigma >= 0, "fix_sigma, anchor_sigma: 0 or above, meters"),
        (s.view[1] - s.view[0] >= 20, "view: at least 20 m long"),
        (s.speeds[0] > 1 and s.speeds[1] <= 200, "speeds: between 1 and 200 km/h"),
        (s.headway[0] > 0, "headway: must be above 0 s"),
        (s.undulation[0] >= 0 and s.depth_undulation[0] >= 0, "undulation, depth_undulation: 0 or above"),
        (s.depth[0] - s.depth_undulation[1] > 0, "depth: the fiber must stay below the ground"),
        (s.side in ("left", "right", "either"), f"side: left, right or either, not {s.side!r}"),
        (s.laid in LAID, f"laid: one of {', '.join(LAID)}, not {s.laid!r}"),
        (0 <= s.ahead <= 1, "ahead: a share of the vehicles, 0 to 1"),
        (s.sampling in ("instant", "filtered"), f"sampling: instant or filtered, not {s.sampling!r}"),
        (-90 <= s.origin[0] <= 90 and -180 <= s.origin[1] <= 180, "origin: latitude, longitude in degrees"),
        (s.route is None or isinstance(s.route, tuple), "route: a list of points [x, y, z]"),
        (_is_time(s.start), f"start: ISO 8601 in UTC, such as 2025-08-11T06:00:00, not {s.start!r}"),
        (set(s.classes) <= set(FLEET), f"classes: known are {', '.join(FLEET)}"),
        (all(v >= 0 for v in s.classes.values()) and sum(s.classes.values()) > 0, "classes: shares above 0"),
        (set(s.effects) <= {*EFFECTS, *SETTINGS}, f"effects: known are {', '.join(EFFECTS)}, and their settings"),
        *(
            (s.effects.get(name, 0.0) >= 0, f"effects.{name}: must not be negative; {effect.meaning}")
            for name, effect in EFFECTS.items()
            if not effect.signed
        ),
        *_effect_rules(s),
    ]


def _effect_rules(s: "Scenario") -> list[tuple[bool, str]]:
    """Check the amounts that effects can be computed with; names must be known."""
    if not set(s.effects) <= {*EFFECTS, *SETTINGS}:
        return []
    ratio = s.poisson_ratio + s.effect("poisson_ratio")
    spread = abs(s.effect("poisson_gradient"))
    fastest = 1.1 * s.effect("moving_load") * s.speeds[1] / 3.6 / 15.0
    return [
        (s.effect("gauge_length") > -0.9, "effects.gauge_length: relative error, above -0.9"),
        (
            (not s.effect("poisson_ratio") and not spread) or 0 <= ratio - spread <= ratio + spread <= 0.5,
            "effects: the Poisson ratio must stay between 0 and 0.5",
        ),
        (
            fastest < 0.8,
            "effects.moving_load: the fastest vehicles would be as fast as surface waves; lower it or the speeds",
        ),
        (abs(s.effect("front_share")) < 0.3, "effects.front_share: within 0.3 of the class's"),
        (abs(s.effect("channel_stretch")) < 0.5, "effects.channel_stretch: relative, within 0.5"),
        (abs(s.effect("track_scale")) < 0.5, "effects.track_scale: relative, within 0.5"),
        *((s.effect(name) < 40, f"effects.{name}: the corner must be below 40 Hz") for name in ("lowpass", "highpass")),
    ]


def _is_time(text: str) -> bool:
    try:
        return datetime.fromisoformat(text).tzinfo is None
    except ValueError:
        return False


def _number(name: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{name}: must be a number, not {value!r}")


def _pair(name: str, value: Any) -> None:
    if not isinstance(value, tuple) or len(value) != 2:
        raise InputError(f"{name}: must be two numbers, not {value!r}")
    for item in value:
        _number(name, item)


def _range(name: str, value: Any) -> None:
    _pair(name, value)
    if value[0] > value[1]:
        raise InputError(f"{name}: the first number must not be above the second")


def _amounts(name: str, value: Any) -> None:
    if not isinstance(value, Mapping):
        raise InputError(f"{name}: must be a table of name = number")
    for key, amount in value.items():
        _number(f"{name}.{key}", amount)
