"""What a run holds."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.fit.problem import Problem
from solver.fit.result import FitResult
from solver.survey.anchors import Anchor
from solver.trajectory.vehicle_pass import Pass
from vision.contract import LocalFrame


@dataclass(frozen=True)
class Run:
    """One located fiber with all that its report shows.

    Parameters
    ----------
    result : of the fit
    problem : what was fitted
    frame : the local frame of all x, y
    start : of the record, UTC
    time : s since `start` [sample], of the fitted samples
    passes, anchors : as fitted
    facts : the content of fit.json
    """

    result: FitResult
    problem: Problem
    frame: LocalFrame
    start: np.datetime64
    time: NDArray[np.float64]
    passes: list[Pass]
    anchors: list[Anchor]
    facts: dict[str, Any]
