"""What is seen of a run: all that its pictures show, without the model that made it.

It can be read and drawn before PyTorch is loaded, which takes longer than to draw it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.fit.longest import ONE_STRETCH, is_one_stretch
from solver.fit.result import Corner, FitResult, Placed
from solver.run.located_fiber import LocatedFiber
from solver.run.run_corridor import corridor_sentence, placed
from solver.run.rung import Rung
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass
from vision.contract import LocalFrame


@dataclass(frozen=True, eq=False, repr=False)
class Seen(LocatedFiber):
    """A located fiber as it is drawn; parameters as of `solver.run.run.Run`, which has its model too."""

    result: FitResult
    frame: LocalFrame
    start: np.datetime64
    time: NDArray[np.float64]
    passes: list[Pass]
    anchors: list[Anchor]
    facts: dict[str, Any]
    rungs: tuple[Rung, ...] = ()
    folder: Path | None = None
    added: NDArray[np.float64] | None = None

    @property
    def effects(self) -> list[str]:
        """Names of the effects in the model."""
        return list(self.facts["effects"])

    @property
    def warnings(self) -> list[str]:
        """What else must be known before the route is relied on; a line each."""
        return list(self.facts["warnings"])

    @property
    def corridor(self) -> str:
        """How wide the 95 % corridor is, what widens it and what would narrow it; "" where no sigma is known."""
        return corridor_sentence(self.facts["corridor"])

    @property
    def place(self) -> Placed:
        """The route with the covariance of its 95 % corridor, which every file and picture shows."""
        trust, left_out = self.facts["trust"], self.corridor if self.facts["corridor"]["why"] else ""
        return placed(self.result, self.added, trust["grade"], trust["sentence"], left_out)

    @property
    def corners(self) -> tuple[Corner, ...]:
        """Where the fiber turns, or goes deeper or less deep."""
        return self.result.corners

    @property
    def too_long(self) -> str:
        """Why its model cannot be criticized as a whole, and what to do; empty where it can."""
        ends = np.interp(self.result.fitted_channel[[0, -1]], self.result.channel, self.result.distance)
        length = float(ends[1] - ends[0])
        if is_one_stretch(length):
            return ""
        return (
            f"run of {length:.0f} m of fiber: a model is criticized over {ONE_STRETCH:.0f} m at most; "
            "`roadfiber diagnose` and `compare` look at stretch after stretch, `roadfiber stretch` makes a run of one"
        )
