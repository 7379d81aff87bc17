"""What stretches.json holds, which roadfiber writes for other programs and never reads back."""

from typing import Literal

from roadfiber.written_files import Written
from solver.criticism.explanations import Weighed


class StretchFile(Written):
    """What a stretch of a long fiber lacks.

    Attributes
    ----------
    first, last : its channels
    verdict : on its model
    effect, probability : what is missing there, and how probable that is; empty and null where nothing known is
    size, sigma : of the effect, in the unit that its page has
    headline : the verdict as a sentence
    folder : its run folder, beside this file
    """

    first: int
    last: int
    verdict: Literal["adequate", "missing-effect", "unknown-effect", "inconclusive"]
    effect: str
    probability: float
    size: float
    sigma: float
    headline: str
    folder: str


class StretchesFile(Written):
    """stretches.json: what the stretches of a long fiber lack, each by itself and together.

    Attributes
    ----------
    format : of the file
    headline : the verdict as a sentence in plain words
    verdict : on one cause along all of the fiber, else on the worst stretch
    alike : probability of one cause, or none, along all of the fiber, if it was as likely as not before
    explanations : that have one cause along all of it, most probable first; their probabilities sum to 1
    stretches : each by itself
    """

    format: Literal["roadfiber stretches 1"]
    headline: str
    verdict: Literal["adequate", "missing-effect", "unknown-effect", "inconclusive"]
    alike: float
    explanations: tuple[Weighed, ...]
    stretches: tuple[StretchFile, ...]
