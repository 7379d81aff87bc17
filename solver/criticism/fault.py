"""A fault of a survey that changes no stage of the signal path."""

from collections.abc import Callable
from dataclasses import dataclass

from solver.fit.problem import Problem


@dataclass(frozen=True)
class Fault:
    """A fault found.

    Parameters
    ----------
    name, stage : as in the catalogue
    fall : of chi2 once it is mended
    freedom, trials : numbers that mending adds, and places searched
    estimate, sigma : its size
    unit : of the size
    detectable : smallest size this survey would have shown
    words : where and what
    mend : survey -> mended survey
    """

    name: str
    stage: str
    fall: float
    freedom: int
    trials: int
    estimate: float
    sigma: float
    unit: str
    detectable: float
    words: str
    mend: Callable[[Problem], Problem]
