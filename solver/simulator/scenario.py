"""What to simulate: one dataclass, read from a TOML file or taken by a built-in name."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from solver.simulator.ducts import COIL, drawn_shape
from solver.simulator.effects import amount_of, effect_rng
from solver.simulator.scenario_checks import check
from vision.contract import InputError, read_toml


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
    noise_drift : sd of the log of the noise's level, which drifts over about a minute, in all channels alike
    noise_freedom : degrees of freedom of Student's t, of which single samples of the noise are drawn; 0: Gaussian
    signal_noise : sd of noise that grows with the signal, relative to it
    side_street : vehicles a minute on a street that crosses the road in view, which no camera sees
    rounding : step to which the record is rounded, in sds of the noise; 0: none
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
    laid : "winding", a run that undulates so; or in straight ducts, see `solver.simulator.ducts`: "as-built", in a way
        that the seed draws, or one of `ducts.SHAPES`, such as "crossing"; `read_scenario` has "as-built" where nothing
        else is said
    route : points [x, y, z], m, of a spline, in place of the street route
    speeds : km/h
    headway : s between two passes
    ahead : share of the vehicles that drive along +x
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
    noise_drift: float = 0.0
    noise_freedom: float = 0.0
    signal_noise: float = 0.0
    side_street: float = 0.0
    rounding: float = 0.0
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
    laid: str = "winding"
    route: tuple[tuple[float, float, float], ...] | None = None
    speeds: tuple[float, float] = (30.0, 78.0)
    headway: tuple[float, float] = (16.0, 25.0)
    ahead: float = 0.5
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
        """The same with numbers drawn from the ranges of `passes` and `snr_db`, and with a shape of its ducts."""
        if self.laid == "as-built":
            return dataclasses.replace(self, laid=drawn_shape(effect_rng(self.seed, "laid"))).drawn()
        if self.laid == "coil" and "slack_spool" not in self.effects:
            coil = round(float(effect_rng(self.seed, "coil").uniform(*COIL)), 1)
            return dataclasses.replace(self, effects={**self.effects, "slack_spool": coil}).drawn()
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
    named = {**BUILT_IN[str(source)], "name": str(source)} if str(source) in BUILT_IN else _from_file(Path(source))
    table = {"laid": "as-built"} | named | {key: value for key, value in overrides.items() if value is not None}
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
