"""What an effect is: a differentiable change to one stage of the signal path, exactly absent at its null value."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import expm1
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

#: The stages of the signal path, in order.
STAGES = ("trajectory", "load", "ground", "cable", "interrogator", "processing")

#: What a parameter may be: one number, one per pass, or smooth along the fiber, the road, each pass, or in time.
SCOPES = ("one", "pass", "fiber", "road", "track", "time")
#: Those of which each row, a vehicle at a sample, has a value.
BY_ROW = ("pass", "road", "track")

#: Families of effects that surveys often cannot tell apart: one is not named without the others unless the survey
#: separates them.
FAMILIES = ("blur", "lag", "even", "gain", "place", "depth", "rigid", "curve")
#: Parts of the base model that do what an effect does: wheels of known vehicle classes, bends of the fiber in a gauge.
BASE_PARTS = ("wheels", "bends")


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Parameters
    ----------
    name : as the effect's function looks it up
    unit : "1" for a pure number
    plausible : size that would surprise nobody; also the standard deviation of the prior once the effect is added. Many
        numbers without bounds whose root mean square is over three times that are no such effect
    null : value at which the effect is absent
    lower, upper : bounds
    scope : "one", "pass" (one per pass), or smooth along the "fiber", the "road" (x of the vehicle) or each "track", or
        in "time", the same for all vehicles
    rated : give the function the time derivative of what is smooth along the road or each track too, as `<name>_rate`
    grid : for a parameter that means nothing at the null of the others (a relaxation time, a place): the values that
        the search tries; () for all others
    """

    name: str
    unit: str
    plausible: float
    null: float = 0.0
    lower: float = -float("inf")
    upper: float = float("inf")
    scope: str = "one"
    grid: tuple[float, ...] = ()
    rated: bool = False

    @property
    def is_shape(self) -> bool:
        """Whether it has no null of its own."""
        return bool(self.grid)

    @property
    def rate_name(self) -> str:
        """Under which a function finds the time derivative, where it is `rated`."""
        return f"{self.name}_rate"

    @property
    def spacing(self) -> float:
        """Largest step of the grid; its plausible size where there is one value."""
        return max((b - a for a, b in pairwise(self.grid)), default=self.plausible)

    @property
    def one_sided(self) -> bool:
        """Whether the null is a bound."""
        return self.null in (self.lower, self.upper)


@dataclass(frozen=True)
class Surroundings:
    """What an effect may ask about the survey, beside the stage that it changes.

    Parameters
    ----------
    distance : [channel], along the fiber, m
    recorded : channels of the whole record, those beyond the stretch that is fitted included
    gauge_length, channel_spacing : m
    sampling_rate : Hz
    passes : number of passes
    middle : [2], middle of the stretch of road that was observed, m
    largest : largest strain rate of the record, single jumps left aside, 1/s
    """

    distance: Tensor
    recorded: int
    gauge_length: float
    channel_spacing: float
    sampling_rate: float
    passes: int
    middle: Tensor
    largest: float


Change = Callable[[Any, Mapping[str, Tensor], Surroundings], Any]


@dataclass(frozen=True)
class Setting:
    """What the size of an effect may depend on in a survey, where it is told in words.

    Parameters
    ----------
    gauge_length, channel_spacing : m, as told
    x : middle of the stretch of road that was observed, m
    along : middle of the fitted channels, m along the fiber
    """

    gauge_length: float
    channel_spacing: float
    x: float
    along: float


def as_it_is(value: float, setting: Setting) -> float:
    """The number itself."""
    return value


def absolute(value: float, setting: Setting) -> float:
    """The number without its sign."""
    return abs(value)


def percent(value: float, setting: Setting) -> float:
    """A share in percent."""
    return 100 * value


def percents(value: float, setting: Setting) -> float:
    """A share in percent, without its sign."""
    return 100 * abs(value)


def grown(value: float, setting: Setting) -> float:
    """The logarithm of a ratio as percent more or less."""
    return 100 * expm1(value)


def root(value: float, setting: Setting) -> float:
    """The root of what enters by its square."""
    return float(max(value, 0.0) ** 0.5)


@dataclass(frozen=True)
class Plain:
    """An effect as a city engineer reads it.

    Parameters
    ----------
    title : two or three words
    sentence : what is the case, in plain words, where "{size}" stands for the size with its unit, "{told}" for the size
        that the survey was told, "{x}" and "{along}" for its place along the road and along the fiber, and the names of
        shape parameters for their values; "" where the physics say it
    opposite : the same for a negative size, which is told without its sign; "" where the sentence holds for both
    size : (value of its first number, setting) -> its size in the unit below
    unit : that people know; "" for that of its first number
    """

    title: str
    sentence: str = ""
    opposite: str = ""
    size: Callable[[float, Setting], float] = as_it_is
    unit: str = ""


@dataclass(frozen=True)
class Heard:
    """What a fit leaves unexplained, and what it was recorded from.

    Parameters
    ----------
    residual : [sample, channel], in units of the noise; 0 where not measured
    load : `solver.load.load.Load` of the model that was fitted; its trajectory's time is in s
    sample_index : [row], which sample
    middle, slope : [channel, 3], places of the gauges, m, and the fiber's direction there
    """

    residual: Tensor
    load: Any
    sample_index: Tensor
    middle: Tensor
    slope: Tensor


#: Shapes worth trying, and how many they were chosen from.
Proposal = tuple[list[dict[str, float]], int]


@dataclass(frozen=True)
class Fitted:
    """What is known of a survey where a fit without an effect ended.

    Parameters
    ----------
    distance : [channel], of the fitted channels along the fiber, m
    vehicle_class : [pass]
    weight : [pass], how heavy each vehicle came out, in the same unit for all
    coil : `solver.cable.fiber.Coil` that the matched filter saw; None where it saw none
    """

    distance: NDArray[np.float64]
    vehicle_class: tuple[str, ...]
    weight: NDArray[np.float64]
    coil: Any


@dataclass(frozen=True)
class Start:
    """Where a fit with an effect may start besides where the fit without it ended; Poisson's ratio is as expected.

    Parameters
    ----------
    numbers : of each amplitude, [number] each
    shape : values of the shape parameters
    route : distance along the fiber [place], m -> [place, 3], m; vehicles are as heavy as fits it. None: route and
        vehicles are as they were fitted
    """

    numbers: tuple[NDArray[np.float64], ...]
    shape: Mapping[str, float]
    route: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None


@dataclass(frozen=True)
class Recorded:
    """A record, for effects that leave a trace in its noise or in its very values.

    Parameters
    ----------
    values : [sample, channel], in units of the noise; NaN where not measured
    still : [sample, channel], no vehicle near
    sampling_rate : Hz
    channel_spacing : m
    """

    values: NDArray[np.float64]
    still: NDArray[np.bool_]
    sampling_rate: float
    channel_spacing: float


@dataclass(frozen=True)
class Discrepancy:
    """What a discrepancy model is, an effect that stands for something unknown.

    Parameters
    ----------
    stage : at which that acts, where the model is put in at another; "": at its own
    mixes : it mixes channels, and noise that is mixed too comes after the reading
    levels : it changes how strongly all channels are read, and noise that is leveled too comes after the reading
    before_and_behind : the first half of its amplitudes is of what is before a vehicle, the other half of what is
        behind
    """

    stage: str = ""
    mixes: bool = False
    levels: bool = False
    before_and_behind: bool = False


@dataclass(frozen=True)
class Effect:
    """An effect of the catalogue, or a user's own.

    Parameters
    ----------
    name : the field's term, as commands take it
    stage : one of `solver.effect.STAGES`, the one that it changes
    parameters : all of them
    change : (stage, values by name, surroundings) -> stage; values are [] for "one", [row, 1] for "pass", "road" and
        "track", [channel] for "fiber", [sample, 1] for "time"
    physics : one line
    source : paper, book or standard
    plain : the same for people who do not know the field's terms; its name and physics where None
    told_from : what it is confounded with, in words
    families : of `FAMILIES`, those it belongs to; those whose laws leave what it takes up, if it is a discrepancy model
    discrepancy : what it is as a discrepancy model; None for a physical effect
    base_part : of `BASE_PARTS`, the one that does what it does, so that a base model with it lacks nothing; "" if none
    slow_error : it is each track's slow error, which is fitted wherever tracks are uncertain, as far as they say
    seek : finds the shapes worth trying in what was heard, where a grid fine enough would be too large; else None
    start : finds where else a fit with it may start, None where nothing tells; else None
    trace : says how a record shows that it is in there, None where it does not; else None
    """

    name: str
    stage: str
    parameters: tuple[Parameter, ...]
    change: Change
    physics: str
    source: str
    plain: Plain | None = None
    told_from: str = ""
    families: tuple[str, ...] = ()
    discrepancy: Discrepancy | None = None
    base_part: str = ""
    slow_error: bool = False
    seek: Callable[[Heard], Proposal] | None = None
    start: Callable[[Fitted], Start | None] | None = None
    trace: Callable[[Recorded], str | None] | None = None

    @property
    def title(self) -> str:
        """Two or three plain words; its name where it declares none."""
        return self.name if self.plain is None else self.plain.title

    @property
    def generic(self) -> bool:
        """Whether it is a discrepancy model, and no physical effect."""
        return self.discrepancy is not None

    def parameter(self, name: str) -> Parameter:
        """Look a parameter up."""
        return next(p for p in self.parameters if p.name == name)

    @property
    def shapes(self) -> tuple[Parameter, ...]:
        """Parameters without a null of their own."""
        return tuple(p for p in self.parameters if p.is_shape)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """Parameters with a null."""
        return tuple(p for p in self.parameters if not p.is_shape)

    def tried(self, hear: Callable[[], Heard]) -> Proposal:
        """Shapes to try: those that it seeks in what `hear` gives, else all of the grids.

        >>> from solver.catalogue.catalogue import built_in
        >>> built_in()["lowpass"].tried(lambda: None)
        ([{'corner': 0.7}, {'corner': 1.0}, {'corner': 1.4}, {'corner': 2.0}], 4)
        """
        if self.seek is not None:
            return self.seek(hear())
        names = [p.name for p in self.shapes]
        shapes = [dict(zip(names, values, strict=True)) for values in product(*(p.grid for p in self.shapes))]
        return shapes, len(shapes)


def effect(
    name: str,
    stage: str,
    parameters: Sequence[Parameter],
    *,
    physics: str,
    source: str,
    plain: Plain | None = None,
    told_from: str = "",
    families: Sequence[str] = (),
    discrepancy: Discrepancy | None = None,
    base_part: str = "",
    slow_error: bool = False,
    seek: Callable[[Heard], Proposal] | None = None,
    start: Callable[[Fitted], Start | None] | None = None,
    trace: Callable[[Recorded], str | None] | None = None,
) -> Callable[[Change], Effect]:
    """Make an effect of a function.

    Parameters
    ----------
    name, stage, parameters, physics, source : see `Effect`, as all others

    Raises
    ------
    ValueError
        Where the declaration cannot hold: no such stage, scope, family or part of the base model, no parameter with a
        null, bounds that leave it out.

    >>> @effect("axle_lift", "load", [Parameter("share", "1", 0.1)], physics="The rear axle carries less.", source="-")
    ... def axle_lift(load, p, survey):
    ...     return load.modulated(1 - p["share"], 0 * p["share"])
    >>> axle_lift.name, axle_lift.stage
    ('axle_lift', 'load')
    """
    if stage not in STAGES:
        raise ValueError(f"effect {name}: stage {stage!r} is none of {', '.join(STAGES)}")
    if unknown := [family for family in families if family not in FAMILIES]:
        raise ValueError(f"effect {name}: family {unknown[0]!r} is none of {', '.join(FAMILIES)}")
    if base_part not in ("", *BASE_PARTS):
        raise ValueError(f"effect {name}: base_part {base_part!r} is none of {', '.join(BASE_PARTS)}")
    if not any(not p.is_shape for p in parameters):
        raise ValueError(f"effect {name}: give at least one parameter with a null value (no grid)")
    for p in parameters:
        if p.scope not in SCOPES:
            raise ValueError(f"effect {name}, {p.name}: scope {p.scope!r} is none of {', '.join(SCOPES)}")
        if p.scope in BY_ROW and stage not in ("trajectory", "load", "ground"):
            raise ValueError(f"effect {name}, {p.name}: scope {p.scope!r} is for effects on trajectory, load or ground")
        if p.scope == "time" and stage != "interrogator":
            raise ValueError(f"effect {name}, {p.name}: scope 'time' is for effects on the interrogator")
        if p.rated and p.scope not in ("road", "track"):
            raise ValueError(f"effect {name}, {p.name}: only what is smooth along the road or a track has a rate")
        if not p.is_shape and not p.lower <= p.null <= p.upper:
            raise ValueError(f"effect {name}, {p.name}: the null {p.null:g} is outside {p.lower:g} to {p.upper:g}")

    def make(change: Change) -> Effect:
        return Effect(
            name,
            stage,
            tuple(parameters),
            change,
            physics,
            source,
            plain=plain,
            told_from=told_from,
            families=tuple(families),
            discrepancy=discrepancy,
            base_part=base_part,
            slow_error=slow_error,
            seek=seek,
            start=start,
            trace=trace,
        )

    return make
