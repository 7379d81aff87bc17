"""The fit of a run, ready to be continued."""

import numpy as np
import torch

from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.state import State
from solver.run.run import Run, require_whole
from vision.contract import InputError


def fitted(run: Run) -> tuple[MapFit, State]:
    """The fit of a run and where it ended.

    Raises
    ------
    InputError
        If the run is of a long fiber, where effects would have to be the same along all of it, or of no one street; if
        it holds other numbers than its model has, or where no fit ends; or if code of its model was not given.
    """
    require_whole(run)
    fit = MapFit(run.problem)
    if len(run.result.vector) != len(fit.mean):
        raise InputError(
            f"run: holds {len(run.result.vector)} fitted numbers, and its model has {len(fit.mean)}; "
            "give the plugin it was made with, or run `roadfiber locate` again"
        )
    state = fit.state_of(torch.from_numpy(run.result.vector))
    held = np.nansum((run.problem.record / run.result.noise) ** 2)
    if not Chain.single(fit).prior.total(state) <= held:
        raise InputError(
            f"{run.folder or 'run'}: its fitted numbers are farther from what was expected than all of its record "
            "bears out, so no fit ended there; run `roadfiber locate` again"
        )
    return fit, state
