"""What a diagnosis found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.criticism.audit import NoiseAudit
from solver.criticism.candidate import Candidate
from solver.criticism.explanations import Weighed
from solver.fit.map_fit import MapFit
from solver.fit.state import State

if TYPE_CHECKING:
    from solver.criticism.bench import Bench
    from solver.criticism.corridor import Corridor

#: Candidates that a page lists.
LISTED = 12


@dataclass(frozen=True)
class Diagnosis:
    """What a survey says of its model.

    Parameters
    ----------
    verdict : adequate, missing-effect, unknown-effect or inconclusive
    words : the same in a sentence or two
    candidates : best first
    audit : of the noise
    stress : residual along what was fitted, sigmas
    separate : what survey would tell the confounded apart; "" where nothing is confounded
    left : ln of the Bayes factor of the best effect beside the first candidate
    bend : where the fiber bends more sharply than the route follows, as a clause, where that is all that is missing
    explanations : nothing, each effect or fault, something unknown at each stage, with their probabilities, which sum
        to 1, most probable first; () where the noise is not understood
    corridor : what is added to the route's corridor by what the model may lack; None where nothing was weighed
    fits : where the fit with each candidate ended that was fitted in full, by its name
    predicted : what the others of the first `LISTED` would change [sample, channel], noise sigmas, by name
    """

    verdict: str
    words: str
    candidates: tuple[Candidate, ...]
    audit: NoiseAudit
    stress: float
    separate: str = ""
    left: float = 0.0
    bend: str = ""
    explanations: tuple[Weighed, ...] = ()
    corridor: "Corridor | None" = field(default=None, repr=False, compare=False)
    fits: Mapping[str, tuple[MapFit, State]] = field(default_factory=dict, repr=False, compare=False)
    predicted: Mapping[str, NDArray[np.float64]] = field(default_factory=dict, repr=False, compare=False)


def concluded(bench: "Bench", verdict: str, words: str, candidates: Sequence[Candidate], **more: Any) -> Diagnosis:
    """A verdict on a fit."""
    return Diagnosis(verdict, words, tuple(candidates), bench.audit, bench.scorer.stress, **more)
