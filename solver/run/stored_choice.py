"""The choice among many passes as fit.json keeps it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from solver.run.stored_types import (
    Count,
    Place,
    Stored,
    Text,
)

#: Of what a pass narrows the sigma, and by which share.
Narrower = Annotated[dict[Literal["route", "depth", "ground"], Annotated[float, Field(le=1)]], Field(min_length=1)]


class TakenFile(Stored):
    """One of `choice.taken`: a pass, m/s, m, and the share by which each sigma was expected to fall with it."""

    track_id: Text
    vehicle_class: Text
    speed: Place
    lane: Place
    narrower: Narrower


class MissingFile(Stored):
    """One of `choice.missing`: a kind of pass in words."""

    kind: Text
    narrower: Narrower


class ChoiceFile(Stored):
    """`choice`: what `solver.run.chosen.choice_facts` makes."""

    of: Count
    tested: Count
    taken: tuple[TakenFile, ...]
    missing: tuple[MissingFile, ...]

    @model_validator(mode="after")
    def alike(self) -> "ChoiceFile":
        """Refuse passes of which not the same is known."""
        known = [one.narrower for one in self.taken] + [one.narrower for one in self.missing]
        if len({tuple(sorted(one)) for one in known}) > 1:
            raise ValueError("not of every pass is the same sigma known")
        return self
