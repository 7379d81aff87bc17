"""What an effect is: a differentiable change to one stage of the signal path, exactly absent at its null value.

`effect` makes one of a function; `Effect` is what it declares, `Parameter` one parameter, `Plain` its plain words.
"""

from solver.effect.effect import BASE_PARTS, FAMILIES, STAGES, STATED, Change, Discrepancy, Effect, effect
from solver.effect.parameter import BY_ROW, SCOPES, Parameter
from solver.effect.plain import Plain, Setting, absolute, as_it_is, grown, percent, percents, root
from solver.effect.survey_context import Fitted, Heard, Proposal, Recorded, Start, Surroundings

__all__ = [
    "BASE_PARTS",
    "BY_ROW",
    "FAMILIES",
    "SCOPES",
    "STAGES",
    "STATED",
    "Change",
    "Discrepancy",
    "Effect",
    "Fitted",
    "Heard",
    "Parameter",
    "Plain",
    "Proposal",
    "Recorded",
    "Setting",
    "Start",
    "Surroundings",
    "absolute",
    "as_it_is",
    "effect",
    "grown",
    "percent",
    "percents",
    "root",
]
