"""An effect: a differentiable change to one stage of the signal path, exactly absent at its null value."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from torch import Tensor

from solver.effect.parameter import BY_ROW, SCOPES, Parameter
from solver.effect.plain import Plain
from solver.effect.survey_context import Fitted, Heard, Proposal, Recorded, Start, Surroundings

#: The stages of the signal path, in order.
STAGES = ("trajectory", "load", "ground", "cable", "interrogator", "processing")

#: Families of effects that surveys often cannot tell apart: one is not named without the others unless the survey
#: separates them.
FAMILIES = ("blur", "lag", "even", "gain", "place", "depth", "rigid", "curve")
#: Parts of the base model that do what an effect does: wheels of known vehicle classes, bends of the fiber in a gauge.
BASE_PARTS = ("wheels", "bends")
#: What files state, of which an effect says by what share it is off: gauge length, channel spacing, how fast one clock
#: runs by the other.
STATED = ("gauge", "spacing", "rate")

Change = Callable[[Any, Mapping[str, Tensor], Surroundings], Any]


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
    confounders : what it is confounded with, in words
    families : of `FAMILIES`, those it belongs to; those whose laws leave what it takes up, if it is a discrepancy model
    discrepancy : what it is as a discrepancy model; None for a physical effect
    order : effects of a stage act in this order, whichever was added first: those that say where wheels stand and how
        they share the load (below 0) before those that change forces (0), and pushes, which are shares of these, after
        them (above 0); laws of the ground (below 0) before what changes them
    base_part : of `BASE_PARTS`, the one that does what it does, so that a base model with it lacks nothing; "" if none
    corrects : of `STATED`, what its first parameter says is off; "" if none
    slow_error : it is each track's slow error, which is fitted wherever tracks are uncertain, as far as they say
    seek : finds the shapes worth trying in what was heard, where a grid fine enough would be too large; else None
    starts : finds where else fits with it may start, if anywhere; else None
    trace : says how a record shows that it is in there, None where it does not; else None
    """

    name: str
    stage: str
    parameters: tuple[Parameter, ...]
    change: Change
    physics: str
    source: str
    plain: Plain | None = None
    confounders: str = ""
    families: tuple[str, ...] = ()
    discrepancy: Discrepancy | None = None
    order: int = 0
    base_part: str = ""
    corrects: str = ""
    slow_error: bool = False
    seek: Callable[[Heard], Proposal] | None = None
    starts: Callable[[Fitted], Sequence[Start]] | None = None
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

    @property
    def varies(self) -> bool:
        """Whether its size has many numbers: by pass, or along fiber, road or time.

        >>> from solver.catalogue.catalogue import built_in
        >>> [name for name in ("lowpass", "track_jitter", "dynamic_load") if built_in()[name].varies]
        ['track_jitter', 'dynamic_load']
        """
        return any(p.scope != "one" for p in self.amplitudes)

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
    confounders: str = "",
    families: Sequence[str] = (),
    discrepancy: Discrepancy | None = None,
    order: int = 0,
    base_part: str = "",
    corrects: str = "",
    slow_error: bool = False,
    seek: Callable[[Heard], Proposal] | None = None,
    starts: Callable[[Fitted], Sequence[Start]] | None = None,
    trace: Callable[[Recorded], str | None] | None = None,
) -> Callable[[Change], Effect]:
    """Make an effect of a function.

    Parameters
    ----------
    name, stage, parameters, physics, source : see `Effect`, as all others

    Raises
    ------
    ValueError
        Where the declaration cannot hold: no such stage, scope, family, part of the base model or statement, no
        parameter with a null, bounds that leave it out.

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
    if corrects not in ("", *STATED):
        raise ValueError(f"effect {name}: corrects {corrects!r} is none of {', '.join(STATED)}")
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
            confounders=confounders,
            families=tuple(families),
            discrepancy=discrepancy,
            order=order,
            base_part=base_part,
            corrects=corrects,
            slow_error=slow_error,
            seek=seek,
            starts=starts,
            trace=trace,
        )

    return make
