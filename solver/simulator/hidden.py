"""Description of an effect that a survey can hide."""

from collections.abc import Mapping
from typing import NamedTuple


class Setting(NamedTuple):
    """A secondary number of an effect; if not given, the seed draws it between `low` and `high`."""

    low: float
    high: float
    meaning: str


class Hidden(NamedTuple):
    """An effect that a survey can hide. An amount of 0 is its absence.

    Attributes
    ----------
    stage : of the signal path that it changes
    meaning : of the amount, with its unit
    plausible : amounts, low and high, met on streets
    signed : whether negative amounts are as plausible; else there are none
    settings : secondary numbers; `tau` of `viscoelastic_lag` is given as `viscoelastic_lag_tau`
    """

    stage: str
    meaning: str
    plausible: tuple[float, float]
    settings: Mapping[str, Setting] = {}
    signed: bool = False
