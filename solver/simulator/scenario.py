"""What to simulate: one dataclass, read from a TOML file or taken by a built-in name."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from solver.simulator.effects import EFFECTS, SETTINGS, amount_of, effect_rng
from vision.contract import InputError, read_toml

NOISES = ("white", "colored", "street")
TRACK_NOISES = ("white", "camera")


@dataclass(frozen=True)
class Scenario:
    """A survey to simulate. Where a range (low, high) is given, the seed draws a value from it.

    Attributes
    ----------
    name : of the survey
    seed : the same seed gives the same survey, bit by bit
    passes : vehicles that drive by; a number or a range
    snr_db : 10 log10(mean signal^2 / noise variance) over the maps of all passes (channels and times in view);
        a number or a range
    noise : "white"; "colored", a fixed mixture of 1/f and common noise; "street", such a mixture drawn by the seed
        (common to all channels 0 to 20 % of the variance, 1/f 5 to 35 %, channels unequal by 10 to 30 %)
    signal_noise : sd of noise that grows with the signal, relative to it
    bad_channels : that record nothing but loud noise
    spikes : share of samples with a jump of 8 to 40 sds of the noise
    gaps : stretches of 1 to 4 s that are missing
    sampling : "instant", strain rate as it is at each sample; "filtered", strain at 100 Hz, differenced,
        low-passed at 0.8 of Nyquist without delay and decimated
    sampling_rate : Hz, of the file
    gauge_length, channel_spacing : m
    channels : along the street route; a route of points has as many as fit
    poisson_ratio : of the ground
    shear_modulus : Pa
    view : m; stretch of x that the camera sees
    lanes : m; mean y of the lane driven along +x and of the one driven against it
    lateral : m; distance of the fiber from the nearer lane's middle
    side : "right" or "left" of the lanes seen along +x, or "either"
    depth : m; mean over the run
    undulation, depth_undulation : m; largest excursion from the mean
    route : points [x, y, z], m, of a spline, in place of the street route
    speeds : km/h
    headway : s between two passes
    classes : name -> share of the traffic
    frame_rate : fixes per second
    fix_sigma, anchor_sigma : m
    track_noise : of the fixes: "white"; or "camera", correlated as by a tracker: the mean of three fixes
    track_wander, track_wander_time : m, sd of a slow error of each track besides, and its correlation time, s
    gps : trajectories in latitude and longitude
    origin, x_azimuth : the local frame, degrees
    start : of the record, ISO 8601, UTC
    effects : name -> amount, see `EFFECTS`; secondary settings are named after their effect, such as
        `viscoelastic_lag_tau`, and drawn by the seed if not given
    """

    name: str = "street"
    seed: int = 0
    passes: int | tuple[int, int] = 8
    snr_db: float | tuple[float, float] = 20.0
    noise: str = "colored"
    signal_noise: float = 0.0
    bad_channels: int = 0
    spikes: float = 0.0
    gaps: int = 0
    sampling: str = "instant"
    sampling_rate: float = 5.0
    gauge_length: float = 10.0
    channel_spacing: float = 1.021
    channels: int = 241
    poisson_ratio: float = 0.25
    shear_modulus: float = 6e7
    view: tuple[float, float] = (0.0, 100.0)
    lanes: tuple[float, float] = (0.0, -3.5)
    lateral: tuple[float, float] = (2.5, 5.5)
    side: str = "either"
    depth: tuple[float, float] = (0.6, 1.2)
    undulation: tuple[float, float] = (0.0, 0.5)
    depth_undulation: tuple[float, float] = (0.0, 0.1)
    route: tuple[tuple[float, float, float], ...] | None = None
    speeds: tuple[float, float] = (30.0, 78.0)
    headway: tuple[float, float] = (16.0, 25.0)
    classes: Mapping[str, float] = field(default_factory=lambda: {"car": 0.5, "van": 0.25, "truck": 0.15, "bus": 0.1})
    frame_rate: float = 12.5
    fix_sigma: float = 0.06
    anchor_sigma: float = 0.05
    track_noise: str = "white"
    track_wander: float = 0.0
    track_wander_time: float = 3.0
    gps: bool = False
    origin: tuple[float, float] = (32.113, 34.804)
    x_azimuth: float = 78.0
    start: str = "2025-08-11T06:00:00"
    effects: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check(self)

    def effect(self, name: str) -> float:
        """Amount of a hidden effect, 0 if absent; or a setting of one, drawn if not given."""
        return amount_of(self.effects, self.seed, name)

    def drawn(self) -> "Scenario":
        """The same with numbers drawn from the ranges of `passes` and `snr_db`."""
        if not isinstance(self.passes, tuple) and not isinstance(self.snr_db, tuple):
            return self
        rng = effect_rng(self.seed, "passes, snr_db")
        low, high = np.broadcast_to(self.passes, 2)
        passes = int(rng.integers(low, high, endpoint=True))
        snr_db = float(rng.uniform(*np.broadcast_to(self.snr_db, 2)))
        return dataclasses.replace(self, passes=passes, snr_db=snr_db)


BUILT_IN: dict[str, dict[str, Any]] = {
    "street": {},
    # A short street: all that can be done with a survey takes a minute or two on it.
    "street-short": {"view": (0.0, 40.0), "channels": 121, "passes": 4},
    "street-gps": {"gps": True, "frame_rate": 5.0},
    "street-paper": {"effects": {"point_load": 1.0}},
    "street-filtered": {"sampling": "filtered"},
    "street-blind": {
        "passes": (8, 10),
        "snr_db": (15.0, 20.0),
        "noise": "street",
        "track_noise": "camera",
    },
    # The street that `vision.scene.film` films: its lanes, and what its camera sees well.
    "street-filmed": {
        "passes": 8,
        "lanes": (1.75, -1.75),
        "view": (18.0, 78.0),
        "headway": (9.0, 13.0),
        "classes": {"car": 0.4, "van": 0.3, "truck": 0.15, "bus": 0.15},
    },
}


def read_scenario(source: str | Path, **overrides: Any) -> Scenario:
    """Read a scenario from a TOML file, or take a built-in one by its name.

    Parameters
    ----------
    source : path of a TOML file whose keys are the fields of `Scenario` (`base = "street-gps"` starts from a
        built-in one), or a name in `BUILT_IN`
    **overrides : fields that override the file's; None keeps the file's

    Raises
    ------
    InputError
        If there is no such file or name, it is not TOML, a key is unknown, or a value is of the wrong type or out of
        range.

    >>> read_scenario("street-gps", seed=3, passes=None).gps
    True
    """
    table = dict(BUILT_IN[str(source)], name=str(source)) if str(source) in BUILT_IN else _from_file(Path(source))
    table |= {key: value for key, value in overrides.items() if value is not None}
    known = {f.name: f for f in dataclasses.fields(Scenario)}
    for key in table:
        if key not in known:
            raise InputError(f"{source}: no setting `{key}`; known are {', '.join(known)}")
    try:
        return Scenario(**{key: _tuples(value) for key, value in table.items()})
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def amounts(words: Sequence[str]) -> dict[str, float]:
    """Effects from words such as `gauge_length=0.15`.

    Raises
    ------
    InputError
        If a word is not NAME=NUMBER.

    >>> amounts(["lowpass=1.5", "lowpass_order=2"])
    {'lowpass': 1.5, 'lowpass_order': 2.0}
    """
    effects = {}
    for word in words:
        name, _, number = word.partition("=")
        try:
            effects[name.strip()] = float(number)
        except ValueError as error:
            raise InputError(f"--hide {word}: must be NAME=NUMBER, such as gauge_length=0.15") from error
    return effects


def _from_file(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"{path}: neither a file nor a built-in scenario ({', '.join(BUILT_IN)})")
    table = read_toml(path, "a scenario in TOML")
    base = table.pop("base", "street")
    if base not in BUILT_IN:
        raise InputError(f"{path}: no built-in scenario `{base}`; known are {', '.join(BUILT_IN)}")
    return {**BUILT_IN[base], "name": path.stem, **table}


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def check(scenario: Scenario) -> None:
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
    for name in ("signal_noise", "spikes"):
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
    for name in ("name", "side", "sampling", "start", "noise", "track_noise"):
        if not isinstance(getattr(scenario, name), str):
            raise InputError(f"{name}: must be text, in quotes")
    for name in ("classes", "effects"):
        _amounts(name, getattr(scenario, name))
    for good, message in _rules(scenario):
        if not good:
            raise InputError(message)


def _rules(s: Scenario) -> list[tuple[bool, str]]:
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


def _effect_rules(s: Scenario) -> list[tuple[bool, str]]:
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
