"""Whether an effect keeps the promises of effects, tried on a tiny survey; errors say how to mend it."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from typing import Any

import torch
from torch import Tensor

from solver.catalogue.trial_survey import Trial, trial_survey
from solver.effect import Effect, Parameter, Surroundings
from vision.contract import InputError

#: Largest difference from the base model at null, over the largest strain rate: rounding.
ROUNDING = 1e-10
#: Step of the check of derivatives, in plausible sizes, and by how much the two may differ.
STEP, SLACK = 1e-4, 0.05

#: Axes of what effects may change in a stage; "column" is 1 or channel.
AXES: dict[str, dict[str, tuple[str | int, ...]]] = {
    "trajectory": {
        "time": ("row", 1),
        "position": ("row", "column", 2),
        "velocity": ("row", "column", 2),
        "heading": ("row", "column", 2),
    },
    "load": {
        "position": ("row", "column", "wheel", 2),
        "share": ("row", "column", "wheel"),
        "share_rate": ("row", "column", "wheel"),
        "thrust": ("row", "column", "wheel", 2),
        "thrust_rate": ("row", "column", "wheel", 2),
    },
    "ground": {},
    "cable": {"shift": ("channel",), "gain": ("channel",)},
    "interrogator": {"gauge_length": (), "gain": ("sample", 1)},
    "processing": {},
}


class Declared(dict[str, Tensor]):
    """Values of an effect's parameters, which know what to say of a name that was not declared."""

    effect: str

    def __missing__(self, name: str) -> Tensor:
        known = ", ".join(self)
        raise InputError(
            f"effect {self.effect}: looks up {name!r}, which is not a parameter of it; declared are {known}"
        )


def watched(effect: Effect) -> Effect:
    """The same effect, whose function is given `Declared` values."""

    def change(stage: Any, values: Mapping[str, Tensor], survey: Any) -> Any:
        declared = Declared(values)
        declared.effect = effect.name
        return effect.change(stage, declared, survey)

    return replace(effect, change=change)


@contextmanager
def teaching(effect: Effect, doing: str) -> Iterator[None]:
    """Turn whatever an effect's function raises into one line that says how to mend it.

    Raises
    ------
    InputError
        For any exception within, one that would end the program included.
    """
    try:
        yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        told = str(error).strip().splitlines() or [""]
        if told[0].startswith(f"effect {effect.name}:"):
            raise InputError(f"{told[0]}; end it with `return replace({effect.stage}, ...)`") from error
        raise InputError(
            f"effect {effect.name}: {doing} fails with {type(error).__name__}: {told[0][:120]}; its function takes "
            f"({effect.stage}, values, survey), computes with torch alone (no numpy, .item(), or change in place) and "
            f"returns replace({effect.stage}, ...)"
        ) from error


def verify(effect: Effect) -> None:
    """Try an effect on a tiny survey: absent at null, in one stage, with a derivative that is right and not zero.

    Raises
    ------
    InputError
        Where it breaks a promise: names the effect and the parameter, says what is wrong and how to mend it.

    >>> from solver.catalogue.catalogue import built_in
    >>> verify(built_in()["channel_coupling"])
    """
    check_declaration(effect)
    with teaching(effect, "its function"):
        trial = Trial(watched(effect), *trial_survey())
        check_stage(trial)
    for shape in sampled_shapes(effect):
        with teaching(effect, "its model at null"):
            check_null(trial, shape)
    with teaching(effect, "its derivative"):
        check_derivatives(trial)


def check_declaration(effect: Effect) -> None:
    """Sizes and bounds of the parameters."""
    for p in effect.parameters:
        where = f"effect {effect.name}, {p.name}"
        if not p.plausible > 0:
            raise InputError(f"{where}: plausible size {p.plausible:g}; give a typical one, above 0")
        if p.is_shape and not all(p.lower <= value <= p.upper for value in p.grid):
            raise InputError(f"{where}: the grid leaves the bounds {p.lower:g} to {p.upper:g}; widen them")
        if not p.is_shape and not (p.null + p.plausible <= p.upper or p.null - p.plausible >= p.lower):
            raise InputError(
                f"{where}: no value a plausible size {p.plausible:g} from null {p.null:g} is within the bounds "
                f"{p.lower:g} to {p.upper:g}; widen them or give a smaller size"
            )


def sampled_shapes(effect: Effect) -> list[dict[str, float]]:
    """First, middle and last value of every grid; [{}] where the effect has none."""
    shares = (0, 0.5, 1) if effect.shapes else (0,)
    return [{p.name: p.grid[round(share * (len(p.grid) - 1))] for p in effect.shapes} for share in shares]


def plausible(parameter: Parameter) -> float:
    """A value a plausible size away from null and within the bounds.

    >>> plausible(Parameter("share", "1", 0.2, null=1.0, upper=1.0))
    0.8
    """
    above = parameter.null + parameter.plausible
    return above if above <= parameter.upper else parameter.null - parameter.plausible


def parts(value: Any, of: str = "") -> dict[str, Any]:
    """All parts of a stage, or of what is around it, by name; those of its trajectory too."""
    found: dict[str, Any] = {}
    for f in fields(value):
        part = getattr(value, f.name)
        found |= parts(part, f"{of}{f.name}.") if is_dataclass(part) else {of + f.name: part}
    return found


class Inputs:
    """What an effect's function was given, to see whether it changed any of it in place."""

    def __init__(self, given: Any, values: Mapping[str, Tensor], survey: Surroundings):
        self.given, self.values, self.survey = given, values, survey
        self.before = {name: (part, self.mark(part)) for name, part in self.parts().items()}

    def parts(self) -> dict[str, Any]:
        """Everything, by name."""
        values = {f"values[{name!r}]": value for name, value in self.values.items()}
        return parts(self.given) | values | parts(self.survey, "survey.")

    @staticmethod
    def mark(part: Any) -> Any:
        """Numbers, and how often PyTorch wrote them: a change by nothing at these values is one at others."""
        return (part.detach().clone(), part._version) if isinstance(part, Tensor) else None

    def changed(self) -> str | None:
        """Name of a part that is not as it was."""
        for name, part in self.parts().items():
            was, mark = self.before[name]
            if part is not was:
                return name
            if isinstance(part, Tensor) and (part._version != mark[1] or not torch.equal(part, mark[0])):
                return name
        return None


def check_stage(trial: Trial) -> None:
    """What the effect gives back at its plausible size: its own stage, changed in nothing that is another's."""
    effect, name = trial.effect, f"effect {trial.effect.name}"
    given = trial.given()
    values = trial.extension.local(trial.numbers({p.name: plausible(p) for p in effect.amplitudes}))
    inputs = Inputs(given, values[effect.name], trial.around)
    changed = trial.extension.changed(effect.stage, given, values)
    if part := inputs.changed():
        raise InputError(f"{name}: changes {part} in place; make a new tensor and `return replace(...)`")
    check_axes(trial, changed)
    now = parts(changed)
    for key, part in parts(given).items():
        if key.startswith("trajectory.") and not torch.equal(part, now[key]):
            raise InputError(
                f"{name}: changes two stages, the load and its {key}; declare it for the stage trajectory, or as two "
                "effects"
            )


def check_axes(trial: Trial, changed: Any) -> None:
    """Shapes of a changed stage."""
    channels = len(trial.around.distance)
    traffic = trial.path.traffic
    sizes = {"row": {len(traffic.pass_index)}, "sample": {len(traffic.samples)}}
    sizes |= {"channel": {channels}, "column": {1, channels}}
    for field, axes in AXES[trial.effect.stage].items():
        value = getattr(changed, field)
        # One number serves all channels.
        if not isinstance(value, Tensor) or (value.ndim == 0 and trial.effect.stage != "trajectory"):
            continue
        fits = value.ndim == len(axes) and all(
            size in sizes.get(str(axis), {size} if axis == "wheel" else {axis})
            for size, axis in zip(value.shape, axes, strict=True)
        )
        if not fits:
            wanted = ", ".join("1 or channel" if axis == "column" else str(axis) for axis in axes)
            raise InputError(
                f"effect {trial.effect.name}: {trial.effect.stage}.{field} has shape {list(value.shape)}, "
                f'not [{wanted}]; values of scope "pass", "road" and "track" are [row, 1], of "fiber" [channel], of '
                '"time" [sample, 1]: add axes with [..., None]'
            )


def at(shape: Mapping[str, float]) -> str:
    """Where in the grid, in words."""
    return "".join(f", {name} {value:g}" for name, value in shape.items())


def check_null(trial: Trial, shape: Mapping[str, float]) -> None:
    """The model with the effect at null is that without it."""
    effect, base = trial.effect, trial.base()
    nulls = " and ".join(f"{p.name} = {p.null:g}" for p in effect.amplitudes) + at(shape)
    made = trial.map(trial.numbers(shape))
    if made.shape != base.shape:
        raise InputError(
            f"effect {effect.name}: its map is {list(made.shape)}, not [sample, channel] {list(base.shape)}; what it "
            "puts into the stage must keep shapes"
        )
    if not made.isfinite().all():
        raise InputError(f"effect {effect.name}: not finite at {nulls}; avoid 0/0 there, as with torch.where")
    size = float((made - base).abs().max() / base.abs().max())
    if size > ROUNDING:
        raise InputError(
            f"effect {effect.name}: not absent at {nulls}: it changes the strain rate by {size:.2g} of its largest; "
            "make null the value at which the function gives its stage back unchanged"
        )


def check_derivatives(trial: Trial) -> None:
    """Derivatives at null are finite, right, and somewhere not zero."""
    effective: set[str] = set()
    for shape in sampled_shapes(trial.effect):
        numbers = trial.numbers(shape)
        for name, columns in trial.derivatives(numbers).items():
            parameter = trial.effect.parameter(name)
            if not columns.isfinite().all():
                raise InputError(
                    f"effect {trial.effect.name}, {name}: its derivative at null is not finite"
                    f"{at(shape)}; take a parameter in which the change is smooth, as the square "
                    "of a length, and avoid sqrt(0), abs and 0/0"
                )
            if check_slope(trial, parameter, shape, columns):
                effective.add(name)
    for parameter in trial.effect.amplitudes:
        if parameter.name not in effective:
            raise InputError(flat(trial, parameter))


def check_slope(trial: Trial, parameter: Parameter, shape: Mapping[str, float], columns: Tensor) -> bool:
    """Whether the derivative [number, sample, channel] is not zero; it must agree with a small step's."""
    step = STEP * (plausible(parameter) - parameter.null)
    stepped = trial.map(trial.numbers({**shape, parameter.name: parameter.null + step})) - trial.base()
    slope = columns.sum(0)
    size = float(slope.abs().max())
    if size * abs(step) < 1e-12 * float(trial.base().abs().max()):
        return False
    if float((stepped / step - slope).abs().max()) > SLACK * size:
        raise InputError(
            f"effect {trial.effect.name}, {parameter.name}: its derivative at null is not that of a small step"
            f"{at(shape)}; .detach(), .item() and numpy cut derivatives, and a bound or maximum has a kink"
        )
    return True


def flat(trial: Trial, parameter: Parameter) -> str:
    """Why a derivative is zero at all shapes, and what to do."""
    where = f"effect {trial.effect.name}, {parameter.name}"
    for shape in sampled_shapes(trial.effect):
        made = trial.map(trial.numbers({**shape, parameter.name: plausible(parameter)}))
        if float((made - trial.base()).abs().max()) > ROUNDING * float(trial.base().abs().max()):
            return (
                f"{where}: its derivative at null is zero though its effect is not; declare {parameter.name}_squared "
                "if it enters by its square; abs has none at 0, and .detach(), .item() and numpy cut derivatives"
            )
    return (
        f"{where}: changes nothing, not even at {plausible(parameter):g}; use values[{parameter.name!r}] in the "
        "function, or, if it means something only with another parameter (a place, a frequency), give it a grid"
    )
