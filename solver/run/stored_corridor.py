"""The part of fit.json on the 95 % corridor: how wide it is, and what it counts."""

from typing import Annotated, Literal

from pydantic import Field

from solver.run.stored_types import Size, Stored, Text


class ExplanationFile(Stored):
    """One of `corridor.explanations`: what may be the case, and how probable that is.

    Attributes
    ----------
    title : in plain words
    kind : nothing (that would show), effect, two, fault, unknown, or overlooked (something that no model shows)
    effects : names of what would be missing
    stage : at which that acts; empty for nothing
    probability : by the score test of every effect; `roadfiber diagnose` fits the best in full
    """

    title: Text
    kind: Literal["nothing", "effect", "two", "fault", "unknown", "overlooked"]
    effects: tuple[Text, ...]
    stage: Text
    probability: Annotated[float, Field(ge=0, le=1.001)]


class CorridorFile(Stored):
    """`corridor`: how wide the 95 % corridor is, and why.

    Attributes
    ----------
    full : whether it holds what the model may lack; else it takes the model for granted
    why : it does that, or leaves out a part of what the model may lack; empty where it does not
    half_width : half of its width, m, the median over channels that data decide; null where no sigma is known,
        or the fit has not converged
    half_width_fit : the same if the model lacks nothing
    widest : effect that widens it most, or disagreement (of vehicles about the route); empty where none does
    title : of that, in plain words
    share : of what is added to the fit's variance, by that
    narrower : what would narrow it: a survey, or the effect in the model
    explanations : all that the model may lack, most probable first
    """

    full: bool
    why: Text
    half_width: Size | None
    half_width_fit: Size | None
    widest: Text
    title: Text
    share: Annotated[float, Field(ge=0, le=1.001)]
    narrower: Text
    explanations: tuple[ExplanationFile, ...]
